import pytest

from ggcnn_net2net.datasets.hdf5 import DatasetWriter, GraspDataset
from ggcnn_net2net.datasets.summary import summarise_labels


def test_numbers_of_a_small_file(tmp_path, samples):
    with DatasetWriter(tmp_path / "data.h5", {}) as writer:
        for sample in samples:
            writer.add("train", sample)
    summary = summarise_labels(GraspDataset(tmp_path / "data.h5", "train"))
    assert summary.rows == 3
    assert summary.rectangles == pytest.approx((2 + 1 + 40) / 3)
    assert summary.labelled == pytest.approx(sum((sample.maps.quality > 0).mean() for sample in samples) / 3)
    assert summary.unlabelled_images == 0
    assert summary.widths[1] == pytest.approx(50)  # of 30 to 69, 40, 60 and 100
    assert summary.depth[0] == pytest.approx(-summary.depth[1], abs=1e-3)  # tilted planes
    assert summarise_labels(GraspDataset(tmp_path / "data.h5", "train"), most=1).rows == 1
