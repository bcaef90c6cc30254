"""Reads the tensors of weights files."""

from pathlib import Path
from typing import Any

import safetensors
from numpy.typing import NDArray

from nearfar.errors import WeightsError
from nearfar.networks.torch_file import (
    LEGACY_START,
    ZIP_START,
    TensorFileError,
    array_on,
    read_torch_file,
)


def read_weights(path: Path) -> dict[str, NDArray[Any]]:
    """Return the tensors of a .safetensors or PyTorch file; its first bytes tell which it is.

    Nothing that is pickled in a file is executed.

    Args:
        path: the file.

    Returns:
        Arrays by name, in the element types of the file (bfloat16 as float32); they may be
        read-only.

    Raises:
        WeightsError: the file is missing or damaged, holds no tensors, or needs more than tensors.
    """
    try:
        with path.open("rb") as file:
            start = file.read(9)
            file.seek(0)
            if start[8:] == b"{":
                tensors = _read_safetensors(file.read())
            elif start.startswith((ZIP_START, LEGACY_START)):
                tensors = read_torch_file(file.read())
            else:
                raise WeightsError(f"{path} is neither a safetensors nor a PyTorch weights file")
    except OSError as error:
        raise WeightsError(f"cannot read the weights file {path}: {error.strerror}") from error
    except TensorFileError as error:
        raise WeightsError(f"{path} {error}") from error
    except safetensors.SafetensorError as error:
        raise WeightsError(f"{path} is damaged or incomplete ({error})") from error
    if not tensors:
        raise WeightsError(f"{path} holds no tensors")
    return tensors


def _read_safetensors(data: bytes) -> dict[str, NDArray[Any]]:
    entries = safetensors.deserialize(data)  # type: ignore[no-untyped-call]
    return {
        name: array_on(entry["data"], entry["dtype"], entry["shape"]) for name, entry in entries
    }
