"""Typed arrays on raw bytes, as weights files store them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

BFLOAT16 = "BF16"


class TensorFileError(ValueError):
    """The file cannot be read; the message continues a sentence that begins with its name."""


ELEMENTS: dict[str, np.dtype[Any]] = {
    "F64": np.dtype("<f8"),
    "F32": np.dtype("<f4"),
    "F16": np.dtype("<f2"),
    BFLOAT16: np.dtype("<u2"),
    "I64": np.dtype("<i8"),
    "I32": np.dtype("<i4"),
    "I16": np.dtype("<i2"),
    "I8": np.dtype("i1"),
    "U8": np.dtype("u1"),
    "BOOL": np.dtype("?"),
}
"""Element types by their safetensors names; bfloat16, which numpy lacks, as its 16 bits."""


def array_on(
    data: bytes | bytearray | memoryview,
    element: str,
    shape: Sequence[int],
    strides: Sequence[int] | None = None,
    offset: int = 0,
) -> NDArray[Any]:
    """A tensor on raw little-endian bytes, without copying; bfloat16 is widened to float32.

    Args:
        data: the bytes.
        element: name of the element type.
        shape: size of each axis.
        strides: step along each axis in elements; where None, as in C.
        offset: first element.

    Raises:
        TensorFileError: the element type is not one of `ELEMENTS`.
        ValueError: the tensor does not fit into the bytes.
    """
    if element not in ELEMENTS:
        raise TensorFileError(f"has values of the type {element}, which is not supported")
    dtype = ELEMENTS[element]
    steps = None if strides is None else [step * dtype.itemsize for step in strides]
    array: NDArray[Any] = np.ndarray(shape, dtype, data, offset * dtype.itemsize, steps)
    if element == BFLOAT16:
        return (array.astype(np.uint32) << 16).view(np.float32)
    return array
