"""Routes of the web server, one module for each kind of thing."""

from typing import Annotated

from fastapi import Depends, Request

from nearfar.app.services import Services


def _services(request: Request) -> Services:
    """Return the services of the app that a request was sent to."""
    found: Services = request.app.state.services
    return found


Held = Annotated[Services, Depends(_services)]
"""A parameter of a route: the services of the app."""
