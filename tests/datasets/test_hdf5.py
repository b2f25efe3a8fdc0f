import os
import pickle
from dataclasses import replace

import h5py
import numpy as np
import pytest

from ggcnn_net2net.datasets.hdf5 import DatasetWriter, GraspDataset
from ggcnn_net2net.datasets.label_maps import targets_of
from ggcnn_net2net.errors import DatasetError


def write(path, samples, split="train", **attributes):
    with DatasetWriter(path, attributes) as writer:
        for sample in samples:
            writer.add(split, sample)
    return path


def write_as_the_public_code(path, samples):
    """One array a dataset, 64-bit labels, whole-pixel corners padded with zeros to 25, numbers for names."""
    boxes = np.zeros((len(samples), 25, 4, 2), np.int64)
    for row, sample in enumerate(samples):
        boxes[row, : len(sample.rectangles)] = sample.rectangles
    maps = [np.array([sample.maps[index] for sample in samples], np.float64) for index in range(3)]
    with h5py.File(path, "w") as file:
        for name, values in {
            "img_id": np.arange(len(samples)) + 100,
            "rgb": np.array([sample.rgb for sample in samples]),
            "depth_inpainted": np.array([sample.depth for sample in samples]),
            "bounding_boxes": boxes,
            "grasp_points_img": maps[0],
            "angle_img": maps[1],
            "grasp_width": maps[2],
        }.items():
            file[f"train/{name}"] = values
    return path


def test_what_is_written_is_read(tmp_path, samples):
    path = write(tmp_path / "data.h5", samples, source="test", seed=3)
    dataset = GraspDataset(path, "train")
    assert len(dataset) == 3
    assert dataset.shape == (300, 300)
    assert dataset.image_ids == ["a", "b", "c"]
    assert dataset.attributes["seed"] == 3
    assert "h5py" in dataset.attributes["versions"]
    for row, sample in enumerate(samples):
        back = dataset.sample(row)
        assert back.name == sample.name
        np.testing.assert_array_equal(back.depth, sample.depth)
        np.testing.assert_array_equal(back.rgb, sample.rgb)
        np.testing.assert_array_equal(back.maps, sample.maps)
        np.testing.assert_array_equal(dataset.rectangles(row), sample.rectangles)  # 40 of them in the last


def test_compression_changes_nothing_but_the_size(tmp_path, samples):
    smooth = [replace(sample, depth=np.round(sample.depth, 1)) for sample in samples]
    paths = [tmp_path / "small.h5", tmp_path / "large.h5"]
    for path, compressed in zip(paths, (True, False), strict=True):
        with DatasetWriter(path, {}, compressed=compressed) as writer:
            for sample in smooth:
                writer.add("train", sample)
    small, large = (GraspDataset(path, "train") for path in paths)
    assert large.fingerprint == small.fingerprint == large.content_hash()
    np.testing.assert_array_equal(large.batch([2, 0])[1], small.batch([2, 0])[1])
    with h5py.File(paths[1]) as file:
        assert {file["train"][key].compression for key in file["train"]} == {None}
        assert not any(file["train"][key].shuffle for key in file["train"])
    assert paths[1].stat().st_size > 2 * paths[0].stat().st_size


def test_batches_in_any_order(tmp_path, samples):
    dataset = GraspDataset(write(tmp_path / "data.h5", samples), "train")
    inputs, targets = dataset.batch([2, 0, 2, 1], epoch=5)
    assert inputs.dtype == targets.dtype == np.float32
    assert inputs.shape == (4, 300, 300, 1)
    for index, row in enumerate([2, 0, 2, 1]):
        np.testing.assert_array_equal(inputs[index, ..., 0], samples[row].depth)
        np.testing.assert_array_equal(dataset.depth(row), samples[row].depth)
        np.testing.assert_array_equal(targets[index], targets_of(*samples[row].maps))
    with pytest.raises(DatasetError, match="0 to 2"):
        dataset.batch([3])
    with pytest.raises(DatasetError, match="received -1"):
        dataset.batch([-1])


def test_the_layout_is_that_of_the_public_code(tmp_path, samples):
    path = write(tmp_path / "data.h5", samples[:2])
    with h5py.File(path) as file:
        group = file["train"]
        assert set(group) == {
            "img_id", "rgb", "depth_inpainted", "bounding_boxes", "grasp_points_img", "angle_img", "grasp_width"
        }  # fmt: skip
        assert group["bounding_boxes"].shape == (2, 25, 4, 2)
        assert (group["bounding_boxes"][1, 1:] == 0).all()
        assert group["rgb"].dtype == np.uint8
        assert group["depth_inpainted"].chunks == (1, 300, 300)
        assert {group[name].compression for name in group} <= {"gzip", None}  # any h5py can read it


def test_files_of_the_public_code_are_read(tmp_path, samples):
    whole = [sample.__class__(**{**vars(sample), "rectangles": np.floor(sample.rectangles)}) for sample in samples[:2]]
    theirs = GraspDataset(write_as_the_public_code(tmp_path / "theirs.h5", whole), "train")
    ours = GraspDataset(write(tmp_path / "ours.h5", whole), "train")
    assert theirs.image_ids == ["100", "101"]
    assert theirs.attributes == {}
    assert [len(theirs.rectangles(row)) for row in (0, 1)] == [2, 1]
    assert theirs.rectangles(0).dtype == np.float64
    for left, right in zip(theirs.batch([1, 0]), ours.batch([1, 0]), strict=True):
        np.testing.assert_array_equal(left, right)
    assert theirs.fingerprint == ours.fingerprint == ours.content_hash()


def test_fingerprint_depends_on_the_content(tmp_path, samples):
    prints = [
        GraspDataset(write(tmp_path / "data.h5", chosen), "train").fingerprint
        for chosen in (samples, samples[::-1], samples[:2])
    ]
    assert len(set(prints)) == 3


def test_pickled_it_opens_the_file_anew(tmp_path, samples):
    dataset = GraspDataset(write(tmp_path / "data.h5", samples), "train")
    data = pickle.dumps(dataset)
    assert len(data) < 1000
    np.testing.assert_array_equal(pickle.loads(data).batch([1])[0], dataset.batch([1])[0])


def test_an_interrupted_writer_leaves_nothing(tmp_path, samples):
    path = write(tmp_path / "data.h5", samples)
    before = path.read_bytes()
    with pytest.raises(RuntimeError, match="stop"), DatasetWriter(path, {}) as writer:
        writer.add("train", samples[0])
        raise RuntimeError("stop")
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_provenance_of_any_length(tmp_path, samples):
    path = write(tmp_path / "data.h5", samples[:1], left_out=["x" * 100] * 5000)
    assert len(GraspDataset(path, "train").attributes["left_out"]) == 5000
    with pytest.raises(TypeError), DatasetWriter(path, {"seed": {1, 2}}):
        pytest.fail("refused before anything is written")


def test_writer_refuses(tmp_path, samples):
    first = samples[0]
    changed = {
        "one split": ("test", {}),
        "train or test": ("validation", {}),
        "NaN": ("train", {"depth": np.full((300, 300), np.nan, np.float32)}),
        "size": ("train", {"rgb": np.zeros((200, 200, 3), np.uint8)}),
    }
    for message, (split, values) in changed.items():
        with pytest.raises(DatasetError, match=message), DatasetWriter(tmp_path / "data.h5", {}) as writer:
            writer.add("train", first)
            writer.add(split, first.__class__(**{**vars(first), **values}))
    assert not list(tmp_path.iterdir())


def delete(group):
    del group["angle_img"]


def cut_rows(group):
    values = group["grasp_width"][:2]
    del group["grasp_width"]
    group["grasp_width"] = values


def other_size(group):
    del group["grasp_width"]
    group["grasp_width"] = np.zeros((3, 200, 300))


def flat_boxes(group):
    del group["bounding_boxes"]
    group["bounding_boxes"] = np.zeros((3, 25, 8))


@pytest.mark.parametrize(
    ("damage", "message"),
    [(delete, "angle_img"), (cut_rows, "3 rows"), (other_size, "grasp_width"), (flat_boxes, "bounding_boxes")],
)
def test_damaged_layouts_are_refused(tmp_path, samples, damage, message):
    path = write(tmp_path / "data.h5", samples)
    with h5py.File(path, "r+") as file:
        damage(file["train"])
    with pytest.raises(DatasetError, match=message):
        GraspDataset(path, "train")


def test_unusable_files_are_refused(tmp_path, samples):
    path = write(tmp_path / "data.h5", samples)
    with pytest.raises(DatasetError, match="dataset build"):
        GraspDataset(tmp_path / "none.h5", "train")
    with pytest.raises(DatasetError, match=r"'test'.*'train'"):
        GraspDataset(path, "test")
    cut = tmp_path / "cut.h5"
    cut.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(DatasetError, match="HDF5"):
        GraspDataset(cut, "train")
    with h5py.File(path, "r+") as file:
        file["train/angle_img"][1, 5, 5] = np.nan
    dataset = GraspDataset(path, "train")
    dataset.batch([0, 2])
    with pytest.raises(DatasetError, match="row 1"):
        dataset.batch([0, 1])
    assert dataset.fingerprint  # as written; what is there now cannot even be hashed
    with pytest.raises(DatasetError, match="angle_img"):
        dataset.content_hash()


def test_damaged_images_are_named(tmp_path, samples):
    path = write(tmp_path / "data.h5", samples)
    with h5py.File(path) as file:
        place = file["train/depth_inpainted"].id.get_chunk_info(1)
    content = bytearray(path.read_bytes())
    content[place.byte_offset : place.byte_offset + place.size] = bytes(place.size)
    path.write_bytes(content)
    with pytest.raises(DatasetError, match=r"row 1 .*make the file anew"):
        GraspDataset(path, "train").batch([1])


def test_the_content_of_a_file_of_others_is_hashed_once(tmp_path, samples, monkeypatch):
    path = write_as_the_public_code(tmp_path / "public.h5", samples[:2])
    expected = GraspDataset(path, "train").content_hash()
    hashed = []
    compute = GraspDataset.content_hash
    monkeypatch.setattr(GraspDataset, "content_hash", lambda self: hashed.append(self.split) or compute(self))
    assert [GraspDataset(path, "train").fingerprint for _ in range(3)] == [expected] * 3
    assert hashed == ["train"]
    with h5py.File(path, "r+") as file:
        file["train/depth_inpainted"][0, 0, 0] += 0.5
    os.utime(path, ns=(1, 1))  # whatever the clock's resolution
    assert GraspDataset(path, "train").fingerprint != expected
