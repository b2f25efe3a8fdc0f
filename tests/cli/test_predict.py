import json
import time

import click
import numpy as np
import pytest
from click.testing import CliRunner

import ggcnn_net2net as gn
from ggcnn_net2net.cli import predict
from ggcnn_net2net.errors import DepthImageError, ModelFileError
from ggcnn_net2net.inference.presets import PRESETS

SIDE = 36


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    """An untrained network that sees grasps, as far as the preset kinova lets it: its quality is around 0.5."""
    path = tmp_path_factory.mktemp("network") / "small.hdf5"
    model = gn.build_ggcnn("shallow", input_size=SIDE, seed=0)
    for name in ("pos_out", "width_out"):
        kernel, bias = model.get_layer(name).get_weights()
        model.get_layer(name).set_weights([kernel, bias + 0.5])
    gn.save_ggcnn(model, path)
    return path


def image(path, seed=0, scale=1000, dtype=np.uint16):
    depth = np.random.default_rng(seed).uniform(0.7, 1.3, (60, 80)) * scale
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, depth.astype(dtype))
    return path


def call(*arguments):
    """Output, errors, and the exception if there is one."""
    result = CliRunner().invoke(predict.predict_command, [*map(str, arguments)], standalone_mode=False)
    return result.stdout, result.stderr, result.exception


def test_the_presets_on_offer_are_all():
    (option,) = [option for option in predict.predict_command.params if option.name == "preset"]
    assert option.type.choices == tuple(PRESETS)


def test_images_become_json_and_pictures(network, tmp_path):
    inputs = [image(tmp_path / "in" / f"{name}.npy", seed) for seed, name in enumerate("ab")]
    (tmp_path / "in" / "notes.txt").touch()
    camera = ("--fx", 90, "--fy", 90, "--cx", 40, "--cy", 30)
    options = ("--network", network, "--preset", "kinova", "--n-grasps", 2, "-o", tmp_path / "out")
    text, errors, failure = call(tmp_path / "in", inputs[0], *options, *camera)
    assert (errors, failure) == ("", None)
    assert "unit detected" in text and " mm " in text
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "a_grasps.json",
        "a_grasps.png",
        "b_grasps.json",
        "b_grasps.png",
    ]
    content = json.loads((tmp_path / "out" / "a_grasps.json").read_text())
    assert content["depth_unit_is"] == "detected"
    assert (content["preset"]["name"], content["mode"], content["network"]) == ("kinova", "crop", str(network))
    assert content["camera"] == {"fx": 90.0, "fy": 90.0, "cx": 40.0, "cy": 30.0}
    expected = gn.GraspPredictor(network, preset="kinova").predict(
        np.load(inputs[0]), camera=gn.Intrinsics(90, 90, 40, 30), n_grasps=2
    )
    assert len(expected) == len(content["grasps"]) == 2
    for grasp, written in zip(expected, content["grasps"], strict=True):
        assert tuple(written["position"]) == grasp.position
        assert (written["row"], written["angle"], written["opening"]) == (grasp.row, grasp.angle, grasp.opening)


def test_a_bad_image_does_not_stop_the_others(network, tmp_path):
    good = image(tmp_path / "good.npy")
    unclear = image(tmp_path / "unclear.npy", scale=50)
    text = tmp_path / "text.npy"
    text.write_text("none")
    elsewhere = image(tmp_path / "other" / "good.npy")
    _, errors, failure = call(
        unclear, text, good, elsewhere, "-o", tmp_path / "out", "--network", network, "--preset", "kinova"
    )
    assert isinstance(failure, DepthImageError)
    assert "3 of 4 images" in str(failure)
    lines = errors.splitlines()
    assert f"{unclear}: " in lines[0]
    assert "depth_unit" in lines[0]
    assert f"{text}: " in lines[1]
    assert "rename one" in lines[2]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["good_grasps.json", "good_grasps.png"]
    assert json.loads((tmp_path / "out" / "good_grasps.json").read_text())["image"] == str(good)
    text_of_told, _, failure = call(
        unclear, "--depth-unit", "mm", "-o", tmp_path / "out", "--network", network, "--preset", "kinova"
    )
    assert failure is None
    assert "unit told" in text_of_told and " mm " in text_of_told


def test_no_grasp_is_said(network, tmp_path):
    text, _, failure = call(
        image(tmp_path / "a.npy"), "-o", tmp_path, "--network", network
    )  # peaks only off the border
    assert failure is None
    assert "no grasp" in text
    assert json.loads((tmp_path / "a_grasps.json").read_text())["grasps"] == []


def test_watching_a_folder_until_it_is_interrupted(network, tmp_path, monkeypatch):
    folder, out = tmp_path / "incoming", tmp_path / "out"
    image(folder / "old.npy")

    def begin():
        (folder / "new.npy").write_bytes(b"half of")

    def finish():
        assert not out.exists()
        image(folder / "new.npy", dtype=np.float32, scale=1)

    def damage():
        assert sorted(path.name for path in out.iterdir()) == ["new_grasps.json", "new_grasps.png"]
        (folder / "bad.npy").write_bytes(b"nonsense")

    def repair():
        image(folder / "bad.npy")

    def nothing():
        pass

    def interrupt():
        raise KeyboardInterrupt

    steps = iter([begin, finish, nothing, nothing, damage, nothing, nothing, repair, nothing, nothing, interrupt])
    monkeypatch.setattr(time, "sleep", lambda _seconds: next(steps)())
    text, errors, failure = call("--watch", folder, "-o", out, "--network", network, "--preset", "kinova")
    assert failure is None, failure  # the bad image was replaced by a good one
    assert "Ctrl-C" in text
    assert text.rstrip().endswith("Stopped")
    assert "unit detected" in text and " m " in text
    assert "bad.npy" in errors
    assert {path.name for path in out.iterdir()} == {
        f"{name}_grasps.{suffix}" for name in ("new", "bad") for suffix in ("json", "png")
    }


def test_a_link_to_the_latest_image_may_change(network, tmp_path):
    link = tmp_path / "latest.npy"
    for name in ("a.npy", "b.npy"):
        link.unlink(missing_ok=True)
        link.symlink_to(image(tmp_path / name))
        _, errors, failure = call(link, "-o", tmp_path / "out", "--network", network)
        assert (errors, failure) == ("", None)


def test_names_with_what_pictures_take_for_formulas(network, tmp_path):
    folder = tmp_path / "in [red]"
    text, errors, failure = call(
        image(folder / "price_$5_to_$6.npy"), "-o", tmp_path / "out", "--network", network, "--preset", "kinova"
    )
    assert failure is None, errors
    assert (tmp_path / "out" / "price_$5_to_$6_grasps.png").is_file()
    assert "price_$5_to_$6.npy" in text.replace("\n", "")


def test_a_watched_folder_may_be_empty_at_first(network, tmp_path, monkeypatch):
    folder, out = tmp_path / "incoming", tmp_path / "out"
    folder.mkdir()

    def interrupt():
        raise KeyboardInterrupt

    steps = iter([lambda: image(folder / "new.npy"), *2 * [lambda: None], lambda: image(folder / "new.npy", scale=2)])
    monkeypatch.setattr(time, "sleep", lambda _seconds: next(steps, interrupt)())
    monkeypatch.chdir(tmp_path)
    _, errors, failure = call(folder, "--watch", "incoming", "-o", out, "--network", network, "--preset", "kinova")
    assert failure is None, errors
    assert (out / "new_grasps.json").is_file()


def test_camera_files(network, tmp_path):
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps({"K": [90, 0, 40, 0, 90, 30, 0, 0, 1]}))
    _, _, failure = call(
        image(tmp_path / "a.npy"), "-o", tmp_path, "--network", network, "--preset", "kinova", "--camera", camera
    )
    assert failure is None
    assert "position" in json.loads((tmp_path / "a_grasps.json").read_text())["grasps"][0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "IMAGE"),
        (["a.npy", "--fx", "90"], "all of --fx"),
        (["a.npy", "--fx", "90", "--fy", "90", "--cx", "4", "--cy", "3", "--camera", "camera.json"], "either"),
    ],
)
def test_wrong_usage(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    image(tmp_path / "a.npy")
    (tmp_path / "camera.json").write_text("{}")
    _, _, failure = call(*arguments, "-o", "out")
    assert isinstance(failure, click.UsageError)
    assert message in str(failure)


def test_nothing_to_do_it_on(tmp_path):
    image(tmp_path / "a.npy")
    assert isinstance(call(tmp_path / "a.npy", "-o", tmp_path, "--network", tmp_path / "none.hdf5")[2], ModelFileError)
    (tmp_path / "empty").mkdir()
    failure = call(tmp_path / "empty", "-o", tmp_path)[2]
    assert isinstance(failure, DepthImageError)
    assert "found none" in str(failure)


def test_what_cannot_be_written_does_not_stop_the_others(network, tmp_path):
    first, second = image(tmp_path / "first.npy"), image(tmp_path / "second.npy")
    (tmp_path / "out" / "first_grasps.json").mkdir(parents=True)
    _, errors, failure = call(first, second, "-o", tmp_path / "out", "--network", network, "--preset", "kinova")
    assert isinstance(failure, DepthImageError)
    assert f"{first}: " in errors
    assert (tmp_path / "out" / "second_grasps.json").is_file()
