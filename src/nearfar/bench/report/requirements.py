"""What a report needs beyond the plain package."""

import importlib.util

from nearfar.errors import NearfarError

_PACKAGES = ("jinja2", "matplotlib", "pyarrow")


class ReportError(NearfarError):
    """There are no results to report, or a package that a report needs is missing."""


def require_packages() -> None:
    """Check that the optional dependencies are there.

    Raises:
        ReportError: one is missing.
    """
    missing = [name for name in _PACKAGES if importlib.util.find_spec(name) is None]
    if missing:
        raise ReportError(f"a report needs {', '.join(missing)}: pip install 'nearfar[report]'")
