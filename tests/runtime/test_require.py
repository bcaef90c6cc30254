"""A missing extra is named before any work is done."""

import pytest

from nearfar.errors import MissingExtraError
from nearfar.runtime import require


def test_a_missing_package_says_how_to_get_it() -> None:
    require("bench", "numpy")
    with pytest.raises(MissingExtraError, match=r"no_such_package: pip install 'nearfar\[bench\]'"):
        require("bench", "numpy", "no_such_package")
