"""A labelled scene: what every dataset is read into before it becomes network inputs and targets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class LabelledScene:
    """One image with its positive grasp rectangles, in the frame of `ggcnn_net2net.grasping.geometry`."""

    name: str
    """Name of the scene, unique in its dataset: "pcd0100"."""
    object_name: str
    """What it shows. An object-wise split keeps all scenes of one object on one side."""
    depth: npt.NDArray[np.float32]
    """(H, W) metres, missing pixels already filled in."""
    rgb: npt.NDArray[np.uint8]
    """(H, W, 3)."""
    rectangles: npt.NDArray[np.float64]
    """(n, 4, 2) corners (row, col) in pixels; the edge 0-1 runs in the closing direction and is the opening."""
