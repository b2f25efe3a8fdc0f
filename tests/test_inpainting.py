import cv2
import numpy as np
import pytest

from ggcnn_net2net.errors import DatasetError
from ggcnn_net2net.inpainting import fill_missing


@pytest.fixture
def scene():
    """A curved surface with a step of 0.2 m through it, (48, 64) metres."""
    rows, columns = np.indices((48, 64), np.float32)
    return (0.8 + 2e-4 * (rows - 20) ** 2 + 1e-3 * columns + 0.2 * (columns > 30)).astype(np.float32)


def test_missing_pixels_are_filled_as_the_public_code_fills_them(scene):
    missing = np.zeros(scene.shape, bool)
    missing[10:16, 27:36] = missing[:3, :5] = missing[-1, -1] = True
    filled = fill_missing(np.where(missing, np.nan, scene), missing)
    np.testing.assert_array_equal(filled[~missing], scene[~missing])
    holed = np.where(missing, 0, scene)
    image = cv2.copyMakeBorder(holed / holed.max(), 1, 1, 1, 1, cv2.BORDER_DEFAULT)
    mask = (image == 0).astype(np.uint8)
    expected = cv2.inpaint(image, mask, 1, cv2.INPAINT_NS)[1:-1, 1:-1] * holed.max()
    np.testing.assert_allclose(filled, expected, atol=1e-6)
    assert np.abs(filled - scene)[missing].max() > 0.01  # so that other ways of filling would be told from this


def test_a_plane_goes_on_in_the_hole():
    rows, columns = np.indices((48, 64), np.float32)
    depth = 0.8 + 1e-3 * rows + 2e-3 * columns
    missing = np.zeros(depth.shape, bool)
    missing[20, 30] = True
    filled = fill_missing(np.where(missing, np.nan, depth), missing)
    assert filled[20, 30] == pytest.approx(depth[20, 30], abs=5e-4)


def test_nothing_to_fill_and_nothing_to_fill_from(scene):
    np.testing.assert_array_equal(fill_missing(scene, np.zeros(scene.shape, bool)), scene)
    with pytest.raises(DatasetError, match="every pixel"):
        fill_missing(scene, np.ones(scene.shape, bool))
