"""Pictures and films of real trials, by the commands that make them."""

import cv2
import imageio.v3 as imageio
import pytest
from click.testing import CliRunner

from ggcnn_net2net.cli.evaluate import evaluate
from ggcnn_net2net.cli.objects import objects
from ggcnn_net2net.cli.reproduce import reproduce
from ggcnn_net2net.errors import GGCNNError, ObjectSetError, ResultsError
from ggcnn_net2net.simulation import pictures
from ggcnn_net2net.simulation.convex import box, write_obj


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "bricks"
    folder.mkdir()
    write_obj(folder / "brick_vhacd.obj", [box((0.06, 0.15, 0.08))])
    write_obj(folder / "wall_vhacd.obj", [box((0.4, 0.4, 0.4))])  # too wide for the gripper
    (folder / "objects.csv").write_text("name\nbrick\nwall\n")
    return folder


def call(command, *arguments):
    result = CliRunner().invoke(command, [str(argument) for argument in arguments], standalone_mode=False)
    if result.exception:
        raise result.exception
    return result


def test_contact_sheet(folder, tmp_path):
    output = call(objects, folder, "--sheet", tmp_path / "sheet.png").output
    assert "brick" in output
    assert "0.150" in output
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet is not None
    assert sheet.std() > 10  # not blank


def test_one_grasp_with_picture_and_films(folder, tmp_path, data_root, monkeypatch):
    picture, gif, mp4 = (tmp_path / f"brick.{suffix}" for suffix in ("png", "gif", "mp4"))
    arguments = ("published", "--objects", folder, "--object", "brick")
    output = call(evaluate, "grasp", *arguments, "--picture", picture, "--film", gif).output
    assert output.startswith("brick/0: success")
    assert cv2.imread(str(picture)).std() > 10
    frames = imageio.imread(gif, index=None)
    assert len(frames) > 50
    assert (frames[0] != frames[-1]).mean() > 0.001  # the object moved
    call(evaluate, "grasp", *arguments, "--film", mp4)
    film = cv2.VideoCapture(str(mp4))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) > 100
    monkeypatch.setattr("ggcnn_net2net.inference.predict_grasps", lambda *_: [None])
    for name in ("none.gif", "none.mp4"):
        said = call(evaluate, "grasp", *arguments, "--film", tmp_path / name).output
        assert "no film is written" in said
        assert not (tmp_path / name).exists()
    with pytest.raises(GGCNNError, match=r"\.gif or \.mp4"):
        call(evaluate, "grasp", *arguments, "--film", tmp_path / "brick.avi")
    with pytest.raises(ObjectSetError, match="brick, wall"):
        call(evaluate, "grasp", "published", "--objects", folder, "--object", "vase")


def test_own_gripper(folder, tmp_path, data_root, monkeypatch):
    """A grasp, a benchmark in a folder of its own name, and its failures, with the gripper that is on record."""
    monkeypatch.chdir(tmp_path)
    gripper = tmp_path / "claw.toml"
    gripper.write_text("palm = [0.1, 0.02, 0.01]\nmax_opening = 0.08\n")
    options = ("--objects", folder, "--gripper", gripper)
    assert call(evaluate, "grasp", "published", "--object", "brick", *options).output.startswith("brick/0: success")
    thin = tmp_path / "thin.toml"
    thin.write_text("max_opening = 0.02\n")
    output = call(evaluate, "grasp", "published", "--object", "brick", "--objects", folder, "--gripper", thin).output
    assert output.startswith("brick/0: missed")
    call(reproduce, "table1", "--poses", 1, "--models", "original", *options)
    out = tmp_path / "results" / "table1-bricks-1poses-seed0-paper-claw"
    assert '"max_opening": 0.08' in (out / "results.json").read_text()
    used = []
    run_trial = pictures.run_trial
    monkeypatch.setattr(pictures, "run_trial", lambda *args, **kwargs: used.append(args) or run_trial(*args, **kwargs))
    call(evaluate, "failures", out, "--objects", folder, "-o", tmp_path / "failures.png")
    assert [arguments[4].max_opening for arguments in used] == [0.08]


def test_failures_of_a_benchmark(folder, tmp_path, data_root):
    out = tmp_path / "out"
    result = call(reproduce, "table1", "--objects", folder, "--poses", 2, "--models", "original", "-o", out)
    assert "2/4" in result.output
    picture = tmp_path / "failures.png"
    output = call(evaluate, "failures", out, "--objects", folder, "--count", 1, "-o", picture).output
    assert "1 of 2 failures" in output
    assert cv2.imread(str(picture)).std() > 10
    with pytest.raises(ObjectSetError, match="bricks"):  # a folder is not found by its name alone
        call(evaluate, "failures", out, "-o", picture)
    with pytest.raises(ResultsError, match=r"results\.json"):
        call(evaluate, "failures", tmp_path, "-o", picture)
    with pytest.raises(ResultsError, match="one of the networks original, received 'mine'"):
        call(evaluate, "failures", out, "--objects", folder, "--network", "mine", "-o", picture)
