"""A consumer like the public ROS node for the Kinova arm, with Keras 2, against `GraspPredictor` with its preset."""

import cv2
import numpy as np
import pytest
import tf_keras
from scipy import ndimage

from ggcnn_net2net import GraspPredictor, Intrinsics
from ggcnn_net2net.model_files import published_weights

K = [575.8, 0.0, 314.5, 0.0, 575.8, 235.5, 0.0, 0.0, 1.0]
SCENES = (100, 104, 109, 117, 126, 140)


class KinovaNode:
    """What the node does in open loop with an image in metres, NaN where nothing was measured."""

    def __init__(self, file):
        self.model = tf_keras.models.load_model(file, compile=False)

    def __call__(self, depth):
        crop = 400
        top, left = (480 - crop) // 2, (640 - crop) // 2
        seen = cv2.resize(depth[top : top + crop, left : left + crop], (300, 300))
        gone = np.isnan(seen)
        seen[gone] = 0
        seen = cv2.copyMakeBorder(seen, 1, 1, 1, 1, cv2.BORDER_DEFAULT)
        scale = np.abs(seen).max()
        seen = cv2.inpaint(seen.astype(np.float32) / scale, (seen == 0).astype(np.uint8), 1, cv2.INPAINT_NS)
        seen = seen[1:-1, 1:-1] * scale
        seen = np.clip(seen - seen.mean(), -1, 1)
        points, cos, sin, width = (out.squeeze() for out in self.model.predict(seen.reshape(1, 300, 300, 1), verbose=0))
        points[gone] = 0
        angle = ndimage.gaussian_filter(np.arctan2(sin, cos) / 2.0, 2.0)
        points = ndimage.gaussian_filter(points, 5.0)
        best = np.array(np.unravel_index(np.argmax(points), points.shape))
        row, col = np.round(best / 300.0 * crop + np.array([top, left])).astype(int)
        z = depth[row, col]
        x, y = (col - K[2]) / K[0] * z, (row - K[5]) / K[4] * z
        return best, (row, col), (x, y, z), angle[tuple(best)], width[tuple(best)] * 150.0, points.max()


@pytest.fixture(scope="module")
def node(data_root):
    return KinovaNode(published_weights())


@pytest.fixture(scope="module")
def predictor(data_root):
    return GraspPredictor("published", preset="kinova")


def scene_depth(data_root, number, holes):
    depth = cv2.imread(str(data_root / "cornell" / "01" / f"pcd{number:04d}d.tiff"), cv2.IMREAD_UNCHANGED)
    if holes:  # shadows and speckle, as structured light leaves them
        random = np.random.default_rng(number)
        seeds = (random.random(depth.shape) > 0.9995).astype(np.uint8)
        depth[cv2.dilate(seeds, np.ones((9, 5))) > 0] = np.nan
        depth[:, :130] = np.nan
    return depth


@pytest.mark.parametrize("holes", [False, True])
@pytest.mark.parametrize("number", SCENES)
def test_the_same_grasp(node, predictor, data_root, number, holes):
    depth = scene_depth(data_root, number, holes)
    best, pixel, position, angle, width, quality = node(depth.copy())
    (grasp,) = predictor.predict(depth, camera=K)
    seen = (np.array([grasp.row - 40, grasp.col - 120]) + 0.5) * 300 / 400 - 0.5
    np.testing.assert_allclose(seen, best, atol=1e-9)  # the same pixel of the network's image
    assert grasp.angle == pytest.approx(angle, abs=1e-4)
    assert grasp.width_px == pytest.approx(width * 400 / 300, abs=1e-2)
    assert grasp.quality == pytest.approx(quality, abs=1e-5)
    # The node rounds to whole pixels, and counts them from their corners: 1/6 px.
    assert np.abs(np.subtract((grasp.row, grasp.col), pixel)).max() <= 0.5 + 1 / 6 + 1e-9
    if np.isfinite(position).all() and grasp.measured:
        nearby = depth[pixel[0] - 1 : pixel[0] + 2, pixel[1] - 1 : pixel[1] + 2]
        step = np.nanmax(nearby) - np.nanmin(nearby) + 1e-6
        np.testing.assert_allclose(grasp.position, position, atol=2 * step + 2 / 3 / K[0] * position[2])
    assert grasp.opening == pytest.approx(width * 400 / 300 * grasp.position[2] / K[0], rel=1e-3)


def test_millimetres_are_the_same_scene(predictor, data_root):
    depth = scene_depth(data_root, SCENES[0], holes=True)
    camera = Intrinsics(K[0], K[4], K[2], K[5])
    (metres,) = predictor.predict(depth, camera)
    (millimetres,) = predictor.predict(np.nan_to_num(depth * 1000).round().astype(np.uint16), camera)
    assert np.hypot(metres.row - millimetres.row, metres.col - millimetres.col) < 5
    np.testing.assert_allclose(metres.position, millimetres.position, atol=0.01)
