"""What the app answers, one module for each kind of thing."""

from typing import Annotated

from fastapi import Depends

from nearfar.app.services import Services, services

Held = Annotated[Services, Depends(services)]
"""A parameter of a route: the services of the app."""
