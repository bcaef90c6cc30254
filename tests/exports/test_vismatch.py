"""The result that vismatch promises of a matcher, whatever form the images have."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as PillowImage

from nearfar import ImageError
from nearfar.adapters.vismatch import MatcherResult, NearfarMatcher
from tests.conftest import KnownPair

KEYS = {
    "num_inliers", "H", "all_kpts0", "all_kpts1", "all_desc0", "all_desc1", "matched_kpts0",
    "matched_kpts1", "inlier_kpts0", "inlier_kpts1", "matched_confidences",
}  # fmt: skip
"""Of `BaseMatcher.forward` in vismatch 1.4."""


def assert_keeps_the_contract(result: MatcherResult) -> None:
    assert set(result) == KEYS
    for name in KEYS - {"num_inliers", "H", "matched_confidences"}:
        array = np.asarray(result[name])  # type: ignore[literal-required]
        assert (array.ndim, array.shape[1]) == (2, 2)
    assert result["matched_kpts0"].shape == result["matched_kpts1"].shape
    assert len(result["inlier_kpts0"]) == len(result["inlier_kpts1"]) == result["num_inliers"]


def test_all_forms_of_images(known_files: tuple[Path, Path], known_pair: KnownPair) -> None:
    matcher = NearfarMatcher(method="sift")
    far, near = known_files
    planes = [
        (image / 255).astype(np.float32).transpose(2, 0, 1)
        for image in (known_pair.near, known_pair.far)
    ]
    results = [
        matcher(near, str(far)),
        matcher(PillowImage.open(near), PillowImage.open(far)),
        matcher(*planes),
    ]
    for result in results:
        assert_keeps_the_contract(result)
        assert result["H"] is not None
        assert known_pair.error(result["H"]) < 1
        np.testing.assert_array_equal(result["matched_kpts0"], results[0]["matched_kpts0"])


@pytest.mark.parametrize("mode", ["I;16", "I;16B", "I"])
def test_grey_values_of_16_bits(known_pair: KnownPair, mode: str) -> None:
    """Pillow cuts them at 255 where it converts them to RGB, which leaves white."""
    images = []
    for pixels in (known_pair.near, known_pair.far):
        deep = pixels[..., 1].astype(np.uint16) * 257
        if mode == "I;16B":
            size = deep.shape[1], deep.shape[0]
            images.append(PillowImage.frombytes(mode, size, deep.astype(">u2").tobytes()))
        else:
            images.append(PillowImage.fromarray(deep if mode == "I;16" else deep.astype(np.int32)))
        assert images[-1].mode == mode
    result = NearfarMatcher(method="sift")(*images)
    assert_keeps_the_contract(result)
    assert result["H"] is not None
    assert known_pair.error(result["H"]) < 1


def test_pil_images_of_32_bits_are_refused() -> None:
    matcher = NearfarMatcher(method="sift")
    for values in (
        np.full((60, 80), 70_000, np.int32),
        np.full((60, 80), -1, np.int32),
        np.zeros((60, 80), np.float32),
    ):
        image = PillowImage.fromarray(values)
        with pytest.raises(ImageError, match="a matcher's image has pixels of 32 bits"):
            matcher(image, image)


def test_tensors(known_pair: KnownPair) -> None:
    torch = pytest.importorskip("torch")
    images = [
        torch.from_numpy(image).permute(2, 0, 1) / 255
        for image in (known_pair.near, known_pair.far)
    ]
    result = NearfarMatcher(method="sift")(*images)
    assert_keeps_the_contract(result)
    assert result["H"] is not None
    assert known_pair.error(result["H"]) < 1


def test_nothing_found() -> None:
    blank = np.zeros((3, 60, 80), np.float32)
    result = NearfarMatcher(method="sift")(blank, blank)
    assert_keeps_the_contract(result)
    assert result["H"] is None
    assert result["num_inliers"] == 0


def test_other_arrays_are_refused() -> None:
    matcher = NearfarMatcher(method="sift")
    for image in (np.zeros((60, 80, 3), np.uint8), np.full((3, 60, 80), 200.0), np.zeros((3, 0))):
        with pytest.raises(ImageError, match="values from 0 to 1"):
            matcher(image, image)
