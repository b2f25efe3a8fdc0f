import pytest

from ggcnn_net2net.datasets.raw import open_scenes, read_image
from ggcnn_net2net.errors import DatasetError


def test_folder_is_a_sequence_that_reads_on_demand(cornell):
    scenes = open_scenes(cornell)
    assert scenes.form == "cornell"
    assert [scene.name for scene in scenes] == [f"pcd010{index}" for index in range(6)]
    assert scenes[-1].name == "pcd0105"
    assert [scene.name for scene in scenes[1:3]] == ["pcd0101", "pcd0102"]
    assert [scene.name for scene in scenes.only(["pcd0104", "pcd0100"])] == ["pcd0100", "pcd0104"]
    assert scenes[0].rgb[0, 0].tolist() == [100, 2, 1]  # red, green, blue


def test_unusable_folders_are_refused(tmp_path, cornell):
    with pytest.raises(DatasetError, match="folder"):
        open_scenes(tmp_path / "none")
    with pytest.raises(DatasetError, match="cornell or jacquard"):
        open_scenes(cornell, "kitti")
    with pytest.raises(DatasetError, match=r"pcdNNNNr\.png"):
        open_scenes(tmp_path / "cornell" / "..", "cornell").path.iterdir()
    with pytest.raises(DatasetError, match=r"_grasps\.txt"):
        open_scenes(cornell, "jacquard")


def test_files_that_are_no_images(tmp_path):
    for content in (b"", b"no image"):
        (tmp_path / "x.png").write_bytes(content)
        with pytest.raises(DatasetError, match=f"{len(content)} bytes"):
            read_image(tmp_path / "x.png")
    with pytest.raises(DatasetError, match="No such file"):
        read_image(tmp_path / "y.png")
