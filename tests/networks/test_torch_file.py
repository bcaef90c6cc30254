"""Files of PyTorch, of both formats: read as PyTorch wrote them, refused where they are not."""

import io
import os
import pickle
import struct
import zipfile
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nearfar.networks.torch_file import TensorFileError, read_torch_file

MAGIC = 0x1950A86A20F9469CFC6C


def zipped(pickled: bytes, **members: bytes) -> bytes:
    """A file of the newer format with a given pickle."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("archive/data.pkl", pickled)
        for name, content in members.items():
            archive.writestr(f"archive/{name}", content)
    return file.getvalue()


def legacy(pickled: bytes, values: bytes = b"") -> bytes:
    """A file of the older format with a given pickle and at most one storage, "0"."""
    system = {"protocol_version": 1001, "little_endian": True}
    head = b"".join(pickle.dumps(item, 2) for item in (MAGIC, 1001, system))
    return head + pickled + pickle.dumps(["0"] if values else [], 2) + values


FORMATS = pytest.mark.parametrize("wrapped", [zipped, legacy])


@pytest.fixture(params=[True, False], ids=["zip", "legacy"])
def saved(request: pytest.FixtureRequest) -> Callable[[Any], bytes]:
    """Writes an object with PyTorch, in the newer or the older format."""
    torch = pytest.importorskip("torch")

    def save(content: Any) -> bytes:
        file = io.BytesIO()
        torch.save(content, file, _use_new_zipfile_serialization=request.param)
        return file.getvalue()

    return save


def test_a_state_dict_is_read_back(saved: Callable[[Any], bytes]) -> None:
    torch = pytest.importorskip("torch")
    network = torch.nn.Sequential(torch.nn.Conv2d(3, 5, 3), torch.nn.BatchNorm2d(5))
    state = network.state_dict()
    found = read_torch_file(saved(state))
    assert list(found) == list(state)
    for name, tensor in state.items():
        np.testing.assert_array_equal(found[name], tensor.numpy())
        assert found[name].dtype == tensor.numpy().dtype


def test_views_share_a_storage_with_steps_and_offsets(saved: Callable[[Any], bytes]) -> None:
    torch = pytest.importorskip("torch")
    whole = torch.arange(24.0).reshape(4, 6)
    tensors = {
        "whole": whole,
        "turned": whole.T,
        "part": whole[1:, 2::2],
        "repeated": whole[0, :1].expand(3),
        "number": whole[2, 3],
        "empty": torch.zeros(0, 5),
        "parameter": torch.nn.Parameter(whole[:2]),
    }
    found = read_torch_file(saved(tensors))
    for name, tensor in tensors.items():
        np.testing.assert_array_equal(found[name], tensor.detach().numpy(), err_msg=name)


@pytest.mark.parametrize(
    "element", ["float64", "float32", "float16", "int64", "int32", "int16", "int8", "uint8", "bool"]
)
def test_element_types_are_kept(element: str, saved: Callable[[Any], bytes]) -> None:
    torch = pytest.importorskip("torch")
    tensor = torch.tensor([0, 1, 3, 100]).to(getattr(torch, element))
    found = read_torch_file(saved({"tensor": tensor}))["tensor"]
    assert found.dtype == np.dtype(element)
    np.testing.assert_array_equal(found, tensor.numpy())


def test_bfloat16_is_widened(saved: Callable[[Any], bytes]) -> None:
    torch = pytest.importorskip("torch")
    tensor = torch.randn(4, 5).to(torch.bfloat16)
    found = read_torch_file(saved({"tensor": tensor.T}))["tensor"]
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, tensor.T.float().numpy())


def test_the_state_dict_of_a_checkpoint_is_read(saved: Callable[[Any], bytes]) -> None:
    torch = pytest.importorskip("torch")
    checkpoint = {"epoch": 3, "state_dict": OrderedDict(a=torch.ones(2)), "optimizer": {"lr": 0.1}}
    assert list(read_torch_file(saved(checkpoint))) == ["a"]


def test_a_whole_module_is_refused(saved: Callable[[Any], bytes]) -> None:
    torch = pytest.importorskip("torch")
    with pytest.raises(TensorFileError, match=r"'torch\.nn\.modules\.linear\.Linear'"):
        read_torch_file(saved(torch.nn.Linear(2, 3)))


def test_truncated_files_are_refused(saved: Callable[[Any], bytes]) -> None:
    torch = pytest.importorskip("torch")
    data = saved({"a": torch.arange(50.0), "b": torch.ones(3)})
    for length in range(1, len(data), 7):
        with pytest.raises(TensorFileError):
            read_torch_file(data[:length])


def test_damaged_files_never_raise_anything_else(saved: Callable[[Any], bytes]) -> None:
    torch = pytest.importorskip("torch")
    data = saved({"a": torch.arange(50.0), "b": torch.ones(3).half()})
    rng = np.random.default_rng(0)
    for position in rng.integers(0, len(data), 500):
        damaged = bytearray(data)
        damaged[position] ^= 1 << rng.integers(8)
        try:
            tensors = read_torch_file(bytes(damaged))
        except TensorFileError:
            continue
        assert all(isinstance(tensor, np.ndarray) for tensor in tensors.values())


class Attack:
    """Pickled, it calls a function when a usual pickle reader loads it."""

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        self._call = function, arguments

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return self._call


@FORMATS
@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_a_pickled_command_is_refused_and_not_run(
    wrapped: Callable[[bytes], bytes], protocol: int, tmp_path: Path
) -> None:
    marker = tmp_path / "marker"
    pickled = pickle.dumps({"a": Attack(os.system, f"touch {marker}")}, protocol)
    with pytest.raises(TensorFileError, match=r"'(posix|nt)\.system'"):
        read_torch_file(wrapped(pickled))
    assert not marker.exists()
    pickle.loads(pickled)
    assert marker.exists()


@FORMATS
@pytest.mark.parametrize(
    "name",
    ["builtins\neval", "torch\nload", "torch.serialization\nload", "numpy\nload", "os\nsystem"],
)
def test_other_names_are_refused(wrapped: Callable[[bytes], bytes], name: str) -> None:
    call = b"c" + name.encode() + b"\n(S'1'\ntR."
    with pytest.raises(TensorFileError, match=name.replace("\n", r"\.")):
        read_torch_file(wrapped(call))


@FORMATS
@pytest.mark.parametrize(
    "state",
    [b"(dS'x'\nI1\ns", b"(N(dS'_function'\nI1\nst"],
    ids=["dictionary", "slots"],
)
def test_a_pickle_cannot_change_what_it_calls(
    wrapped: Callable[[bytes], bytes], state: bytes
) -> None:
    pickled = b"ctorch._utils\n_rebuild_tensor_v2\n" + state + b"b."
    with pytest.raises(TensorFileError, match="changes a function"):
        read_torch_file(wrapped(pickled))


def tensor_of(count: int, offset: int, shape: tuple[int, ...], strides: tuple[int, ...]) -> bytes:
    """A pickle of {"a": tensor} on the storage "0" of float32 values."""
    storage = f"((S'storage'\nctorch\nFloatStorage\nS'0'\nS'cpu'\nI{count}\ntQ"
    place = f"I{offset}\n" + pickle_numbers(shape) + pickle_numbers(strides)
    call = f"ctorch._utils\n_rebuild_tensor_v2\n{storage}{place}tR"
    return f"(dS'a'\n{call}s.".encode()


def pickle_numbers(values: tuple[int, ...]) -> str:
    return "(" + "".join(f"I{value}\n" for value in values) + "t"


SIX = np.arange(6, dtype="<f4").tobytes()


def with_values(wrapped: Callable[..., bytes], pickled: bytes) -> bytes:
    if wrapped is zipped:
        return zipped(pickled, **{"data/0": SIX})
    return legacy(pickled, struct.pack("<q", 6) + SIX)


@FORMATS
def test_a_tensor_is_read_without_pytorch(wrapped: Callable[..., bytes]) -> None:
    found = read_torch_file(with_values(wrapped, tensor_of(6, 1, (2, 2), (2, 1))))
    np.testing.assert_array_equal(found["a"], [[1, 2], [3, 4]])


@FORMATS
@pytest.mark.parametrize(
    ("offset", "shape", "strides"),
    [
        (0, (7,), (1,)),
        (1, (6,), (1,)),
        (-1, (2,), (1,)),
        (5, (3,), (-1000,)),
        (0, (2,), (1 << 40,)),
        (0, (1 << 40, 1 << 40), (0, 0)),
        (0, (-3,), (1,)),
        (0, (2, 2), (1,)),
    ],
)
def test_a_tensor_outside_its_storage_is_refused(
    wrapped: Callable[..., bytes], offset: int, shape: tuple[int, ...], strides: tuple[int, ...]
) -> None:
    with pytest.raises(TensorFileError, match="damaged"):
        read_torch_file(with_values(wrapped, tensor_of(6, offset, shape, strides)))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (zipped(b"N."), "no table"),
        (legacy(b"N."), "no table"),
        (zipped(b"(d.", byteorder=b"big"), "big-endian"),
        (pickle.dumps({"a": 1}), "not of PyTorch"),
        (zipped(b"")[:10], "damaged"),
        (legacy(tensor_of(6, 0, (6,), (1,)), struct.pack("<q", -5) + SIX), "incomplete"),
        (legacy(tensor_of(6, 0, (6,), (1,)), struct.pack("<q", 1 << 60) + SIX), "incomplete"),
        (zipped(b"(S'module'\nNNNtQ."), "not a tensor's storage"),
    ],
)
def test_other_content_is_refused(data: bytes, message: str) -> None:
    with pytest.raises(TensorFileError, match=message):
        read_torch_file(data)


def test_a_compressed_archive_cannot_fill_the_memory() -> None:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data.pkl", b"N." + bytes(1 << 20))
    with pytest.raises(TensorFileError, match="compressed"):
        read_torch_file(file.getvalue())
