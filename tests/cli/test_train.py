"""The command `train`, on a data file of twelve small images."""

import csv
import json
import signal
import subprocess
import sys
import time

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

import ggcnn_net2net as gn
from ggcnn_net2net.cli.train import train_command
from ggcnn_net2net.datasets.augmentation import Augmentation
from ggcnn_net2net.datasets.build import build_dataset
from ggcnn_net2net.datasets.raw import open_scenes
from ggcnn_net2net.datasets.splits import Split
from ggcnn_net2net.errors import ArchitectureError, DatasetError, ModelFileError, TrainingError

ARCHITECTURE = "C5x5x4_C3x3x2_T3x3x2_T5x5x4"


@pytest.fixture
def call(dataset, monkeypatch):
    # TensorFlow runs already in this process, with the number of threads it has.
    monkeypatch.setattr("ggcnn_net2net.training.set_threads", lambda threads: None)

    def call(network, output, *options):
        arguments = [network, dataset, "-o", output, *options]
        result = CliRunner().invoke(train_command, [str(part) for part in arguments], standalone_mode=False)
        if result.exception:
            raise result.exception
        return result.output

    return call


def test_it_writes_the_model_and_what_made_it(call, tmp_path):
    output = tmp_path / "shallow.hdf5"
    shown = call("shallow", output, "--epochs", 2)
    assert "val_loss" in shown
    assert str(gn.architecture_of(gn.load_ggcnn(output))) == ARCHITECTURE
    with output.with_suffix(".csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["epoch"] for row in rows] == ["0", "1"]
    assert float(rows[1]["val_width_out_loss"]) > 0
    assert cv2.imread(str(output.with_suffix(".png"))).std() > 10  # not blank
    facts = json.loads(output.with_suffix(".json").read_text())
    assert facts["data"]["images"] == 8
    assert facts["data"]["made_by"]["source"] == "test"
    assert facts["recipe"]["protocol"]["name"] == "PAPER"
    assert facts["recipe"]["seed"] == 0
    assert facts["parameters"] == gn.SHALLOW.n_parameters
    assert facts["versions"]["tensorflow"]


def test_it_goes_on_from_a_checkpoint_and_from_a_file(call, tmp_path):
    first = tmp_path / "first.hdf5"
    call(ARCHITECTURE, first, "--epochs", 1)
    call(ARCHITECTURE, first, "--epochs", 3)
    at_once = tmp_path / "at_once.hdf5"
    call(ARCHITECTURE, at_once, "--epochs", 3)
    for one, other in zip(gn.load_ggcnn(first).get_weights(), gn.load_ggcnn(at_once).get_weights(), strict=True):
        np.testing.assert_array_equal(one, other)
    more = tmp_path / "more.keras"
    call(first, more, "--epochs", 1, "--no-validation", "--protocol", "corrected", "--schedule", "cosine")
    assert gn.load_ggcnn(more).count_params() == gn.load_ggcnn(first).count_params()
    assert "val_loss" not in more.with_suffix(".csv").read_text()


def test_another_run_does_not_go_on_from_the_checkpoint(call, tmp_path):
    output = tmp_path / "shallow.hdf5"
    call("shallow", output, "--epochs", 1)
    with pytest.raises(TrainingError, match="another recipe"):
        call("shallow", output, "--epochs", 1, "--optimizer", "adam")
    call("shallow", output, "--epochs", 1, "--optimizer", "adam", "--restart")


def test_errors(call, tmp_path):
    with pytest.raises(ModelFileError, match="suffixes"):
        call("shallow", tmp_path / "model.txt")
    with pytest.raises(ModelFileError, match=r"missing\.hdf5"):
        call("missing.hdf5", tmp_path / "model.hdf5")
    with pytest.raises(ArchitectureError, match="expected"):
        call("nonsense", tmp_path / "model.hdf5")
    with pytest.raises(TrainingError, match="'nonsense'"):
        call("shallow", tmp_path / "model.hdf5", "--optimizer", "nonsense")
    with pytest.raises(DatasetError):
        CliRunner().invoke(
            train_command,
            ["shallow", "none.h5", "-o", str(tmp_path / "model.hdf5")],
            standalone_mode=False,
            catch_exceptions=False,
        )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_an_interrupt_leaves_a_state_to_go_on_from(dataset, tmp_path):
    output = tmp_path / "shallow.hdf5"
    options = ["train", "shallow", dataset, "-o", output, "--epochs", "100000", "--threads", "1"]
    command = [sys.executable, "-m", "ggcnn_net2net", *map(str, options)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    checkpoint = tmp_path / "shallow.hdf5.training" / "checkpoint.npz"
    while process.poll() is None and not checkpoint.exists():
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "the same command goes on from there" in errors
    assert "Traceback" not in errors
    assert not output.exists()
    assert checkpoint.exists()


@pytest.fixture
def raw(tmp_path):
    """A folder of three scenes in Cornell's form."""
    folder = tmp_path / "raw"
    folder.mkdir()
    random = np.random.default_rng(1)
    for number in range(3):
        name = folder / f"pcd{number:04d}"
        cv2.imwrite(f"{name}r.png", np.zeros((300, 300, 3), np.uint8))
        cv2.imwrite(f"{name}d.tiff", random.uniform(0.9, 1.1, (300, 300)).astype(np.float32))
        name.with_name(f"{name.name}cpos.txt").write_text("120 130\n180 130\n180 150\n120 150\n")
    return folder


def test_fresh_augmentations_begin_as_the_stored_ones_and_then_differ(call, raw, tmp_path):
    stored = tmp_path / "stored.h5"
    split = Split(train=("pcd0000", "pcd0001"), test=("pcd0002",))
    build_dataset(open_scenes(raw), split, stored, Augmentation(per_scene=2), seed=5)

    def trained(name, *options):
        arguments = ["shallow", stored, "-o", tmp_path / f"{name}.hdf5", "--no-validation", *options]
        result = CliRunner().invoke(train_command, [str(part) for part in arguments], standalone_mode=False)
        assert result.exception is None, result.exception
        return np.concatenate([part.ravel() for part in gn.load_ggcnn(tmp_path / f"{name}.hdf5").get_weights()])

    np.testing.assert_allclose(trained("a", "--epochs", 1), trained("b", "--epochs", 1, "--fresh-from", raw), atol=1e-6)
    assert np.abs(trained("c", "--epochs", 2) - trained("d", "--epochs", 2, "--fresh-from", raw)).max() > 1e-5
    assert json.loads((tmp_path / "d.json").read_text())["fresh_augmentations"] is True


def test_fresh_augmentations_of_another_folder_are_refused(call, raw, tmp_path):
    with pytest.raises(DatasetError, match="dataset build"):
        call("shallow", tmp_path / "x.hdf5", "--fresh-from", raw)
