from collections.abc import Callable

import cv2
import numpy as np
import pytest

from nearfar.arrays import RGBPixels
from nearfar.train.conditions import CONDITIONS


@pytest.mark.parametrize("condition", CONDITIONS, ids=lambda condition: condition.__name__)
def test_a_condition_changes_values_as_its_seed_says(
    condition: Callable[..., np.ndarray], photograph: Callable[[str], RGBPixels]
) -> None:
    image = cv2.resize(photograph("coffee"), (96, 64)).astype(np.float32)
    for seed in range(5):
        changed = condition(image, np.random.default_rng(seed))
        assert changed.shape == image.shape
        assert np.isfinite(changed).all()
        np.testing.assert_array_equal(changed, condition(image, np.random.default_rng(seed)))
        assert abs(changed - image).mean() > 2
