"""What a person may choose for a job: matchers and devices, and what is missing for the others."""

import shutil
import sys
from dataclasses import dataclass
from typing import Literal, get_args

from nearfar.errors import NearfarError
from nearfar.features import MATCHERS
from nearfar.settings import Settings

MatcherName = Literal[
    "sift",
    "aliked-lightglue",
    "aliked-lightglue-onnx",
    "disk-lightglue",
    "xfeat",
    "xfeat-lighterglue",
]
"""Matchers that a request may name. Other names are refused, since a name can name code to run."""
Device = Literal["auto", "cpu", "cuda", "mps"]


@dataclass(frozen=True)
class Choice:
    """Something that may be chosen.

    Attributes:
        name: as a request names it.
        missing: what to install first; None where nothing is missing.
    """

    name: str
    missing: str | None


def matchers() -> tuple[Choice, ...]:
    """Return all matchers, each with what is missing for it."""
    return tuple(Choice(name, _missing(name)) for name in get_args(MatcherName))


def devices() -> tuple[str, ...]:
    """Return the devices that this machine may have, without loading torch."""
    cuda = ["cuda"] if shutil.which("nvidia-smi") else []
    mps = ["mps"] if sys.platform == "darwin" else []
    return ("auto", "cpu", *cuda, *mps)


def _missing(name: str) -> str | None:
    try:
        MATCHERS.create(name, Settings(matcher=name))
    except NearfarError as error:
        return str(error)
    return None
