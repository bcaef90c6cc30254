"""Reads weights files of PyTorch without PyTorch, and without executing what is pickled in them."""

import functools
import io
import pickle
import struct
import zipfile
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

BFLOAT16 = "BF16"


class TensorFileError(ValueError):
    """The file cannot be read. The message continues a sentence that starts with its name."""


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
"""NumPy types by the names of safetensors. NumPy has no bfloat16, whose 16 bits are an integer."""


def array_on(
    data: bytes | bytearray | memoryview,
    element: str,
    shape: Sequence[int],
    strides: Sequence[int] | None = None,
    offset: int = 0,
) -> NDArray[Any]:
    """Return a tensor on raw little-endian bytes, without a copy; bfloat16 is widened to float32.

    Args:
        data: the bytes.
        element: safetensors name of the element type.
        shape: size of each axis.
        strides: step along each axis, in elements; None is the order of C.
        offset: index of the first element.

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


ZIP_START = b"PK\x03\x04"
LEGACY_START = b"\x80"
"""First bytes of a zip archive, and of a pickle. Older files of PyTorch are several pickles."""

_LEGACY_MAGIC = 0x1950A86A20F9469CFC6C

_STORAGES = {
    "DoubleStorage": "F64",
    "FloatStorage": "F32",
    "HalfStorage": "F16",
    "BFloat16Storage": BFLOAT16,
    "LongStorage": "I64",
    "IntStorage": "I32",
    "ShortStorage": "I16",
    "CharStorage": "I8",
    "ByteStorage": "U8",
    "BoolStorage": "BOOL",
}


class _StorageType(NamedTuple):
    element: str


class _Storage(NamedTuple):
    key: str
    element: str


class _Tensor(NamedTuple):
    storage: _Storage
    offset: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]


class _Table(dict[Any, Any]):
    """Stands in for OrderedDict."""

    def __setstate__(self, state: object) -> None:
        """Ignore attributes, such as the `_metadata` of a state dict."""


class _StandIn:
    """A function that a pickle can call but not change."""

    __slots__ = ("_function",)

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def __call__(self, *arguments: Any) -> Any:
        return self._function(*arguments)

    def __setstate__(self, state: object) -> None:
        raise TensorFileError("changes a function, which no weights file needs: refused")


def _tensor(
    storage: _Storage, offset: int, shape: tuple[int, ...], strides: tuple[int, ...], *_: object
) -> _Tensor:
    return _Tensor(storage, offset, shape, strides)


def _parameter(tensor: _Tensor, *_: object) -> _Tensor:
    return tensor


_CALLABLES: dict[tuple[str, str], Callable[..., Any]] = {
    ("collections", "OrderedDict"): _Table,
    ("torch._utils", "_rebuild_tensor"): _tensor,
    ("torch._utils", "_rebuild_tensor_v2"): _tensor,
    ("torch._utils", "_rebuild_parameter"): _parameter,
}


class _Unpickler(pickle.Unpickler):
    """Resolves the names and ids of tensors, and refuses everything else."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, encoding="utf-8")
        self.storages: dict[str, _Storage] = {}

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) in _CALLABLES:
            return _StandIn(_CALLABLES[module, name])
        if module in ("torch", "torch.cuda") and name in _STORAGES:
            return _StorageType(_STORAGES[name])
        raise TensorFileError(f"asks for {f'{module}.{name}'!r}, which no weights need: refused")

    def persistent_load(self, pid: Any) -> _Storage:
        match pid:
            case ("storage", _StorageType(element), str(key), _, int(), *views):
                if any(view is not None for view in views):
                    raise TensorFileError("shares one storage between tensors in an outdated way")
                return self.storages.setdefault(key, _Storage(key, element))
        raise TensorFileError("refers to something that is not a tensor's storage")


def read_torch_file(data: bytes) -> dict[str, NDArray[Any]]:
    """Return the tensors of a state dict, or of a checkpoint with a "state_dict".

    Args:
        data: content of the file, in the zip format or the older one.

    Returns:
        Read-only arrays by name; other values of the table are left out.

    Raises:
        TensorFileError: the file is damaged, has another format, or needs more than tensors.
    """
    try:
        return _read(data)
    except TensorFileError:
        raise
    except Exception as error:  # A damaged pickle can raise almost any error.
        raise TensorFileError("is damaged or incomplete") from error


def _read(data: bytes) -> dict[str, NDArray[Any]]:
    table, values_of = _open_zip(data) if data.startswith(ZIP_START) else _open_legacy(data)
    if not isinstance(table, dict):
        raise TensorFileError("holds no table of tensors")
    tensors = table.get("state_dict", table)
    return {
        name: array_on(
            values_of(tensor.storage),
            tensor.storage.element,
            tensor.shape,
            tensor.strides,
            tensor.offset,
        )
        for name, tensor in tensors.items()
        if isinstance(name, str) and isinstance(tensor, _Tensor)
    }


ValuesOf = Callable[[_Storage], bytes | memoryview]
"""Returns the raw values of a storage."""


def _open_zip(data: bytes) -> tuple[Any, ValuesOf]:
    """Return the pickled object and the storages of a file of PyTorch 1.6 or newer."""
    archive = zipfile.ZipFile(io.BytesIO(data))

    def member(name: str) -> bytes:
        if archive.getinfo(name).file_size > len(data):
            raise TensorFileError("is compressed, which PyTorch never does: refused")
        return archive.read(name)

    @functools.cache
    def values_of(storage: _Storage) -> bytes:
        return member(f"{folder}data/{storage.key}")

    names = archive.namelist()
    folder = next((name[: -len("data.pkl")] for name in names if name.endswith("/data.pkl")), None)
    if folder is None:
        raise TensorFileError("is a zip archive without weights of PyTorch")
    if f"{folder}byteorder" in names and member(f"{folder}byteorder") != b"little":
        raise TensorFileError("was written on a big-endian machine, which is not supported")
    return _Unpickler(io.BytesIO(member(f"{folder}data.pkl"))).load(), values_of


def _open_legacy(data: bytes) -> tuple[Any, ValuesOf]:
    """Return the pickled object and the storages of a file older than PyTorch 1.6."""
    file = io.BytesIO(data)
    if _Unpickler(file).load() != _LEGACY_MAGIC:
        raise TensorFileError("is a pickle but not of PyTorch")
    _protocol, system = _Unpickler(file).load(), _Unpickler(file).load()
    if not system["little_endian"]:
        raise TensorFileError("was written on a big-endian machine, which is not supported")
    unpickler = _Unpickler(file)
    table = unpickler.load()
    keys = _Unpickler(file).load()
    values: dict[_Storage, memoryview] = {}
    position = file.tell()
    for key in keys:
        storage = unpickler.storages[key]
        (count,) = struct.unpack_from("<q", data, position)
        start = position + struct.calcsize("<q")
        position = start + count * ELEMENTS[storage.element].itemsize
        if not start <= position <= len(data):
            raise TensorFileError("is incomplete")
        values[storage] = memoryview(data)[start:position]
    return table, values.__getitem__
