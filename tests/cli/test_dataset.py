"""The dataset commands on a small folder in Cornell's format."""

from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest
from click.testing import CliRunner

from ggcnn_net2net.cli.dataset import dataset
from ggcnn_net2net.datasets.simulated import Simulation
from ggcnn_net2net.errors import DatasetError, GripperError
from ggcnn_net2net.protocol import CORRECTED
from ggcnn_net2net.simulation import PAPER_GRIPPER


def call(*arguments):
    result = CliRunner().invoke(dataset, [str(argument) for argument in arguments], standalone_mode=False)
    if result.exception:
        raise result.exception
    return result.output


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "raw"
    folder.mkdir()
    for number in range(5):
        stem = f"{folder}/pcd010{number}"
        cv2.imwrite(f"{stem}r.png", np.full((320, 340, 3), 90, np.uint8))
        cv2.imwrite(f"{stem}d.tiff", np.full((320, 340), 1.2, np.float32))
        text = "100 120\n160 120\n160 150\n100 150\n"
        Path(f"{stem}cpos.txt").write_text(text + ("1 2\n" if number == 4 else ""))
    return folder


def test_from_raw_to_joined(folder, tmp_path):
    split, data, sheet, both = (tmp_path / name for name in ("split.json", "data.h5", "sheet.png", "both.h5"))
    assert "3 train, 2 test scenes" in call("split", folder, "--by", "image", "--test-fraction", 0.4, "-o", split)
    arguments = ("-o", data, "--split", split, "--augmentations", 2, "--zoom", 0.8, 0.9, "--workers", 1)
    output = call("build", folder, *arguments)
    assert "6 train, 4 test images" in output
    assert "pcd0104cpos.txt: the last 1 lines left out" in output  # reported
    output = call("info", data, "--verify")
    assert "train: 6 images 300x300 of 3 scenes" in output
    assert '"per_scene": 2' in output
    assert "1.0 rectangles an image" in output
    assert output.count("the content has it") == 2
    assert "4 images written" in call("preview", data, "-o", sheet, "--count", 4)
    assert cv2.imread(str(sheet)).std() > 10
    assert "12 train, 8 test images" in call("concat", data, data, "-o", both)
    assert "6 train, 4 test images" in call("concat", data, "-o", both, "--uncompressed")
    assert both.stat().st_size > data.stat().st_size
    assert "6 train, 4 test images" in call("build", folder, *arguments, "-o", both, "--uncompressed")
    with h5py.File(both) as file:
        assert file["test/depth_inpainted"].compression is None
    with h5py.File(data, "r+") as file:
        file["train/grasp_width"][0, 0, 0] = 7
    with pytest.raises(DatasetError, match="was changed"):
        call("info", data, "--verify")


@pytest.mark.parametrize("command", ["build", "concat", "split", "preview", "info"])
def test_every_command_has_an_example(command):
    assert "Example: ggcnn-net2net dataset " + command in call(command, "--help")


def test_the_options_of_simulate_reach_the_simulation(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(
        "ggcnn_net2net.datasets.simulated.simulate_folder", lambda *given: asked.append(given) or {"pcd0000": 3}
    )
    options = ("--noise", 0.002, "--missing", 0.3, "--sides", 0.2, 0.32, "--tried-labels", "--seed", 7, "--workers", 3)
    call("simulate", "-o", tmp_path, "--scenes", 9, "--protocol", "corrected", *options)
    ((folder, count, settings, workers, _),) = asked
    assert (folder, count, workers) == (tmp_path, 9, 3)
    assert settings == Simulation(
        seed=7,
        noise=0.002,
        missing=0.3,
        tried_labels=True,
        sides=(0.2, 0.32),
        protocol=CORRECTED,
        gripper=PAPER_GRIPPER,
    )


def test_scenes_for_a_gripper(tmp_path):
    gripper, folder = tmp_path / "small.toml", tmp_path / "simulated"
    gripper.write_text("palm = [0.1, 0.02, 0.01]\nmax_opening = 0.08\n")
    arguments = ("simulate", "-o", folder, "--scenes", 1, "--workers", 1)
    assert "1 scenes" in call(*arguments, "--gripper", gripper)
    assert '"max_opening": 0.08' in (folder / "simulation.json").read_text()
    with pytest.raises(DatasetError, match="differs in gripper"):
        call(*arguments)
    gripper.write_text("max_opening = 80\n")
    with pytest.raises(GripperError, match=r"metres.*small\.toml"):
        call(*arguments, "--gripper", gripper)


def test_errors_name_the_path(tmp_path):
    with pytest.raises(DatasetError, match="nowhere"):
        call("build", tmp_path / "nowhere", "-o", tmp_path / "data.h5")
    with pytest.raises(DatasetError, match="nowhere"):
        call("info", tmp_path / "nowhere")
