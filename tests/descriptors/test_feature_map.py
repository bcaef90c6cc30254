"""Where the cells of a feature map lie."""

import numpy as np

from nearfar.features.feature_map import FeatureMap


def test_centres_of_cells_row_by_row() -> None:
    found = FeatureMap(np.zeros((2, 3, 5), np.float32), stride=8, offset=3.5)
    expected = [[3.5, 3.5], [11.5, 3.5], [19.5, 3.5], [3.5, 11.5], [11.5, 11.5], [19.5, 11.5]]
    np.testing.assert_array_equal(found.centres, expected)
