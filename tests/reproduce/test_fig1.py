import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from ggcnn_net2net.cli.figures import fig1
from ggcnn_net2net.errors import ObjectSetError
from ggcnn_net2net.grasping import Grasp
from ggcnn_net2net.protocol import CORRECTED, PAPER
from ggcnn_net2net.reproduce import fig1 as module
from ggcnn_net2net.reproduce.fig1 import draw, predict

JAW = (255, 59, 48)


@pytest.fixture
def maps(monkeypatch):
    """Gives a network's four maps instead of a network."""

    def give(quality: float, theta: float = 0.4) -> None:
        blob = np.zeros((300, 300), np.float32)
        blob[139:160, 140:161] = quality
        full = np.ones_like(blob)
        found = np.stack([blob, np.cos(2 * theta) * full, np.sin(2 * theta) * full, 0.3 * full])
        monkeypatch.setattr(module, "predict_maps", lambda _model, images: (found for _ in images))

    return give


def test_maps_and_grasp(objects, maps):
    maps(1.0)
    seen = predict(None, objects.objects[0], 0, 0, PAPER)
    assert seen.angle == pytest.approx(0.4)
    assert seen.width == pytest.approx(45.0)
    assert (seen.grasp.row, seen.grasp.col) == (149, 150)
    assert seen.grasp.angle == pytest.approx(0.4)
    assert (seen.normalised_quality.min(), seen.normalised_quality.max()) == (0, 1)
    assert seen.outcome != "no grasp found"
    assert seen.view.shape[2] == 3
    # The gripper stands in the picture: without it, the view is another.
    maps(0.1)
    without = predict(None, objects.objects[0], 0, 0, PAPER)
    assert np.abs(seen.view.astype(int) - without.view).max() > 50


def test_a_network_that_sees_no_grasp(objects, maps, tmp_path):
    maps(0.0)
    seen = predict(None, objects.objects[1], 1, 0, CORRECTED)
    assert seen.grasp is None
    assert seen.outcome == "no grasp found"
    assert not seen.normalised_quality.any()
    draw(tmp_path / "none.png", seen, "blind", CORRECTED)
    assert cv2.imread(str(tmp_path / "none.png")).shape[1] > 1200


def test_the_jaws_are_drawn_where_the_grasp_is(objects, maps, tmp_path):
    maps(1.0)
    seen = predict(None, objects.objects[0], 0, 0, PAPER)
    counts = []
    for width in (10.0, 60.0):
        draw(tmp_path / "fig1.png", replace_grasp(seen, Grasp(150.0, 150.0, 0.0, width)), "net", PAPER)
        red = (cv2.imread(str(tmp_path / "fig1.png"))[..., ::-1] == JAW).all(axis=2)
        depth_panel = red[red.shape[0] // 2 :, red.shape[1] * 3 // 4 :]
        counts.append(np.ptp(np.flatnonzero(depth_panel.any(axis=0))))
    assert counts[1] > 3 * counts[0]  # the jaws stand apart by the opening


def replace_grasp(seen, grasp):
    from dataclasses import replace

    return replace(seen, grasp=grasp)


def test_an_object_that_is_not_in_the_set(tmp_path):
    result = CliRunner().invoke(fig1, ["--object", "unicorn", "-o", str(tmp_path / "x.png")])
    assert isinstance(result.exception, ObjectSetError)
    assert "hammer" in str(result.exception)
    assert "unicorn" in str(result.exception)


def test_the_published_network(tmp_path, data_root):
    result = CliRunner().invoke(fig1, ["-o", str(tmp_path / "fig1.png")], standalone_mode=False)
    assert result.exception is None
    assert "hammer/0: success" in result.output
    assert (tmp_path / "fig1.png").stat().st_size > 50_000
