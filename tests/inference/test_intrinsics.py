import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ggcnn_net2net.errors import DepthImageError
from ggcnn_net2net.grasping import Grasp, grasp_to_rectangle
from ggcnn_net2net.inference.intrinsics import Intrinsics, as_intrinsics, read_intrinsics

K = [615.0, 0.0, 321.0, 0.0, 610.0, 239.0, 0.0, 0.0, 1.0]
CAMERA = Intrinsics(615.0, 610.0, 321.0, 239.0)
GRASP = Grasp(200.0, 400.0, 0.3, 50.0, 0.7)


@given(
    st.floats(200, 900),
    st.floats(200, 900),
    st.floats(-1.57, 1.57),
    st.floats(1, 150),
    st.floats(0.2, 3),
)
def test_metres_project_back_onto_the_rectangle(fx, fy, angle, width_px, z):
    camera = Intrinsics(fx, fy, 320.0, 240.0)
    grasp = replace(GRASP, angle=angle, width_px=width_px)
    found = camera.as_camera_grasp(grasp, z)
    ends = [np.array(found.position) + sign * found.opening / 2 * np.array(found.closing_direction) for sign in (-1, 1)]
    pixels = [(y / depth * fy + 240, x / depth * fx + 320) for x, y, depth in ends]
    corners = grasp_to_rectangle(grasp)
    np.testing.assert_allclose(pixels, [corners[[0, 3]].mean(axis=0), corners[[1, 2]].mean(axis=0)], atol=1e-6)
    assert np.linalg.norm(found.closing_direction) == pytest.approx(1)


def test_known_numbers():
    found = Intrinsics(500.0, 500.0, 320.0, 240.0).as_camera_grasp(Grasp(290.0, 420.0, np.pi / 6, 100.0), 0.5)
    assert found.position == (0.1, 0.05, 0.5)  # right of the axis and below it
    assert found.opening == pytest.approx(0.1)
    assert found.closing_direction == pytest.approx((np.cos(np.pi / 6), -0.5, 0))  # y grows downwards
    assert (found.row, found.col, found.angle, found.width_px) == (290, 420, np.pi / 6, 100)


@pytest.mark.parametrize(
    "camera",
    [CAMERA, K, np.reshape(K, (3, 3)), tuple(K), SimpleNamespace(K=K), SimpleNamespace(k=np.array(K))],
)
def test_cameras_in_every_form(camera):
    assert as_intrinsics(camera) == CAMERA


@pytest.mark.parametrize(
    ("camera", "message"),
    [
        ("realsense", "CameraInfo"),
        (None, "received"),
        (K[:8], "9 numbers"),
        (np.zeros(9), "calibrated"),
        ([*K[:4], np.nan, *K[5:]], "calibrated"),
        ([-615.0, *K[1:]], "above 0"),
        ([K[0], 3.0, *K[2:]], "camera matrix"),
        (np.reshape(K, (3, 3)).T, "camera matrix"),
    ],
)
def test_what_is_no_camera_is_refused(camera, message):
    with pytest.raises(DepthImageError, match=message):
        as_intrinsics(camera)


@pytest.mark.parametrize(
    "content", [{"fx": 615, "fy": 610, "cx": 321, "cy": 239}, {"K": K}, {"k": np.reshape(K, (3, 3)).tolist()}]
)
def test_camera_files(tmp_path, content):
    file = tmp_path / "camera.json"
    file.write_text(json.dumps(content))
    assert read_intrinsics(file) == CAMERA


@pytest.mark.parametrize("text", ["", "[]", '{"fx": 615}', '{"K": "none"}', '{"fx": "a", "fy": 1, "cx": 1, "cy": 1}'])
def test_damaged_camera_files(tmp_path, text):
    file = tmp_path / "camera.json"
    file.write_text(text)
    with pytest.raises(DepthImageError, match="camera"):
        read_intrinsics(file)
    with pytest.raises(DepthImageError, match=r"none\.json"):
        read_intrinsics(tmp_path / "none.json")
