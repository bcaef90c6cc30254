"""The matcher of COLMAP's ONNX files, tried with small networks of the same form."""

from pathlib import Path

import numpy as np
import onnx
import onnx.parser
import pytest

from nearfar import Localizer
from nearfar.errors import SettingsError, WeightsError
from nearfar.runtime import weight_files

GRID = """
<ir_version: 9, opset_import: ["": 20]>
grid (float[1, 3, H, W] image, int64 max_keypoints, float min_score)
    => (float[1, K, 2] keypoints, float[1, K, D] descriptors, float[1, K] scores)
{
    cells = SpaceToDepth<blocksize = 16>(image)
    flat_shape = Constant<value_ints = [1, 768, -1]>()
    flat = Reshape(cells, flat_shape)
    rows = Transpose<perm = [0, 2, 1]>(flat)
    channels = Constant<value_ints = [2]>()
    mean = ReduceMean(rows, channels)
    centred = Sub(rows, mean)
    descriptors = LpNormalization<axis = -1, p = 2>(centred)
    shape = Shape(cells)
    zero = Constant<value_int = 0>()
    one = Constant<value_int = 1>()
    two = Constant<value_int = 2>()
    three = Constant<value_int = 3>()
    h = Gather(shape, two)
    w = Gather(shape, three)
    count = Mul(h, w)
    every = Range(zero, count, one)
    column = Mod(every, w)
    row = Div(every, w)
    side = Constant<value_float = 16.0>()
    middle = Constant<value_float = 7.5>()
    sizes = Shape(image)
    height_int = Gather(sizes, two)
    width_int = Gather(sizes, three)
    height = Cast<to = 1>(height_int)
    width = Cast<to = 1>(width_int)
    unit = Constant<value_float = 1.0>()
    double = Constant<value_float = 2.0>()
    last_x = Sub(width, unit)
    last_y = Sub(height, unit)
    column_float = Cast<to = 1>(column)
    row_float = Cast<to = 1>(row)
    left = Mul(column_float, side)
    top = Mul(row_float, side)
    x = Add(left, middle)
    y = Add(top, middle)
    x_share = Div(x, last_x)
    y_share = Div(y, last_y)
    x_double = Mul(x_share, double)
    y_double = Mul(y_share, double)
    x_unit = Sub(x_double, unit)
    y_unit = Sub(y_double, unit)
    first = Constant<value_ints = [0, 2]>()
    x_column = Unsqueeze(x_unit, first)
    y_column = Unsqueeze(y_unit, first)
    keypoints = Concat<axis = 2>(x_column, y_column)
    scores = ReduceMax<keepdims = 0>(descriptors, channels)
}
"""
"""Points in the middle of cells of 16 x 16 pixels, described by these pixels."""
MUTUAL = """
<ir_version: 9, opset_import: ["": 20]>
mutual (float[1, N, 2] kpts0, float[1, M, 2] kpts1, float[1, N, D] desc0, float[1, M, D] desc1,
        float[1, 2] image_size0, float[1, 2] image_size1)
    => (int64[N] matches0, float[N] mscores0)
{
    turned = Transpose<perm = [0, 2, 1]>(desc1)
    products = MatMul(desc0, turned)
    batch = Constant<value_ints = [0]>()
    cosine = Squeeze(products, batch)
    nearest = ArgMax<axis = 1, keepdims = 0>(cosine)
    back = ArgMax<axis = 0, keepdims = 0>(cosine)
    returned = Gather(back, nearest)
    zero = Constant<value_int = 0>()
    one = Constant<value_int = 1>()
    sizes = Shape(nearest)
    count = Gather(sizes, zero)
    every = Range(zero, count, one)
    same = Equal(returned, every)
    none = Constant<value_int = -1>()
    matches0 = Where(same, nearest, none)
    axis = Constant<value_ints = [1]>()
    mscores0 = ReduceMax<keepdims = 0>(cosine, axis)
}
"""
"""Mutual nearest neighbours."""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The two files."""
    folder = tmp_path_factory.mktemp("onnx")
    found = {"aliked-onnx": GRID, "aliked-lightglue-onnx": MUTUAL}
    for name, text in found.items():
        onnx.save(onnx.parser.parse_model(text), folder / f"{name}.onnx")
    return {name: folder / f"{name}.onnx" for name in found}


def test_points_and_matches_are_in_pixels_of_the_images(files: dict[str, Path]) -> None:
    far = np.random.default_rng(0).integers(0, 256, (256, 320, 3), np.uint8)
    near = far[32:192, 48:240]
    found = Localizer(method="aliked-lightglue-onnx", weights=files).localize(far, near)
    np.testing.assert_allclose(found.points.far - found.points.near, [[48, 32]] * 120, atol=1e-3)
    model = np.asarray(found.far_from_near)
    np.testing.assert_allclose(model, [[1, 0, 48], [0, 1, 32], [0, 0, 1]], atol=1e-3)


def test_missing_and_other_files_are_refused(
    files: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NEARFAR_CACHE", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    with pytest.raises(WeightsError, match="run `nearfar weights fetch aliked-lightglue-onnx`"):
        Localizer(method="aliked-lightglue-onnx")
    exchanged = {"aliked-onnx": files["aliked-lightglue-onnx"]}
    localizer = Localizer(method="aliked-lightglue-onnx", weights=files | exchanged)
    image = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    with pytest.raises(WeightsError, match="is no aliked-onnx as COLMAP 4 reads it"):
        localizer.localize(image, image)


def test_a_device_that_is_not_there_is_refused(files: dict[str, Path]) -> None:
    localizer = Localizer(method="aliked-lightglue-onnx", weights=files, device="mps")
    image = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    with pytest.raises(SettingsError, match="does not run on 'mps': choose --device cpu"):
        localizer.localize(image, image)


def test_the_download_of_colmap_serves_as_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NEARFAR_CACHE", str(tmp_path / "own"))
    monkeypatch.setenv("HOME", str(tmp_path))
    folder = tmp_path / ".cache/colmap"
    folder.mkdir(parents=True)
    for network in weight_files.NEEDED["aliked-lightglue-onnx"]:
        address, _, digest = weight_files.DOWNLOADS[network].partition("#sha256=")
        (folder / f"{digest}-{address.rpartition('/')[2]}").touch()
    Localizer(method="aliked-lightglue-onnx")
