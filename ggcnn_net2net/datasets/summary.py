"""What a dataset's labels are like, in a few numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ggcnn_net2net.datasets.hdf5 import GraspDataset


@dataclass(frozen=True)
class LabelSummary:
    """Statistics of `rows` rows."""

    rows: int
    rectangles: float
    """Mean number of rectangles an image."""
    labelled: float
    """Part of all pixels that have a label."""
    unlabelled_images: int
    """Images without any labelled pixel."""
    widths: tuple[float, float, float]
    """5th, 50th and 95th percentile of the rectangles' openings, pixels."""
    depth: tuple[float, float]
    """Least and greatest depth, metres about the mean."""


def summarise_labels(dataset: GraspDataset, most: int = 500) -> LabelSummary:
    """Statistics of a split, from at most `most` rows that are spread evenly over it."""
    rows = np.unique(np.linspace(0, len(dataset) - 1, min(most, len(dataset))).astype(int)).tolist()
    counts, labelled, depths = [], [], []
    openings: list[float] = []
    for row in rows:
        sample = dataset.sample(row)
        counts.append(len(sample.rectangles))
        labelled.append(float((sample.maps.quality > 0).mean()))
        depths += [float(sample.depth.min()), float(sample.depth.max())]
        openings += np.linalg.norm(sample.rectangles[:, 1] - sample.rectangles[:, 0], axis=1).tolist()
    low, middle, high = np.percentile(openings or [0.0], (5, 50, 95)).tolist()
    return LabelSummary(
        len(rows),
        float(np.mean(counts)),
        float(np.mean(labelled)),
        sum(part == 0 for part in labelled),
        (low, middle, high),
        (min(depths), max(depths)),
    )
