import h5py
import numpy as np
import pytest

from ggcnn_net2net.datasets.concatenation import concatenate, splits_of
from ggcnn_net2net.datasets.hdf5 import DatasetWriter, GraspDataset
from ggcnn_net2net.errors import DatasetError


def write(path, items):
    with DatasetWriter(path, {"source": path.stem}) as writer:
        for split, sample in items:
            writer.add(split, sample)
    return path


def test_rows_in_order_with_their_provenance(tmp_path, samples):
    first = write(tmp_path / "first.h5", [("train", samples[0]), ("test", samples[1])])
    second = write(tmp_path / "second.h5", [("train", samples[2])])
    with h5py.File(second, "r+") as file:
        del file["train/rgb"]  # files of others may lack it
    rows = concatenate([first, second], tmp_path / "both.h5")
    assert rows == {"train": 2, "test": 1}
    train, test = splits_of(tmp_path / "both.h5")
    assert (train.split, test.split) == ("train", "test")
    assert train.image_ids == ["a", "c"]
    np.testing.assert_array_equal(train.sample(1).depth, samples[2].depth)
    np.testing.assert_array_equal(train.rectangles(1), samples[2].rectangles)
    assert (train.sample(1).rgb == 0).all()
    assert test.fingerprint == GraspDataset(first, "test").fingerprint
    assert [part["source"] for part in train.attributes["parts"]] == ["first", "first", "second"]


def test_written_anew_without_compression(tmp_path, samples):
    first = write(tmp_path / "first.h5", [("train", samples[0]), ("test", samples[1])])
    concatenate([first], tmp_path / "large.h5", compressed=False)
    for part, before in zip(splits_of(tmp_path / "large.h5"), splits_of(first), strict=True):
        assert part.fingerprint == before.fingerprint
    with h5py.File(tmp_path / "large.h5") as file:
        assert file["train/depth_inpainted"].compression is None


def test_a_scene_on_both_sides_is_refused(tmp_path, samples):
    first = write(tmp_path / "first.h5", [("train", samples[0])])
    second = write(tmp_path / "second.h5", [("test", samples[0])])
    with pytest.raises(DatasetError, match="images of a in one split"):
        concatenate([first, second], tmp_path / "both.h5")
    assert not (tmp_path / "both.h5").exists()


def test_files_that_are_none(tmp_path):
    (tmp_path / "text.h5").write_text("no")
    with pytest.raises(DatasetError, match="HDF5"):
        splits_of(tmp_path / "text.h5")
    h5py.File(tmp_path / "empty.h5", "w").close()
    with pytest.raises(DatasetError, match="'train'"):
        splits_of(tmp_path / "empty.h5")
