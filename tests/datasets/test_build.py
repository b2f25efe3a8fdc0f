from pathlib import Path

import numpy as np
import pytest

from ggcnn_net2net.datasets.augmentation import PLAIN, Augmentation
from ggcnn_net2net.datasets.build import FreshAugmentations, build_dataset
from ggcnn_net2net.datasets.concatenation import splits_of
from ggcnn_net2net.datasets.hdf5 import GraspDataset
from ggcnn_net2net.datasets.raw import open_scenes
from ggcnn_net2net.datasets.splits import make_split
from ggcnn_net2net.errors import DatasetError

TWICE = Augmentation(per_scene=2)


def test_build_does_not_depend_on_workers(cornell, tmp_path):
    scenes = open_scenes(cornell)
    split = make_split(scenes.objects, "object", 0.3, 0)
    seen = []
    for workers in (1, 2):
        output = tmp_path / f"{workers}.h5"
        result = build_dataset(scenes, split, output, TWICE, 5, workers, lambda *progress: seen.append(progress))
        assert result.rows == {"train": 8, "test": 4}
        assert result.problems == ()
    first, second = splits_of(tmp_path / "1.h5"), splits_of(tmp_path / "2.h5")
    assert [part.fingerprint for part in first] == [part.fingerprint for part in second]
    assert first[0].image_ids == second[0].image_ids == [name for name in split.train for _ in range(2)]
    assert seen == [(done, 6) for done in range(1, 7)] * 2
    attributes = first[0].attributes
    assert attributes["split"] == {"by": "object", "seed": 0, "sha256": split.sha256}
    assert attributes["augmentation"]["per_scene"] == 2
    assert attributes["seed"] == 5
    # Fresh augmentation draws the same in epoch 0.
    fresh = FreshAugmentations(scenes.only(split.train), TWICE, 5)
    for left, right in zip(fresh.batch(range(8), 0), first[0].batch(range(8)), strict=True):
        np.testing.assert_array_equal(left, right)


def test_the_source_has_a_name_from_inside_its_folder_too(cornell, tmp_path, monkeypatch):
    monkeypatch.chdir(cornell)
    scenes = open_scenes(Path())
    build_dataset(scenes, make_split(scenes.objects, "image", 0.3, 0), tmp_path / "data.h5", PLAIN)
    assert GraspDataset(tmp_path / "data.h5", "train").attributes["source"] == f"cornell {cornell.name}"


def test_unreadable_scenes_are_left_out_and_reported(cornell, tmp_path):
    (cornell / "01" / "pcd0101r.png").write_bytes(b"broken")
    scenes = open_scenes(cornell)
    split = make_split(scenes.objects, "image", 0.3, 0)
    result = build_dataset(scenes, split, tmp_path / "data.h5", PLAIN)
    assert sum(result.rows.values()) == 5
    (problem,) = result.problems
    assert problem.file == "pcd0101"
    assert "6 bytes" in problem.problem
    (found,) = GraspDataset(tmp_path / "data.h5", "train").attributes["left_out"]
    assert found[0] == "pcd0101"


def test_build_refuses(cornell, tmp_path):
    scenes = open_scenes(cornell)
    split = make_split(scenes.objects, "image", 0.3, 0)
    (cornell / "01" / "pcd0100cpos.txt").unlink()
    with pytest.raises(DatasetError, match=r"not in the dataset \(pcd0100\)"):
        build_dataset(open_scenes(cornell), split, tmp_path / "data.h5", PLAIN)
    for file in cornell.glob("*/*.tiff"):
        file.write_bytes(b"broken")
    with pytest.raises(DatasetError, match="none can"):
        build_dataset(scenes, split, tmp_path / "data.h5", PLAIN)
    assert not (tmp_path / "data.h5").exists()


def test_fresh_augmentations(cornell):
    scenes = open_scenes(cornell)
    fresh = FreshAugmentations(scenes, TWICE, 1)
    assert len(fresh) == 12
    inputs, targets = fresh.batch([3, 0], 4)
    assert inputs.shape == (2, 300, 300, 1)
    assert targets.shape == (2, 300, 300, 4)
    assert inputs.dtype == targets.dtype == np.float32
    # The same whatever else is in the batch; other in another epoch, row or seed.
    np.testing.assert_array_equal(fresh.batch([0], 4)[0][0], inputs[1])
    in_memory = FreshAugmentations(list(scenes), TWICE, 1)
    np.testing.assert_array_equal(in_memory.batch([0], 4)[0][0], inputs[1])
    others = [fresh.batch([0], 5), fresh.batch([1], 4), FreshAugmentations(scenes, TWICE, 2).batch([0], 4)]
    assert all((other[0][0] != inputs[1]).any() for other in others)
    prints = [
        each.fingerprint
        for each in (fresh, FreshAugmentations(scenes, TWICE, 2), FreshAugmentations(scenes[:5], TWICE, 1))
    ]
    assert in_memory.fingerprint == prints[0]
    assert len(set(prints)) == 3
    with pytest.raises(DatasetError, match="0 to 11"):
        fresh.batch([12], 0)
    with pytest.raises(DatasetError, match="received none"):
        FreshAugmentations([], TWICE)
