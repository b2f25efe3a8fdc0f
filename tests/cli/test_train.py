"""The command `train`, on a data file of twelve small images."""

import csv
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import click
import cv2
import numpy as np
import pytest
from click.testing import CliRunner

import ggcnn_net2net as gn
from ggcnn_net2net import zoo
from ggcnn_net2net.cli.networks import made_by, note_other_loss
from ggcnn_net2net.cli.train import train_command
from ggcnn_net2net.datasets.augmentation import Augmentation
from ggcnn_net2net.datasets.build import build_dataset
from ggcnn_net2net.datasets.raw import open_scenes
from ggcnn_net2net.datasets.splits import Split
from ggcnn_net2net.errors import ArchitectureError, DatasetError, ModelFileError, SurgeryError, TrainingError
from ggcnn_net2net.protocol import CORRECTED, PAPER
from ggcnn_net2net.reference_data import sha256_of

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
    assert "stages" not in facts
    assert [path.name for path in (tmp_path / "shallow.hdf5.training").iterdir()] == ["checkpoint.npz"]


def test_final_epochs_of_a_plain_training_are_on_record(call, tmp_path):
    call("shallow", tmp_path / "plain.hdf5", "--epochs", 1, "--final-epochs", 2, "--no-validation")
    facts = json.loads((tmp_path / "plain.json").read_text())
    assert (facts["recipe"]["epochs"], facts["last_epoch"]["epoch"]) == (3, 2)


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


def test_a_network_is_grown_on_the_way(call, tmp_path):
    output = tmp_path / "grown.hdf5"
    options = ["--ops", "deeper(1), wider(3)", "--epochs", 1, "--final-epochs", 1, "--protocol", "corrected"]
    call("shallow", output, *options, "--schedule", "cosine")
    model = gn.load_ggcnn(output)
    architecture = "C5x5x4_C5x5x4_C3x3x4_T3x3x2_T5x5x4"
    assert str(gn.architecture_of(model)) == architecture
    with output.with_suffix(".csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["stage"], row["epoch"]) for row in rows] == [("0", "0"), ("1", "1"), ("1", "2")]
    assert cv2.imread(str(output.with_suffix(".png"))).std() > 10  # not blank
    facts = json.loads(output.with_suffix(".json").read_text())
    assert facts["architecture"] == architecture
    assert facts["wider_noise"] == 0.3
    assert [stage["operation"] for stage in facts["stages"]] == ["deeper(1)", "wider(3)"]
    assert [stage["epochs"] for stage in facts["stages"]] == [1, 2]
    assert [stage["learning_rate_schedule"] for stage in facts["stages"]] == [None, "cosine"]
    assert facts["operations"] == gn.history_of(model)
    assert facts["operations"][1]["seed"] == facts["stages"][1]["seed"] != facts["recipe"]["seed"]
    assert sorted(path.name for path in (tmp_path / "grown.hdf5.training").iterdir()) == ["stage_0", "stage_1"]


def test_the_control_is_as_long_and_does_not_grow(call, tmp_path):
    output = tmp_path / "control.hdf5"
    call("shallow", output, "--repeat", 2, "--epochs", 1, "--final-epochs", 1)
    assert str(gn.architecture_of(gn.load_ggcnn(output))) == ARCHITECTURE
    facts = json.loads(output.with_suffix(".json").read_text())
    assert [stage["operation"] for stage in facts["stages"]] == [None, None]
    assert facts["last_epoch"]["epoch"] == 2


def test_the_record_tells_what_made_the_network_it_started_from(call, tmp_path):
    first, second, third = (tmp_path / f"{name}.hdf5" for name in ("first", "second", "third"))
    call("shallow", first, "--epochs", 1)
    call(first, second, "--epochs", 1)
    before, facts = (json.loads(path.with_suffix(".json").read_text()) for path in (first, second))
    assert "network_made_by" not in before
    assert facts["network_made_by"] == before
    first.with_suffix(".json").write_text(second.with_suffix(".json").read_text())  # a record of another file
    call(first, third, "--epochs", 1)
    assert "network_made_by" not in json.loads(third.with_suffix(".json").read_text())


def test_a_network_of_the_zoo_brings_its_record_without_its_results():
    record = made_by("zoo:narrow")
    assert record["command"].startswith("ggcnn-net2net train narrow")
    assert {"sim", "iou"} < set(zoo.provenance("narrow"))
    assert not {"sim", "iou"} & set(record)
    assert made_by("narrow") is None  # the architecture


@pytest.mark.parametrize(
    ("network", "protocol", "noted"),
    [("zoo:narrow", PAPER, True), ("zoo:narrow", CORRECTED, False), ("narrow", PAPER, False)],
)
def test_a_network_that_learnt_with_another_loss_is_noted(network, protocol, noted, capsys):
    note_other_loss(network, protocol)
    assert ("trained with the loss of CORRECTED" in capsys.readouterr().err) == noted


def test_wrong_operations_are_refused_before_any_training(call, tmp_path):
    output = tmp_path / "model.hdf5"
    with pytest.raises(click.UsageError, match="received both"):
        call("shallow", output, "--ops", "deeper(1)", "--repeat", 2)
    with pytest.raises(SurgeryError, match=r"deeper\(3\)"):
        call("shallow", output, "--ops", "deeper")
    with pytest.raises(SurgeryError, match="operation 2 of 2"):
        call("shallow", output, "--ops", "deeper(1), wider(20)")
    with pytest.raises(TrainingError, match="one operation or more"):
        call("shallow", output, "--ops", "")
    assert list(tmp_path.iterdir()) == []


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


def test_an_interrupted_restart_does_not_tell_to_restart_again(dataset, tmp_path, monkeypatch, capsys):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("ggcnn_net2net.training.set_threads", lambda threads: None)
    monkeypatch.setattr("ggcnn_net2net.training.stages.train_stages", interrupt)
    for options, command in (
        ((), "the same command goes"),
        (("--restart",), "the same command without --restart goes"),
    ):
        with pytest.raises((KeyboardInterrupt, click.Abort)):
            train_command.main(
                ["shallow", str(dataset), "-o", str(tmp_path / "x.hdf5"), *options], standalone_mode=False
            )
        assert command in capsys.readouterr().err


@pytest.fixture
def raw(tmp_path):
    """A folder of three scenes in Cornell's format."""
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
    def refused(message, stored=None):
        arguments = ["shallow", stored, "-o", tmp_path / "x.hdf5", "--fresh-from", raw]
        with pytest.raises(DatasetError, match=message):
            train_command.main([str(part) for part in arguments], standalone_mode=False)

    with pytest.raises(DatasetError, match="which holds how its samples were drawn"):
        call("shallow", tmp_path / "x.hdf5", "--fresh-from", raw)
    stored, split = tmp_path / "stored.h5", Split(train=("pcd0000", "pcd0001"), test=("pcd0002",))
    build_dataset(open_scenes(raw), split, stored, Augmentation(per_scene=2), seed=5)
    depth = raw / "pcd0001d.tiff"
    cv2.imwrite(str(depth), cv2.imread(str(depth), cv2.IMREAD_UNCHANGED)[::-1])  # another scene of this name
    refused("other scenes with the same names: the depth of pcd0001 differs", stored)
    depth.unlink()
    refused("2 scenes, 1 of which are in the folder", stored)


def test_the_folder_of_the_checkpoints_is_looked_at_before_the_work(dataset, tmp_path):
    (tmp_path / "file").touch()
    options = ["shallow", dataset, "-o", tmp_path / "x.hdf5", "--checkpoint-dir", tmp_path / "file" / "deep"]
    with pytest.raises(click.BadParameter, match="is a file"):
        train_command.main([str(part) for part in options], standalone_mode=False)


def test_nothing_that_is_read_is_written_over(call, dataset, tmp_path):
    copy = tmp_path / "grasps.hdf5"
    copy.write_bytes(dataset.read_bytes())
    options = ["shallow", copy, "-o", copy, "--epochs", 1]
    result = CliRunner().invoke(train_command, [str(part) for part in options], standalone_mode=False)
    assert isinstance(result.exception, ModelFileError)
    assert "another output file than the input" in str(result.exception)
    assert copy.read_bytes() == dataset.read_bytes()
    network = tmp_path / "network.hdf5"
    call("shallow", network, "--epochs", 1)
    with pytest.raises(ModelFileError, match="another output file than the input"):
        call(network, tmp_path / ".." / tmp_path.name / "network.hdf5", "--epochs", 2)


def test_the_record_of_the_network_is_not_lost(call, tmp_path):
    output = tmp_path / "mine.hdf5"
    call(ARCHITECTURE, output, "--epochs", 1, "--no-validation")
    before = output.with_suffix(".json").read_bytes()
    with pytest.raises(ModelFileError, match=r"another name .*mine\.json would be lost"):
        call(output, output.with_suffix(".keras"), "--epochs", 1, "--no-validation")
    assert output.with_suffix(".json").read_bytes() == before
    raw = tmp_path / "raw.hdf5"
    raw.write_bytes(output.read_bytes())  # it has no record, so there is none to lose
    for epochs in (1, 2):  # the second time, that of the result lies there
        call(raw, raw.with_suffix(".keras"), "--epochs", epochs, "--no-validation")


def test_a_teacher_is_learnt_from_and_on_record(call, tmp_path):
    teacher, labels, taught = (tmp_path / f"{name}.hdf5" for name in ("teacher", "labels", "taught"))
    call(ARCHITECTURE, teacher, "--epochs", 1, "--seed", 5)
    options = ("--epochs", 1, "--protocol", "corrected")
    call(ARCHITECTURE, labels, *options)
    call(ARCHITECTURE, taught, *options, "--distil", teacher, "--distil-weight", 1)
    facts = json.loads(taught.with_suffix(".json").read_text())
    assert facts["teacher"] == {"network": str(teacher), "sha256": sha256_of(teacher), "weight": 1.0}
    assert facts["recipe"]["protocol"]["masked_loss"] is False
    assert "teacher" not in json.loads(labels.with_suffix(".json").read_text())
    loss = {path: json.loads(path.with_suffix(".json").read_text())["last_epoch"]["loss"] for path in (labels, taught)}
    assert loss[taught] != loss[labels]
    before = teacher.read_bytes()
    with pytest.raises(ModelFileError, match="another output file than the input"):
        call(ARCHITECTURE, teacher, *options, "--distil", teacher)
    with pytest.raises(ModelFileError, match="another name"):
        call(ARCHITECTURE, teacher.with_suffix(".keras"), *options, "--distil", teacher)
    assert teacher.read_bytes() == before
    with pytest.raises(click.UsageError, match="expected --distil TEACHER"):
        call(ARCHITECTURE, taught, *options, "--distil-weight", 0.2)
    with pytest.raises(TrainingError, match="another"):  # a checkpoint of another teacher is another run's
        call(ARCHITECTURE, taught, *options, "--distil", labels)


def test_threads_reach_tensorflow(call, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr("ggcnn_net2net.training.set_threads", asked.append)
    call(ARCHITECTURE, tmp_path / "mine.hdf5", "--epochs", 1, "--no-validation", "--threads", 3)
    assert asked == [3]


def test_a_folder_does_not_hide_an_architecture(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for epochs in (1, 2):  # the second time, the folder "shallow" is there
        call("shallow", Path("shallow") / "network.hdf5", "--epochs", epochs)


@pytest.mark.parametrize("options", [("--no-validation", "--validation"), ("--validation", "--no-validation")])
def test_a_run_can_be_prolonged_with_validation_or_without(call, tmp_path, options):
    output = tmp_path / "shallow.hdf5"
    for epochs, option in enumerate(options, start=1):
        shown = call("shallow", output, "--epochs", epochs, option)
    assert "val_loss" in shown
    with output.with_suffix(".csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["val_loss"] != "" for row in rows] == [option == "--validation" for option in options]
    assert json.loads(output.with_suffix(".json").read_text())["last_epoch"]["epoch"] == 1
