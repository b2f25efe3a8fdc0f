import os

import cv2
import numpy as np
import pytest
import tifffile

from ggcnn_net2net.errors import DepthImageError
from ggcnn_net2net.inference.depth_files import FolderWatch, depth_files, read_depth_file

DEPTH = np.random.default_rng(0).integers(400, 2000, (12, 16)).astype(np.uint16)


def write(path, depth=DEPTH):
    match path.suffix.lower():
        case ".png":
            path.write_bytes(cv2.imencode(".png", depth)[1].tobytes())
        case ".tiff" | ".tif":
            tifffile.imwrite(path, depth)
        case ".npy":
            np.save(path, depth)
        case _:
            np.savez(path, depth)
    return path


@pytest.mark.parametrize("name", ["a.png", "b.tiff", "c.tif", "d.npy", "e.npz", "F.PNG"])
def test_every_format_keeps_its_values(tmp_path, name):
    image = read_depth_file(write(tmp_path / name))
    np.testing.assert_array_equal(image, DEPTH)
    assert image.dtype == np.uint16


@pytest.mark.parametrize("name", ["b.tiff", "d.npy", "e.npz"])
def test_floats_keep_their_holes(tmp_path, name):
    depth = (DEPTH / 1000).astype(np.float32)
    depth[3, 4] = np.nan
    np.testing.assert_array_equal(read_depth_file(write(tmp_path / name, depth)), depth)


def test_archives_of_several_arrays(tmp_path):
    np.savez(tmp_path / "scene.npz", rgb=np.zeros((2, 2, 3)), depth=DEPTH)
    np.testing.assert_array_equal(read_depth_file(tmp_path / "scene.npz"), DEPTH)
    np.savez(tmp_path / "scene.npz", rgb=np.zeros((2, 2, 3)), far=DEPTH)
    with pytest.raises(DepthImageError, match="rgb, far"):
        read_depth_file(tmp_path / "scene.npz")


@pytest.mark.parametrize("name", ["a.png", "b.tiff", "d.npy", "e.npz", "f.txt"])
@pytest.mark.parametrize("content", [b"", b"nonsense", None])
def test_what_cannot_be_read_is_explained(tmp_path, name, content):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DepthImageError, match=path.name):
        read_depth_file(path)


def test_half_an_array_file_is_explained(tmp_path):
    for name in ("d.npy", "e.npz", "a.png"):
        path = write(tmp_path / name)
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        with pytest.raises(DepthImageError, match=path.name):
            read_depth_file(path)


def test_a_damaged_archive_is_explained(tmp_path):
    path = tmp_path / "e.npz"
    np.savez_compressed(path, depth=np.random.default_rng(0).integers(0, 9, (40, 40)))
    content = bytearray(path.read_bytes())
    content[80:180] = bytes(100)  # no deflate stream
    path.write_bytes(content)
    with pytest.raises(DepthImageError, match=path.name):
        read_depth_file(path)


@pytest.mark.parametrize("depth", [DEPTH.astype(np.uint8), np.zeros((4, 4, 3), np.uint16)])
def test_pictures_are_no_depth(tmp_path, depth):
    with pytest.raises(DepthImageError, match="8 bits or colours"):
        read_depth_file(write(tmp_path / "a.png", depth))


def test_arrays_that_carry_code_are_refused(tmp_path):
    np.save(tmp_path / "a.npy", np.array([print], dtype=object), allow_pickle=True)
    with pytest.raises(DepthImageError, match="file of numbers"):
        read_depth_file(tmp_path / "a.npy")


def test_depth_files_of_a_folder(tmp_path):
    for name in ("b.png", "a.npy", "c.tiff", "pcd0100d.tiff", ".d.tmp.npy"):
        write(tmp_path / name)
    write(tmp_path / "colour.png", np.zeros((4, 4, 3), np.uint8))
    write(tmp_path / "grey.png", np.zeros((4, 4), np.uint8))
    (tmp_path / "empty.png").touch()
    (tmp_path / "notes.txt").touch()
    (tmp_path / "folder.npy").mkdir()
    assert [path.name for path in depth_files(tmp_path)] == ["a.npy", "b.png", "c.tiff", "pcd0100d.tiff"]
    with pytest.raises(DepthImageError, match="none"):
        depth_files(tmp_path / "none")


def test_of_a_cornell_folder_only_the_depth_counts(data_root):
    names = [path.name for path in depth_files(data_root / "cornell" / "01")]
    assert len(names) == 100
    assert names[:2] == ["pcd0100d.tiff", "pcd0101d.tiff"]


def test_watching(tmp_path):
    old, new = write(tmp_path / "old.npy"), tmp_path / "new.npy"
    watch = FolderWatch(tmp_path)
    assert watch.ready() == []
    new.write_bytes(b"begun")
    assert watch.ready() == []  # seen for the first time: may be growing
    write(new)
    assert watch.ready() == []  # it was
    assert watch.ready() == [new]
    assert watch.ready() == []
    write(old, DEPTH[:6])  # written again
    assert watch.ready() == []
    assert watch.ready() == [old]
    new.unlink()
    assert watch.ready() == []
    write(new)
    os.utime(new, (1e9, 1e9))  # as old as nothing before
    assert watch.ready() == []
    assert watch.ready() == [new]
