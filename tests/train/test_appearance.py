import numpy as np
import pytest
from numpy.typing import NDArray

from nearfar.arrays import RGBPixels
from nearfar.train.appearance import taken


@pytest.mark.parametrize("pixels", [12, 64, 128])
def test_view_is_enlarged_or_reduced_to_the_side(pixels: int) -> None:
    view = np.random.default_rng(0).integers(0, 256, (pixels, pixels, 3), np.uint8)
    for seed in range(20):
        seen = taken(view, 64, np.random.default_rng(seed))
        assert seen.shape == (64, 64, 3)
        assert seen.dtype == np.uint8
        np.testing.assert_array_equal(seen, taken(view, 64, np.random.default_rng(seed)))


def test_view_stays_like_itself_more_than_like_another() -> None:
    rng = np.random.default_rng(1)
    views = [np.kron(rng.integers(0, 256, (8, 8, 3)), np.ones((8, 8, 1))) for _ in range(30)]
    pixels = [view.astype(np.uint8) for view in views]

    def pattern(view: RGBPixels) -> NDArray[np.float64]:
        grey = view.mean(axis=2)
        return np.asarray((grey - grey.mean()).ravel() / (grey.std() * len(grey) + 1e-6))

    seen = np.array([pattern(taken(view, 64, rng)) for view in pixels])
    likeness = seen @ np.array([pattern(view) for view in pixels]).T
    assert (likeness.argmax(axis=1) == np.arange(30)).mean() > 0.8
