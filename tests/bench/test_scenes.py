"""Pairs of one scene have names in common."""

import pytest

from nearfar.bench.datasets.cases import scene


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("oxford/graf_1_2", "graf"),
        ("evd/graf", "graf"),
        ("graf/1_2", "graf"),
        ("graf/1_10", "graf"),
        ("homogr/LePoint1", "LePoint1"),
        ("copr/IMG_0046", "IMG_0046"),
        ("alone", "alone"),
    ],
)
def test_scene(name: str, expected: str) -> None:
    assert scene(name) == expected
