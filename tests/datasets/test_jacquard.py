import shutil

import cv2
import numpy as np
import pytest

from ggcnn_net2net.datasets.augmentation import PLAIN
from ggcnn_net2net.datasets.build import build_dataset
from ggcnn_net2net.datasets.hdf5 import GraspDataset
from ggcnn_net2net.datasets.jacquard import open_jacquard, read_grasps
from ggcnn_net2net.datasets.raw import open_scenes, read_image
from ggcnn_net2net.datasets.splits import make_split
from ggcnn_net2net.errors import DatasetError
from ggcnn_net2net.grasping import rectangle_to_grasp


@pytest.fixture
def folder(data_root):
    return data_root / "jacquard_samples"


@pytest.fixture
def made(tmp_path):
    """A scene as Jacquard has it, of 600x600 px: a bar, and a grasp across it, turned clockwise by 30 degrees."""
    folder = tmp_path / "bar"
    folder.mkdir()
    rows, cols = np.indices((600, 600))
    turn = np.radians(30)
    across, along = (
        (cols - 400) * np.cos(turn) + (rows - 200) * np.sin(turn),
        (rows - 200) * np.cos(turn) - (cols - 400) * np.sin(turn),
    )
    bar = (np.abs(across) < 20) & (np.abs(along) < 120)
    depth = np.where(bar, 1.4, 1.5).astype(np.float32)
    cv2.imwrite(str(folder / "0_bar_RGB.png"), np.where(bar, 200, 50)[..., None].repeat(3, -1).astype(np.uint8))
    cv2.imwrite(str(folder / "0_bar_perfect_depth.tiff"), depth)
    depth[500:505, 100:105] = -1
    cv2.imwrite(str(folder / "0_bar_stereo_depth.tiff"), depth)
    (folder / "0_bar_grasps.txt").write_text("400.0;200.0;30.0;60.0;20.0\n")
    return tmp_path


def test_a_scene_in_numbers(made):
    (scene,) = open_scenes(made)
    assert (scene.name, scene.object_name, scene.depth.shape) == ("0_bar", "bar", (300, 300))
    grasp, jaw = rectangle_to_grasp(scene.rectangles[0])
    # The centre of pixel 400 of 600 is that of pixel 199.75 of 300; the angle counts counter-clockwise.
    assert (grasp.row, grasp.col) == pytest.approx((99.75, 199.75))
    assert (grasp.angle, grasp.width_px, jaw) == pytest.approx((-np.radians(30), 30, 10))
    on_bar = [corners.mean(axis=0) for corners in (scene.rectangles[0],)]
    beside = [scene.rectangles[0][edge].mean(axis=0) for edge in ([0, 3], [1, 2])]
    depths = [scene.depth[tuple(np.round(point).astype(int))] for point in (*on_bar, *beside)]
    assert depths == pytest.approx([1.4, 1.5, 1.5])


def test_of_scenes_of_one_name_the_first_counts(made):
    shutil.copytree(made / "bar", made / "copy of bar")
    folder = open_jacquard(made)
    assert [scene.name for scene in folder] == ["0_bar"]
    assert [problem.problem for problem in folder.report] == ["scene left out: another folder has one of this name"]


def test_holes_of_the_stereo_camera_are_filled(made):
    perfect, stereo = (open_jacquard(made, depth)[0].depth for depth in ("perfect", "stereo"))
    np.testing.assert_allclose(stereo, perfect, atol=1e-4)


def test_real_scenes(folder):
    scenes = open_scenes(folder)
    assert scenes.form == "jacquard"
    assert len(scenes) == 9
    assert len(set(scenes.objects.values())) == 3
    assert scenes.report == ()
    scene = scenes[3]
    assert scene.name == "0_1d7830c5d0322518d95aa859a460a9ec"
    assert scene.object_name == "1d7830c5d0322518d95aa859a460a9ec"
    assert scene.depth.shape == (300, 300)
    assert scene.depth.dtype == np.float32
    assert scene.rgb.shape == (300, 300, 3)
    assert 1.4 < np.median(scene.depth) < 1.6
    grasp, jaw = rectangle_to_grasp(scene.rectangles[0])  # 532.79;517.95;-67.83;184.5;25.7 of 1024 pixels
    assert grasp.col == pytest.approx(532.79 * 300 / 1024, abs=0.5)
    assert grasp.row == pytest.approx(517.95 * 300 / 1024, abs=0.5)
    assert grasp.angle == pytest.approx(np.radians(67.8274))
    assert grasp.width_px == pytest.approx(184.5 * 300 / 1024)
    assert jaw == pytest.approx(25.7075 * 300 / 1024)


def test_jaws_close_on_the_object(folder):
    """With the sign of the angle changed, jaws lie beside the object and its middle between them."""
    inside, outside = [], []
    for file in open_jacquard(folder).files:
        mask = read_image(file.labels.with_name(f"{file.name}_mask.png")) > 0
        for corners in read_grasps(file.labels):
            for point, found in (
                (corners.mean(axis=0), inside),
                (corners[[0, 3]].mean(axis=0), outside),
                (corners[[1, 2]].mean(axis=0), outside),
            ):
                row, col = np.clip(np.round(point).astype(int), 0, 1023)
                found.append(mask[row, col])
    assert np.mean(outside) < 0.12
    assert np.mean(inside) > 0.8  # some rectangles hold two bars, with a gap in the middle


def test_stereo_depth_has_its_holes_filled(folder):
    perfect, stereo = (open_jacquard(folder, depth)[0].depth for depth in ("perfect", "stereo"))
    assert stereo.min() > 0
    assert (stereo < 1).mean() < 0.02  # false matches of the stereo pair, which are not holes
    assert np.median(np.abs(stereo - perfect)) < 0.01
    with pytest.raises(DatasetError, match="perfect or stereo"):
        open_jacquard(folder, "lidar")


def test_damage_is_reported_and_left_out(folder, tmp_path):
    source = folder / "1d7830c5d0322518d95aa859a460a9ec"
    copy = tmp_path / source.name
    shutil.copytree(source, copy, copy_function=shutil.copyfile)
    copy.chmod(0o755)
    (copy / f"0_{source.name}_perfect_depth.tiff").unlink()
    (copy / f"1_{source.name}_grasps.txt").write_text("1;2;3\n")
    (copy / f"2_{source.name}_perfect_depth.tiff").write_bytes(b"II*\0")
    scenes = open_jacquard(tmp_path)
    assert [file.name for file in scenes.files] == [f"2_{source.name}"]
    assert ["perfect_depth" in problem.problem for problem in scenes.report] == [True, False]
    with pytest.raises(DatasetError, match="4 bytes"):
        scenes[0]


@pytest.mark.parametrize("text", ["", "1;2;3;4\n", "1;2;3;0;5\n", "1;2;nan;4;5\n", "a;b;c;d;e\n"])
@pytest.mark.filterwarnings("ignore:loadtxt")
def test_grasps_that_are_none(tmp_path, text):
    (tmp_path / "0_x_grasps.txt").write_text(text)
    with pytest.raises(DatasetError, match="expected lines"):
        read_grasps(tmp_path / "0_x_grasps.txt")
    with pytest.raises(DatasetError, match="left out"):
        open_jacquard(tmp_path)


def test_the_kind_of_depth_is_recorded(folder, tmp_path):
    scenes = open_scenes(folder, depth="stereo")
    split = make_split(scenes.objects, "image", 0.3, 0)
    build_dataset(scenes, split, tmp_path / "stereo.h5", PLAIN)
    assert GraspDataset(tmp_path / "stereo.h5", "train").attributes["depth"] == "stereo"
