from dataclasses import replace

import h5py
import numpy as np
import pytest

from ggcnn_net2net.datasets.concatenation import concatenate, splits_of
from ggcnn_net2net.datasets.hdf5 import DatasetWriter, GraspDataset
from ggcnn_net2net.errors import DatasetError


def write(path, items, **attributes):
    with DatasetWriter(path, attributes) as writer:
        for split, sample in items:
            writer.add(split, sample)
    return path


def test_rows_in_order_with_their_provenance(tmp_path, samples):
    first = write(tmp_path / "first.h5", [("train", samples[0]), ("test", samples[1])], source="scenes", seed=1)
    second = write(tmp_path / "second.h5", [("train", samples[2])], source="scenes", seed=2)
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
    assert [part["seed"] for part in train.attributes["parts"]] == [1, 1, 2]


def test_written_anew_without_compression(tmp_path, samples):
    first = write(tmp_path / "first.h5", [("train", samples[0]), ("test", samples[1])])
    concatenate([first], tmp_path / "large.h5", compressed=False)
    for part, before in zip(splits_of(tmp_path / "large.h5"), splits_of(first), strict=True):
        assert part.fingerprint == before.fingerprint
    with h5py.File(tmp_path / "large.h5") as file:
        assert file["train/depth_inpainted"].compression is None


def test_a_scene_on_both_sides_is_refused(tmp_path, samples):
    first = write(tmp_path / "first.h5", [("train", samples[0])], source="scenes")
    second = write(tmp_path / "second.h5", [("test", samples[0])], source="scenes")
    again = tmp_path / "again.h5"
    concatenate([second], again)
    for other in (second, again):
        with pytest.raises(DatasetError, match="images of a in one split"):
            concatenate([first, other], tmp_path / "both.h5")
    assert not (tmp_path / "both.h5").exists()


def test_scenes_of_several_sources_may_have_the_same_name(tmp_path, samples):
    real = write(tmp_path / "real.h5", [("train", samples[0])], source="cornell real")
    made = write(tmp_path / "made.h5", [("test", samples[0])], source="cornell made")
    bare = write(tmp_path / "bare.h5", [("train", samples[0])])  # as files of others: its name is all that is known
    concatenate([real, made], tmp_path / "two.h5")
    concatenate([tmp_path / "two.h5", bare], tmp_path / "three.h5")
    train, test = splits_of(tmp_path / "three.h5")
    assert train.image_ids == ["cornell real/a", "bare.h5/a"]
    assert test.image_ids == ["cornell made/a"]
    assert test.fingerprint == GraspDataset(made, "test").fingerprint
    concatenate([tmp_path / "two.h5"], tmp_path / "again.h5")
    assert splits_of(tmp_path / "again.h5")[0].image_ids == ["cornell real/a"]


def test_an_input_is_no_output(tmp_path, samples):
    first = write(tmp_path / "first.h5", [("train", samples[0])])
    before = first.read_bytes()
    with pytest.raises(DatasetError, match="another output file than the inputs"):
        concatenate([first], tmp_path / ".." / tmp_path.name / "first.h5")
    assert first.read_bytes() == before


def test_images_of_two_sizes_are_refused_before_any_is_written(tmp_path, samples):
    small = replace(
        samples[1],
        depth=samples[1].depth[:4, :4],
        rgb=samples[1].rgb[:4, :4],
        maps=tuple(image[:4, :4] for image in samples[1].maps),
    )
    paths = [write(tmp_path / f"{number}.h5", [("train", item)]) for number, item in enumerate((samples[0], small))]
    with pytest.raises(DatasetError, match=r"one size, received .*0\.h5, 4x4 px in .*1\.h5"):
        concatenate(paths, tmp_path / "both.h5")


def test_files_that_were_joined_without_the_sources_are_not_joined_on(tmp_path, samples):
    parts = [{"file": f"{name}.h5", "source": name} for name in "xy"]
    old = write(tmp_path / "old.h5", [("train", samples[0])], source="concatenation", parts=parts)
    concatenate([old], tmp_path / "again.h5")
    assert splits_of(tmp_path / "again.h5")[0].image_ids == ["a"]
    other = write(tmp_path / "other.h5", [("train", samples[1])], source="x")
    for joined in (old, tmp_path / "again.h5"):
        with pytest.raises(DatasetError, match=r"joined of several .*join the files"):
            concatenate([joined, other], tmp_path / "both.h5")


def test_files_that_are_none(tmp_path, samples):
    (tmp_path / "text.h5").write_text("no")
    with pytest.raises(DatasetError, match="HDF5"):
        splits_of(tmp_path / "text.h5")
    whole = write(tmp_path / "whole.h5", [("train", sample) for sample in samples]).read_bytes()
    (tmp_path / "cut.h5").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DatasetError, match="HDF5"):
        splits_of(tmp_path / "cut.h5")
    h5py.File(tmp_path / "empty.h5", "w").close()
    with pytest.raises(DatasetError, match="'train'"):
        splits_of(tmp_path / "empty.h5")
