"""Network, decoding and IoU rule in sequence, with networks whose maps are known."""

from dataclasses import replace

import numpy as np
import pytest

from ggcnn_net2net.errors import DatasetError, GraspError
from ggcnn_net2net.grasping import Grasp, grasp_to_rectangle
from ggcnn_net2net.inference import iou_rate as module
from ggcnn_net2net.inference.iou_rate import iou_rate_of
from ggcnn_net2net.parallel import Crash
from ggcnn_net2net.protocol import CORRECTED, PAPER

SIZE = 120
GRASPS = [Grasp(50 + index, 60, 0.1 * index, 30, 1.0) for index in range(10)]


class Model:
    input_shape = (None, SIZE, SIZE, 1)


class Dataset:
    """Images that all have the value of their index, labelled with `GRASPS`."""

    def __init__(self, n=10):
        self.n = n

    def __len__(self):
        return self.n

    def depth(self, row):
        return np.full((SIZE, SIZE), row, np.float32)

    def rectangles(self, row):
        return grasp_to_rectangle(GRASPS[row % len(GRASPS)])[None]


def maps_of(grasp):
    maps = np.zeros((4, SIZE, SIZE), np.float32)
    if grasp is not None:
        rows, cols = np.ogrid[:SIZE, :SIZE]
        maps[0] = np.exp(-((rows - grasp.row) ** 2 + (cols - grasp.col) ** 2) / 200)
        maps[1:] = np.reshape([np.cos(2 * grasp.angle), np.sin(2 * grasp.angle), grasp.width_px / 150], (3, 1, 1))
    return maps


@pytest.fixture
def network(monkeypatch):
    """Let the network predict given grasps; keeps the inputs that it saw."""

    def use(grasps):
        seen = []

        def predict_maps(model, images):
            for image, grasp in zip(images, grasps, strict=True):
                seen.append(image)
                yield maps_of(grasp)

        monkeypatch.setattr(module, "predict_maps", predict_maps)
        return seen

    return use


def test_each_image_is_judged_by_its_own_labels(network):
    network([*GRASPS[:5], None, *GRASPS[:4]])
    progress = []
    result = iou_rate_of(Model(), Dataset(), CORRECTED, on_progress=lambda *step: progress.append(step))
    assert result.success == (*[True] * 5, *[False] * 5)  # the last four are 6 px and 0.6 rad off
    assert result.without_grasp == 1
    assert result.grasps[5] is None
    assert (result.grasps[3].row, result.grasps[3].col) == (53, 60)
    assert result.grasps[3].angle == pytest.approx(0.3, abs=1e-6)
    assert progress == [("CORRECTED", done, 10) for done in range(11)]


def test_protocol_decides_whether_the_mean_is_subtracted_again(network):
    seen = network(GRASPS)
    iou_rate_of(Model(), Dataset(), replace(PAPER, iou_recentres_depth=False))
    assert [image.mean() for image in seen] == list(range(10))
    assert {image.shape for image in seen} == {(SIZE, SIZE)}
    seen = network(GRASPS)
    iou_rate_of(Model(), Dataset(), replace(CORRECTED, iou_recentres_depth=True))
    assert not np.any(seen)


def test_protocol_decides_how_angles_are_compared(network):
    steep, past = Grasp(60, 60, np.deg2rad(87), 30), Grasp(60, 60, np.deg2rad(-87), 30)
    dataset = Dataset(1)
    dataset.rectangles = lambda row: grasp_to_rectangle(past)[None]
    network([steep])
    assert iou_rate_of(Model(), dataset, replace(PAPER, wrapped_angle_difference=True)).successes == 1
    network([steep])
    assert iou_rate_of(Model(), dataset, replace(CORRECTED, wrapped_angle_difference=False)).successes == 0


@pytest.mark.slow
def test_workers_make_no_difference(network):
    n = 2 * module._BLOCK + 3
    found = [None if index % 7 == 3 else GRASPS[(index + index % 4) % 10] for index in range(n)]
    network(found)
    alone = iou_rate_of(Model(), Dataset(n), PAPER)
    network(found)
    progress = []
    assert iou_rate_of(Model(), Dataset(n), PAPER, 2, lambda *step: progress.append(step)) == alone
    assert progress[-1] == ("PAPER", n, n)
    assert 5 < alone.successes < n - 5


def test_worker_that_dies_is_an_error(network, monkeypatch):
    network(GRASPS)
    monkeypatch.setattr(module, "run_parallel", lambda function, inputs, workers: iter([(0, Crash(-9, 2))]))
    with pytest.raises(GraspError, match=r"exit code -9.*fewer workers"):
        iou_rate_of(Model(), Dataset(), PAPER, workers=2)


def test_unfit_datasets_are_refused(network):
    network(GRASPS)
    with pytest.raises(DatasetError, match="at least one image"):
        iou_rate_of(Model(), Dataset(0), PAPER)
    model = Model()
    model.input_shape = (None, 300, 300, 1)
    with pytest.raises(DatasetError, match=r"\(300, 300\).*\(120, 120\)"):
        iou_rate_of(model, Dataset(), PAPER)


def test_maps_that_are_not_finite_are_refused(monkeypatch):
    monkeypatch.setattr(
        module, "predict_maps", lambda model, images: (np.full((4, SIZE, SIZE), np.nan) for _ in images)
    )
    with pytest.raises(GraspError, match="NaN"):
        iou_rate_of(Model(), Dataset(), PAPER)
