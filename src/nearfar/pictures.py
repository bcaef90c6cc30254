"""Pictures of a localization."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from nearfar.localization import Localization


def save_all(localization: "Localization", folder: Path) -> list[Path]:
    """Write every picture that the localization allows, as PNG."""
    return []
