import json

import cv2
import numpy as np
import pytest

from ggcnn_net2net.grasping import Grasp, rectangle_to_grasp
from ggcnn_net2net.inference.intrinsics import Intrinsics
from ggcnn_net2net.inference.prediction_files import write_prediction_json, write_prediction_picture
from ggcnn_net2net.inference.predictor import Prediction
from ggcnn_net2net.inference.window import Window

GRASP = Grasp(40.0, 60.0, 0.5, 30.0, 0.8)


def prediction_of(*grasps, missing=0.0):
    random = np.random.default_rng(0)
    metres = random.uniform(0.8, 1, (90, 120)).astype(np.float32)
    metres[random.random(metres.shape) < missing] = np.nan
    maps = np.zeros((4, 36, 36), np.float32)
    return Prediction(list(grasps), "mm", metres, Window(9, 24, 72, 72, 2.0), maps)


def test_json_says_everything(tmp_path):
    grasp = Intrinsics(100.0, 100.0, 60.0, 45.0).as_camera_grasp(GRASP, 0.9)
    write_prediction_json(tmp_path / "a.json", prediction_of(grasp, missing=0.1), {"image": "a.png"})
    content = json.loads((tmp_path / "a.json").read_text())
    assert (content["image"], content["depth_unit"], content["image_shape"]) == ("a.png", "mm", [90, 120])
    assert 900 < content["missing_pixels"] < 1300
    assert content["window"] == {
        "top": 9, "left": 24, "height": 72, "width": 72, "scale": 2.0, "network_shape": [36, 36],
    }  # fmt: skip
    (found,) = content["grasps"]
    assert tuple(found["position"]) == grasp.position
    assert found["opening"] == grasp.opening
    from_rectangle, _ = rectangle_to_grasp(found["rectangle_row_col"])
    assert (from_rectangle.row, from_rectangle.angle) == pytest.approx((GRASP.row, GRASP.angle), abs=1e-3)


@pytest.mark.parametrize("grasps", [(), (GRASP,), (GRASP, Grasp(20.0, 30.0, -1.2, 0.0, 0.3))])
def test_pictures_show_what_was_found(tmp_path, grasps):
    write_prediction_picture(tmp_path / "plain.png", prediction_of(missing=0.2), "title")
    write_prediction_picture(tmp_path / "found.png", prediction_of(*grasps, missing=0.2), "title")
    plain, found = (cv2.imread(str(tmp_path / name)) for name in ("plain.png", "found.png"))
    assert plain.shape[1] > 1000
    assert (plain.shape == found.shape and (plain == found).all()) == (not grasps)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["found.png", "plain.png"]
