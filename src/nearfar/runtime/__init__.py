"""Where and how work is done: workers, a cluster, time, logs, and packages of extras."""

import importlib.util

from nearfar.errors import MissingExtraError


def require(extra: str, *packages: str) -> None:
    """Check that packages of an extra are installed, before work is done that needs them.

    Raises:
        MissingExtraError: one is missing; the message says how to get it.
    """
    missing = [name for name in packages if importlib.util.find_spec(name) is None]
    if missing:
        raise MissingExtraError(f"this needs {', '.join(missing)}: pip install 'nearfar[{extra}]'")
