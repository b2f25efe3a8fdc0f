"""A small dataset to search on, a search to be started as a process of its own, and what came of one."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import sys
from pathlib import Path
from unittest.mock import patch

import numpy as np

SIZE = 72
ARCHITECTURE = "C5x5x2_C3x3x2_T3x3x2_T5x5x2"


def write_dataset(path: Path, train: int = 12, test: int = 6) -> Path:
    """Boxes on a plane, each labelled with one grasp across its middle."""
    from ggcnn_net2net.datasets.augmentation import Sample
    from ggcnn_net2net.datasets.hdf5 import DatasetWriter
    from ggcnn_net2net.datasets.label_maps import draw_label_maps
    from ggcnn_net2net.grasping import Grasp, grasp_to_rectangle

    random = np.random.default_rng(0)
    with DatasetWriter(path, {"source": "boxes"}) as writer:
        for number in range(train + test):
            row, col = random.integers(30, SIZE - 30, 2)
            depth = random.normal(0, 0.002, (SIZE, SIZE)).astype(np.float32)
            depth[row - 15 : row + 15, col - 8 : col + 8] -= 0.2
            rectangles = np.array([grasp_to_rectangle(Grasp(float(row), float(col), 0.0, 30.0))])
            maps = draw_label_maps(rectangles, (SIZE, SIZE))
            rgb = np.zeros((SIZE, SIZE, 3), np.uint8)
            sample = Sample(f"box{number}", depth - depth.mean(), rgb, rectangles, maps)
            writer.add("train" if number < train else "test", sample)
    return path


def run_job_on_full_disk(job):
    """What a worker makes of a job if it cannot write *deeper(2)*."""
    from ggcnn_net2net.errors import ModelFileError
    from ggcnn_net2net.search import trainer

    def save_ggcnn(*_):
        try:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            raise ModelFileError(f"cannot save: {error}") from error

    if str(job.candidate.operation) != "deeper(2)":
        return trainer.run_job(job)
    with patch("ggcnn_net2net.model_files.save_ggcnn", save_ggcnn):
        return trainer.run_job(job)


def outcome_of(directory: Path) -> dict:
    """Path, scores and hashes of all weights of a finished search: what has to be the same every time."""
    import h5py

    from ggcnn_net2net.search import load_history
    from ggcnn_net2net.search.trainer import model_file

    history = load_history(directory)

    def weights(path: Path) -> str:
        digest = hashlib.sha256()
        with h5py.File(path) as file:
            file["model_weights"].visititems(
                lambda name, item: digest.update(name.encode() + item[()].tobytes()) if hasattr(item, "dtype") else None
            )
        return digest.hexdigest()

    trained = {one.key: one.score for one in history.candidates.values() if one.comparable}
    return {
        "path": [(one.key, score) for one, score in history.path],
        "scores": trained,
        "weights": {key: weights(model_file(directory, key)) for key in trained},
        "best": weights(directory / "best.hdf5"),
    }


def main(directory: str, dataset: str, settings: str, workers: str) -> None:
    from ggcnn_net2net.architecture import build_ggcnn
    from ggcnn_net2net.parallel import LocalWorkers
    from ggcnn_net2net.search import SearchSettings, load_history, resume_search, start_search

    def tell(event: dict) -> None:
        print(event["event"], flush=True)

    with LocalWorkers(int(workers)) as pool:
        if (Path(directory) / "journal.jsonl").exists() and (Path(directory) / "journal.jsonl").stat().st_size:
            resume_search(Path(directory), pool, on_event=tell)
        else:
            model = build_ggcnn(ARCHITECTURE, input_size=SIZE, seed=0)
            wanted = SearchSettings.from_dict(json.loads(settings))
            start_search(model, Path(dataset), wanted, Path(directory), pool, on_event=tell)
    assert load_history(Path(directory)).finished


if __name__ == "__main__":
    main(*sys.argv[1:])
