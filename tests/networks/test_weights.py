"""Tensors of weights files are read; what is damaged is refused with one sentence."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from safetensors.numpy import save, save_file

from nearfar.errors import WeightsError
from nearfar.networks.weights import read_weights

TENSORS: dict[str, NDArray[Any]] = {
    "a": np.arange(6, dtype=np.float32).reshape(2, 3),
    "b": np.array([1, 2], np.int64),
}


def safetensors_with(header: bytes, values: bytes) -> bytes:
    return len(header).to_bytes(8, "little") + header + values


class TestReading:
    @pytest.mark.parametrize("name", ["weights.safetensors", "weights.pth", "weights"])
    def test_the_content_tells_the_format(self, name: str, tmp_path: Path) -> None:
        save_file(TENSORS, tmp_path / name)
        found = read_weights(tmp_path / name)
        assert set(found) == set(TENSORS)
        for key, values in TENSORS.items():
            np.testing.assert_array_equal(found[key], values)
            assert found[key].dtype == values.dtype

    @pytest.mark.parametrize("new_format", [True, False])
    def test_files_of_pytorch_are_read(self, new_format: bool, tmp_path: Path) -> None:
        torch = pytest.importorskip("torch")
        path = tmp_path / "misnamed.safetensors"
        tensors = {name: torch.from_numpy(values) for name, values in TENSORS.items()}
        torch.save(tensors, path, _use_new_zipfile_serialization=new_format)
        np.testing.assert_array_equal(read_weights(path)["a"], TENSORS["a"])

    def test_bfloat16_is_widened(self, tmp_path: Path) -> None:
        header = b'{"a":{"dtype":"BF16","shape":[2],"data_offsets":[0,4]}}'
        content = safetensors_with(header, b"\x80\x3f\x20\xc1")
        (tmp_path / "half.safetensors").write_bytes(content)
        found = read_weights(tmp_path / "half.safetensors")["a"]
        assert found.dtype == np.float32
        np.testing.assert_array_equal(found, [1, -10])

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            (b"", "neither"),
            (b"<!DOCTYPE html><html>404</html>", "neither"),
            (b"\x80\x02garbage", "damaged or incomplete"),
            (b"PK\x03\x04garbage", "damaged or incomplete"),
            (save(TENSORS)[:-1], "damaged or incomplete"),
            (save(TENSORS)[:40], "damaged or incomplete"),
            (save({}), "no tensors"),
            (
                safetensors_with(
                    b'{"a":{"dtype":"F8_E4M3","shape":[4],"data_offsets":[0,4]}}', bytes(4)
                ),
                "values of the type F8_E4M3, which is not supported",
            ),
        ],
    )
    def test_other_files_are_refused(self, content: bytes, message: str, tmp_path: Path) -> None:
        path = tmp_path / "weights.pth"
        path.write_bytes(content)
        with pytest.raises(WeightsError, match=message) as raised:
            read_weights(path)
        assert str(path) in str(raised.value)
        assert "\n" not in str(raised.value)

    def test_a_missing_file_or_a_folder_is_refused(self, tmp_path: Path) -> None:
        for path in (tmp_path / "none.pth", tmp_path):
            with pytest.raises(WeightsError, match="cannot read the weights file"):
                read_weights(path)
