import cv2
import numpy as np
import pytest

from ggcnn_net2net.datasets.hdf5 import DatasetWriter
from ggcnn_net2net.datasets.preview import preview_samples, write_sheet
from ggcnn_net2net.errors import DatasetError


def test_sheet_of_a_file(tmp_path, samples):
    with DatasetWriter(tmp_path / "data.h5", {}) as writer:
        for sample in samples:
            writer.add("train", sample)
    chosen = preview_samples(tmp_path / "data.h5", 2)
    assert [caption for caption, _ in chosen] == ["train 0: a", "train 1: b"]
    write_sheet(tmp_path / "sheet.png", chosen)
    sheet = cv2.imread(str(tmp_path / "sheet.png"))
    assert sheet.shape[1] == 1500  # two samples of five panels
    colours = np.unique(sheet.reshape(-1, 3), axis=0)
    assert len(colours) > 1000
    assert list(tmp_path.glob(".*")) == []


def test_raw_scenes_are_spread_evenly(cornell):
    chosen = preview_samples(cornell, 3)
    assert [sample.name for _, sample in chosen] == ["pcd0100", "pcd0102", "pcd0104"]
    assert len(preview_samples(cornell, 100)) == 6


def test_neither_file_nor_folder(tmp_path):
    with pytest.raises(DatasetError, match="dataset file"):
        preview_samples(tmp_path / "none", 3)
