"""Every step of the experiments on real Cornell scenes: the commands for a full set, with small networks."""

import subprocess
import sys
from dataclasses import replace

import pytest
from commands import call

from ggcnn_net2net import search
from ggcnn_net2net.cli import figures
from ggcnn_net2net.cli.dataset import dataset
from ggcnn_net2net.cli.evaluate import evaluate
from ggcnn_net2net.reproduce import curves
from ggcnn_net2net.reproduce.experiments import EXPERIMENTS
from ggcnn_net2net.search.settings import Budget

pytestmark = pytest.mark.slow

FEW = ("--images-per-epoch", 8, "--epochs", 1, "--no-validation", "--protocol", "corrected", "--schedule", "cosine")


@pytest.fixture(scope="module")
def cornell(data_root, tmp_path_factory):
    """All scenes at hand, one sample each, split by images as in the paper."""
    path = tmp_path_factory.mktemp("cornell") / "cornell.h5"
    assert "100 cornell scenes" in call(
        dataset, "build", data_root / "cornell", "-o", path, "--augmentations", 1, "--workers", 2
    )
    return path


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """A network that trains in no time."""
    from ggcnn_net2net.architecture import build_ggcnn
    from ggcnn_net2net.model_files import save_ggcnn

    return save_ggcnn(build_ggcnn("C9x9x2s3_T9x9x2s3", seed=0), tmp_path_factory.mktemp("tiny") / "tiny.hdf5")


@pytest.fixture
def small(monkeypatch):
    """The experiments with one level, one node kept, and few images."""
    monkeypatch.setitem(search.BUDGETS, "quick", Budget(8, 4))
    for name, experiment in EXPERIMENTS.items():
        shallow = tuple(replace(curve, width=1, depth=1) for curve in experiment.curves)
        monkeypatch.setitem(EXPERIMENTS, name, replace(experiment, curves=shallow))


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_a_figure_is_run_again(name, cornell, tiny, small, tmp_path):
    experiment = EXPERIMENTS[name]
    if name == "fig3":
        networks = ("--networks", ",".join(f"{curve.name}={tiny}" for curve in experiment.curves))
    else:
        networks = ("--network", tiny)
    simulation = ("--objects", "training:1", "--poses", 1)
    shown = call(
        getattr(figures, name), "--run", "--data", cornell, "--budget", "quick", "--workers", 2, "-o", tmp_path,
        *networks, *simulation
    )  # fmt: skip
    points = curves.read_points(tmp_path / "results.csv")
    assert {(point.curve, point.protocol) for point in points} == {
        (curve.name, protocol.name) for curve in experiment.curves for protocol in experiment.protocols
    }
    assert {point.trials for point in points if point.metric == curves.IOU} == {20}
    assert {point.network for point in points} == {"tiny.hdf5"}
    for suffix in (".png", ".md", ".csv"):
        assert f"Written to {tmp_path / name}{suffix}" in shown


@pytest.mark.parametrize(
    ("network", "options"),
    [
        ("original", ()),
        ("published", ("--repeat", 1, "--final-epochs", 1)),
        ("narrow", ("--ops", "deeper(1)", "--final-epochs", 1)),
    ],
    ids=["from scratch", "control", "grown"],
)
def test_a_row_of_the_table_is_trained(network, options, cornell, tmp_path):
    model, iou = tmp_path / "trained.hdf5", tmp_path / "iou.json"
    arguments = ("train", network, cornell, "-o", model, *options, *FEW)
    # In a process of its own, since training sets TensorFlow's threads.
    subprocess.run([sys.executable, "-m", "ggcnn_net2net", *map(str, arguments)], check=True, capture_output=True)
    call(evaluate, "iou", model, cornell, "-o", iou)
    assert '"images": 20' in iou.read_text()
