"""`ggcnn-net2net evaluate iou` on small files of the layout."""

import csv
import json

import click
import h5py
import numpy as np
import pytest
import tifffile
from click.testing import CliRunner

import ggcnn_net2net as gn
from ggcnn_net2net.cli.evaluate import evaluate
from ggcnn_net2net.errors import DatasetError, ModelFileError
from ggcnn_net2net.model_files.published import PUBLISHED_SHA256
from ggcnn_net2net.reference_data import sha256_of

LABEL = [[140, 130], [140, 170], [160, 170], [160, 130]]


def call(*arguments):
    result = CliRunner().invoke(evaluate, ["iou", *map(str, arguments)], standalone_mode=False)
    if result.exception:
        raise result.exception
    return result.output


def write_dataset(path, depth, rectangles):
    """A file of the public layout: whole numbers as img_id, rectangles padded with zeros to 25."""
    boxes = np.zeros((len(depth), 25, 4, 2), int)
    for row, of_image in enumerate(rectangles):
        boxes[row, : len(of_image)] = np.reshape(of_image, (-1, 4, 2))
    with h5py.File(path, "w") as file:
        group = file.create_group("test")
        group["img_id"] = np.arange(100, 100 + len(depth))
        group["depth_inpainted"] = np.asarray(depth, np.float32)
        group["bounding_boxes"] = boxes
        for key in ("grasp_points_img", "angle_img", "grasp_width"):
            group[key] = np.zeros(np.shape(depth), np.float32)


@pytest.fixture
def untrained(tmp_path):
    """A network that answers 0 everywhere: it sees no grasp."""
    model = gn.build_ggcnn("shallow", seed=0)
    model.set_weights([0 * weights for weights in model.get_weights()])
    gn.save_ggcnn(model, tmp_path / "untrained.hdf5")
    return tmp_path / "untrained.hdf5"


def test_network_that_sees_nothing(untrained, tmp_path):
    write_dataset(tmp_path / "scenes.hdf5", np.zeros((3, 300, 300)), [[LABEL], [], [LABEL, LABEL]])
    output, rows = tmp_path / "deep" / "iou.json", tmp_path / "iou.csv"
    text = call(untrained, tmp_path / "scenes.hdf5", "-o", output, "--csv", rows)
    for protocol in ("PAPER", "CORRECTED"):
        assert f"{protocol} 0/3 0.000 (0.000-0.561) 3".split() in [line.split() for line in text.splitlines()]
    result = json.loads(output.read_text())
    assert [rate["protocol"]["name"] for rate in result["rates"]] == ["PAPER", "CORRECTED"]
    assert all((rate["successes"], rate["images"], rate["without_grasp"]) == (0, 3, 3) for rate in result["rates"])
    assert result["dataset"]["images"] == 3
    assert len(result["dataset"]["fingerprint"]) == 64
    with rows.open() as stream:
        table = list(csv.DictReader(stream))
    assert [(row["img_id"], row["protocol"]) for row in table[:4]] == [
        ("100", "PAPER"),
        ("101", "PAPER"),
        ("102", "PAPER"),
        ("100", "CORRECTED"),
    ]
    assert {(row["success"], row["angle"]) for row in table} == {("0", "")}


def test_published_network_on_real_scenes(data_root, tmp_path):
    numbers = (100, 101, 102, 103)
    folder = data_root / "cornell" / "01"
    depth = [tifffile.imread(folder / f"pcd{number:04d}d.tiff")[90:390, 170:470] for number in numbers]
    depth = [np.clip(image - image.mean(), -1, 1) for image in depth]
    labels = [
        np.loadtxt(folder / f"pcd{number:04d}cpos.txt")[:, ::-1].reshape(-1, 4, 2) - (90, 170) for number in numbers
    ]
    write_dataset(tmp_path / "scenes.hdf5", depth, labels)
    output, rows = tmp_path / "iou.json", tmp_path / "iou.csv"
    call("published", tmp_path / "scenes.hdf5", "-o", output, "--csv", rows)
    result = json.loads(output.read_text())
    assert result["model"]["sha256"] == PUBLISHED_SHA256
    assert result["model"]["parameters"] == 62_420
    paper, corrected = result["rates"]
    assert 1 <= paper["successes"] <= corrected["successes"] <= 4
    assert corrected["wilson_95"][0] < corrected["rate"] <= corrected["wilson_95"][1]
    with rows.open() as stream:
        success = [row["success"] == "1" for row in csv.DictReader(stream)]
    assert [sum(success[:4]), sum(success[4:])] == [paper["successes"], corrected["successes"]]


@pytest.mark.parametrize("option", ["-o", "--csv"])
def test_what_is_read_is_not_overwritten(option, untrained, tmp_path):
    scenes, record = tmp_path / "scenes.hdf5", tmp_path / "untrained.json"
    write_dataset(scenes, np.zeros((1, 300, 300)), [[LABEL]])
    for read in (untrained, scenes):
        before = read.read_bytes()
        with pytest.raises(click.UsageError, match="another output file"):
            call(untrained, scenes, option, read)
        assert read.read_bytes() == before
    record.write_text(json.dumps({"model_sha256": sha256_of(untrained)}))
    with pytest.raises(ModelFileError, match=r"record .*untrained\.json would be lost"):
        call(untrained, scenes, option, record.with_suffix(".json" if option == "-o" else ".csv"))
    assert list(json.loads(record.read_text())) == ["model_sha256"]


def test_missing_split_and_model_are_explained(untrained, tmp_path):
    write_dataset(tmp_path / "scenes.hdf5", np.zeros((1, 300, 300)), [[LABEL]])
    with pytest.raises(DatasetError, match="train"):
        call(untrained, tmp_path / "scenes.hdf5", "--split", "train")
    with pytest.raises(ModelFileError, match="no file"):
        call(tmp_path / "none.hdf5", tmp_path / "scenes.hdf5")


def test_all_splits_together(untrained, tmp_path):
    write_dataset(tmp_path / "scenes.hdf5", np.zeros((3, 300, 300)), [[LABEL], [], [LABEL]])
    with h5py.File(tmp_path / "scenes.hdf5", "a") as file:
        file.copy("test", "train")
        file["train/img_id"][...] = np.arange(3)
    output, rows = tmp_path / "iou.json", tmp_path / "iou.csv"
    text = call(untrained, tmp_path / "scenes.hdf5", "--split", "all", "-o", output, "--csv", rows)
    assert "0/6" in text
    assert json.loads(output.read_text())["dataset"]["images"] == 6
    with rows.open() as lines:
        images = [row["img_id"] for row in csv.DictReader(lines) if row["protocol"] == "PAPER"]
    assert images == ["0", "1", "2", "100", "101", "102"]
