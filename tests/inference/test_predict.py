"""Networks on depth images of the simulated camera."""

import numpy as np
import pytest

from ggcnn_net2net.errors import DepthImageError
from ggcnn_net2net.grasping import RSS_2018
from ggcnn_net2net.inference import predict


def test_each_image_loses_its_own_mean_and_nothing_is_clipped(monkeypatch):
    """As in the paper's simulator; the depth of a training sample is clipped, too."""
    seen = []

    def network(image):
        seen.append(image[0])
        quality = np.zeros((60, 60), np.float32)
        quality[30, 29 + len(seen)] = 100
        return np.stack([quality, np.ones_like(quality), np.zeros_like(quality), np.full_like(quality, 0.2)])[None]

    monkeypatch.setattr(predict, "compiled_network", lambda model: network)
    near, far = np.full((60, 60), 0.8, np.float32), np.full((60, 60), 1.9, np.float32)
    near[0, 0] += 3  # deeper than any clip
    far[:4] -= 0.1
    grasps = predict.predict_grasps(None, np.stack([near, far]), RSS_2018)
    for image, depth in zip(seen, (near, far), strict=True):
        np.testing.assert_allclose(image, depth - depth.mean(), atol=1e-6)
    assert [(grasp.row, grasp.col) for grasp in grasps] == [(30, 30), (30, 31)]
    assert [grasp.width_px for grasp in grasps] == pytest.approx([30.0, 30.0])


def test_one_image_alone_is_refused():
    with pytest.raises(DepthImageError, match=r"received \(60, 60\): take depth\[None\]"):
        predict.predict_grasps(None, np.zeros((60, 60)))
