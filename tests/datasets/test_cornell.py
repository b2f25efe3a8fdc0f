import cv2
import numpy as np
import pytest
from small_scenes import tilted_plane, write_cloud, write_cornell_scene

from ggcnn_net2net.datasets.cornell import open_cornell, read_cloud, read_depth, read_rectangles
from ggcnn_net2net.errors import DatasetError
from ggcnn_net2net.grasping import rectangle_to_grasp


def problems(scenes):
    return {problem.file: problem.problem for problem in scenes.report}


def test_real_scenes(data_root):
    """100 real scenes: what was counted in the files."""
    scenes = open_cornell(data_root / "cornell")
    assert len(scenes) == 100
    assert sum(len(file.rectangles) for file in scenes.files) == 473
    assert sum("left out" in problem.problem for problem in scenes.report) == 3  # rectangles with NaN
    scene = scenes[0]
    assert scene.name == "pcd0100"
    assert scene.depth.shape == (480, 640)
    assert 1.1 < np.median(scene.depth) < 1.3
    # "253 319.7" is x and y of the first corner; the opening is across the remote control, which stands upright.
    np.testing.assert_allclose(scene.rectangles[0, 0], [319.7, 253])
    grasp, jaw = rectangle_to_grasp(scene.rectangles[0])
    assert abs(grasp.angle) < 0.2
    assert grasp.width_px == pytest.approx(56.2, abs=0.1)
    assert jaw == pytest.approx(26.1, abs=0.1)


def test_openings_span_the_objects(data_root):
    """Along the edge 0-1 the object is seen in the middle and the table at both ends: depth tells which is which."""
    nearer = []
    for scene in open_cornell(data_root / "cornell")[:30]:
        for corners in scene.rectangles:
            points = [corners.mean(axis=0), corners[[0, 3]].mean(axis=0), corners[[1, 2]].mean(axis=0)]
            middle, left, right = (scene.depth[tuple(np.round(point).astype(int))] for point in points)
            nearer.append(middle < (left + right) / 2)
    assert np.mean(nearer) > 0.8


def test_objects_of_the_list(cornell):
    assert set(open_cornell(cornell).objects.values()) == {"0 thing0", "1 thing1", "2 thing2"}
    (cornell / "processedData").mkdir()
    (cornell / "z.txt").rename(cornell / "processedData" / "z.txt")
    assert open_cornell(cornell).objects["pcd0103"] == "1 thing1"
    with (cornell / "processedData" / "z.txt").open("a") as stream:
        stream.write("nonsense\n")
    assert "line 7" in problems(open_cornell(cornell))["processedData/z.txt"]


def test_without_a_list_each_scene_is_an_object(cornell):
    (cornell / "z.txt").unlink()
    scenes = open_cornell(cornell)
    assert scenes.objects["pcd0103"] == "pcd0103"
    assert "object of its own" in problems(scenes)["z.txt"]


def test_a_list_without_some_scenes_is_reported(cornell):
    lines = (cornell / "z.txt").read_text().splitlines()
    (cornell / "z.txt").write_text("\n".join(lines[:-2]))
    scenes = open_cornell(cornell)
    missing = [name for name, thing in scenes.objects.items() if name == thing]
    assert len(missing) == 2
    assert problems(scenes)["z.txt"].startswith(f"2 scenes are not in it, {missing[0]} for one: each counts as")
    (cornell / "z.txt").write_text("")
    assert problems(open_cornell(cornell))["z.txt"].startswith("6 scenes are not in it")


def test_damage_is_reported_and_left_out(cornell):
    (cornell / "01" / "pcd0100r.png").unlink()
    (cornell / "01" / "pcd0101d.tiff").unlink()
    (cornell / "01" / "pcd0102cpos.txt").write_text("NaN NaN\n" * 4)
    good = "10 20\n50 20\n50 40\n10 40\n"
    (cornell / "02" / "pcd0103cpos.txt").write_text(good + "NaN 1\n2 3\n4 5\n6 7\n" + good + "1 2\n3 4\n")
    write_cornell_scene(cornell / "02", 101)
    scenes = open_cornell(cornell)
    assert [file.name for file in scenes.files] == ["pcd0103", "pcd0104", "pcd0105"]
    assert len(scenes.files[0].rectangles) == 2
    found = problems(scenes)
    assert found["01/pcd0100"] == "scene left out: no pcd0100r.png"
    assert "pcd0101.txt" in found["01/pcd0101"]
    assert "no usable rectangle" in found["01/pcd0102cpos.txt"]
    assert "also in 01" in found["02/pcd0101r.png"]
    assert sorted(problem.problem.split()[0] for problem in scenes.report if "pcd0103" in problem.file) == [
        "rectangle",
        "the",
    ]


def test_rectangles_in_lines_x_y(tmp_path):
    path = tmp_path / "pcd0100cpos.txt"
    path.write_text("1 2\n3 4 \n5.5 6\n7 8\n\n")
    rectangles, flaws = read_rectangles(path)
    np.testing.assert_array_equal(rectangles, [[[2, 1], [4, 3], [6, 5.5], [8, 7]]])
    assert flaws == []
    for text in ("1 2\n1 2\n5 6\n7 8", "1 2\n3 4\n3 4\n7 8", "1 2\nx 4\n5 6\n7 8", "1 2\n3\n5 6\n7 8"):
        path.write_text(text)
        assert len(read_rectangles(path)[0]) == 0
        assert len(read_rectangles(path)[1]) == 1


def test_depth_units(tmp_path):
    depth = tilted_plane()
    path = tmp_path / "d.tiff"
    cv2.imwrite(str(path), depth)
    np.testing.assert_array_equal(read_depth(path), depth)
    millimetres = np.round(depth * 1000).astype(np.uint16)
    millimetres[50:55, 60:66] = 0
    cv2.imwrite(str(path), millimetres)
    np.testing.assert_allclose(read_depth(path), depth, atol=0.003)
    for wrong in (depth * 1000, np.zeros_like(depth)):
        cv2.imwrite(str(path), wrong)
        with pytest.raises(DatasetError, match="unit"):
            read_depth(path)
    cv2.imwrite(str(path), np.zeros((480, 640, 3), np.uint8))
    with pytest.raises(DatasetError, match="uint8"):
        read_depth(path)


def test_clouds(tmp_path):
    depth = tilted_plane()
    missing = np.random.default_rng(0).random(depth.shape) < 0.05
    missing[:4] = True
    write_cloud(tmp_path / "pcd0100.txt", depth, missing)
    read = read_cloud(tmp_path / "pcd0100.txt")
    assert read.dtype == np.float32
    np.testing.assert_allclose(read[~missing], depth[~missing], rtol=1e-5)
    np.testing.assert_allclose(read[missing], depth[missing], atol=0.01)


def test_a_scene_with_a_cloud_only(cornell):
    depth = tilted_plane() + 0.1
    (cornell / "01" / "pcd0100d.tiff").unlink()
    write_cloud(cornell / "01" / "pcd0100.txt", depth, np.zeros(depth.shape, bool))
    np.testing.assert_allclose(open_cornell(cornell)[0].depth, depth, rtol=1e-5)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "x y z\n1 2 3\n",
        "DATA binary\n",
        "DATA ascii\n",
        "DATA ascii\n1 2 3 0 307200\n",
        "DATA ascii\n1 2 3 0 -1\n",
        "DATA ascii\n1 2 3\n",
        "DATA ascii\n1 2 three 0 5\n",
    ],
)
@pytest.mark.filterwarnings("ignore:loadtxt")
def test_clouds_that_are_none(tmp_path, text):
    (tmp_path / "pcd0100.txt").write_text(text)
    with pytest.raises(DatasetError, match=r"pcd0100\.txt"):
        read_cloud(tmp_path / "pcd0100.txt")


def test_images_of_two_sizes(cornell):
    cv2.imwrite(str(cornell / "01" / "pcd0100d.tiff"), tilted_plane((240, 320)))
    with pytest.raises(DatasetError, match="one size"):
        open_cornell(cornell)[0]
