import numpy as np
import pytest

from ggcnn_net2net.errors import DatasetError
from ggcnn_net2net.inpainting import fill_missing


def tilted_plane(shape):
    rows, columns = np.indices(shape, np.float32)
    return 0.8 + 1e-4 * rows + 2e-4 * columns


def test_missing_pixels_are_filled_from_around_them():
    depth = tilted_plane((480, 640))
    missing = np.zeros(depth.shape, bool)
    missing[100:110, 200:212] = missing[:3, :5] = missing[-1, -1] = True
    filled = fill_missing(np.where(missing, np.nan, depth), missing)
    np.testing.assert_array_equal(filled[~missing], depth[~missing])
    np.testing.assert_allclose(filled[missing], depth[missing], atol=0.004)


def test_nothing_to_fill_and_nothing_to_fill_from():
    depth = tilted_plane((20, 30))
    np.testing.assert_array_equal(fill_missing(depth, np.zeros(depth.shape, bool)), depth)
    with pytest.raises(DatasetError, match="every pixel"):
        fill_missing(depth, np.ones(depth.shape, bool))
