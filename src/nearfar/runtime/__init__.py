"""Where and how work is done: workers, a cluster, time, logs, and packages of extras."""

import importlib.util

from nearfar.errors import MissingExtraError


def how_to_install(extra: str) -> str:
    """Return how an extra is installed, from the package index or in a clone."""
    return f"pip install 'nearfar[{extra}]', or '.[{extra}]' in a clone"


def require(extra: str, *packages: str) -> None:
    """Check that packages of an extra are installed, before work is done that needs them.

    Raises:
        MissingExtraError: one is missing; the message says how to get it.
    """
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        raise MissingExtraError(f"this needs {', '.join(missing)}: {how_to_install(extra)}")
