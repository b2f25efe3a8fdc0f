"""Small scenes, and writers of the files that Cornell's dataset has."""

import cv2
import numpy as np

from ggcnn_net2net.datasets.scene import LabelledScene
from ggcnn_net2net.grasping import Grasp, grasp_to_rectangle

CLOUD_HEADER = """# .PCD v.7 - Point Cloud Data file format
FIELDS x y z rgb index
SIZE 4 4 4 4 4
TYPE F F F F U
COUNT 1 1 1 1 1
WIDTH {0}
HEIGHT 1
POINTS {0}
DATA ascii
"""


def tilted_plane(shape=(480, 640)):
    """Depth in metres that grows along both axes."""
    row, col = np.indices(shape)
    return (0.9 + 0.0004 * row + 0.0002 * col).astype(np.float32)


def make_scene(name="scene", shape=(480, 640), grasps=((200, 300, 0.3, 60), (220, 330, -0.5, 40)), object_name="thing"):
    rgb = np.random.default_rng(0).integers(0, 255, (*shape, 3), dtype=np.uint8)
    rectangles = np.array([grasp_to_rectangle(Grasp(*grasp)) for grasp in grasps])
    return LabelledScene(name, object_name, tilted_plane(shape), rgb, rectangles)


def write_cloud(path, depth, missing):
    """The cloud of a camera that sees `depth` (metres from the origin), in millimetres, without the missing pixels."""
    index = np.flatnonzero(~missing.ravel())
    directions = np.random.default_rng(0).normal(size=(len(index), 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = directions * depth.ravel()[index, None] * 1000
    with path.open("w") as stream:
        stream.write(CLOUD_HEADER.format(len(index)))
        np.savetxt(stream, np.column_stack([points, np.full(len(index), 2.2e-38), index]), fmt="%.6g %.6g %.6g %.6g %d")


def write_cornell_scene(folder, number, depth=None, rectangles="10 20\n50 20\n50 40\n10 40\n"):
    """pcdNNNNr.png, pcdNNNNd.tiff, pcdNNNNcpos.txt; corners are "x y"."""
    folder.mkdir(parents=True, exist_ok=True)
    depth = tilted_plane() if depth is None else depth
    stem = f"{folder}/pcd{number:04d}"
    assert cv2.imwrite(f"{stem}d.tiff", depth)
    assert cv2.imwrite(f"{stem}r.png", np.full((480, 640, 3), (1, 2, number % 256), np.uint8))  # blue, green, red
    (folder / f"pcd{number:04d}cpos.txt").write_text(rectangles)
