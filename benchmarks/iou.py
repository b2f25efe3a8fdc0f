"""Speed of the IoU rule against drawing both rectangles of every pair on a canvas, and that both count the same pixels.

    GGCNN_NET2NET_DATA=FOLDER python benchmarks/iou.py

The labels are those of the Cornell scenes of the reference data; the predictions are labels of the same scene, moved,
turned and stretched at random. Both ways run in turn, so that what else the machine does strikes both alike.
"""

from __future__ import annotations

import platform
import statistics
import time
from collections.abc import Callable
from importlib.metadata import version

import click
import numpy as np
from skimage.draw import polygon

from ggcnn_net2net.datasets.cornell import read_rectangles
from ggcnn_net2net.errors import DataNotFoundError
from ggcnn_net2net.grasping import Grasp, grasp_iou, iou_rate, published_rectangle, rectangle_to_grasp
from ggcnn_net2net.grasping.iou import LARGEST_ANGLE, LEAST_IOU
from ggcnn_net2net.reference_data import DATA_VARIABLE, data_root

TARGET = 10.0


def cornell_labels() -> list[np.ndarray]:
    """Positive rectangles (n, 4, 2) in (row, col) of each scene, on whole pixels, those with NaN left out."""
    root = data_root()
    paths = sorted(root.glob("cornell/**/pcd*cpos.txt")) if root else []
    if not paths:
        raise DataNotFoundError(f"expected scenes in cornell/ of the folder that {DATA_VARIABLE} names, found none")
    return [np.rint(read_rectangles(path)[0]) for path in paths]


def predictions(labels: list[np.ndarray], rng: np.random.Generator) -> list[Grasp]:
    """A grasp near a label of each scene: off by 15 px, 0.3 rad and a quarter of the opening (standard deviations)."""
    found = []
    for rectangles in labels:
        grasp, _ = rectangle_to_grasp(rng.choice(rectangles))
        row, col = rng.normal((grasp.row, grasp.col), 15)
        width = grasp.width_px * np.exp(rng.normal(0, 0.25))
        found.append(Grasp(round(row), round(col), grasp.angle + rng.normal(0, 0.3), float(width)))
    return found


def drawn_success(grasp: Grasp, rectangles: np.ndarray, wrapped: bool) -> bool:
    """The rule as the public code applies it: pair by pair, each pair of the right angle drawn on a fresh canvas."""
    predicted = published_rectangle(grasp)
    return max((drawn_iou(predicted, rectangle, wrapped) for rectangle in rectangles), default=0.0) > LEAST_IOU


def drawn_iou(a: np.ndarray, b: np.ndarray, wrapped: bool) -> float:
    difference = angle_of(a) - angle_of(b)
    apart = abs((difference + np.pi / 2) % np.pi - np.pi / 2) if wrapped else abs(difference) % np.pi
    if apart > LARGEST_ANGLE:
        return 0.0
    (rows_a, cols_a), (rows_b, cols_b) = polygon(*a.T), polygon(*b.T)
    if not len(rows_a) or not len(rows_b):
        return 0.0
    canvas = np.zeros((max(rows_a.max(), rows_b.max()) + 1, max(cols_a.max(), cols_b.max()) + 1))
    canvas[rows_a, cols_a] += 1
    canvas[rows_b, cols_b] += 1
    return float(np.sum(canvas == 2) / np.sum(canvas > 0))


def angle_of(rectangle: np.ndarray) -> float:
    rows, cols = rectangle[1] - rectangle[0]
    return float((np.arctan2(-rows, cols) + np.pi / 2) % np.pi - np.pi / 2)


def seconds(run: Callable[[], list[bool]]) -> tuple[float, list[bool]]:
    start = time.perf_counter()
    result = run()
    return time.perf_counter() - start, result


@click.command()
@click.option("--draws", default=10, show_default=True, help="Predictions for each scene.")
@click.option("--repeats", default=5, show_default=True, help="Runs of each way, in turn; the median ratio counts.")
def main(draws: int, repeats: int) -> None:
    """Measure both readings of the angle difference."""
    labels = cornell_labels() * draws
    grasps = predictions(labels, np.random.default_rng(0))
    click.echo(
        f"{len(labels)} images, {sum(map(len, labels))} pairs; Python {platform.python_version()}, NumPy "
        f"{np.__version__}, scikit-image {version('scikit-image')}"
    )
    for reading, wrapped in (("published", False), ("corrected", True)):
        ratios = []
        for _ in range(repeats):
            slow, drawn = seconds(
                lambda: [drawn_success(*pair, wrapped) for pair in zip(grasps, labels, strict=True)]  # noqa: B023
            )
            fast, counted = seconds(
                lambda: list(iou_rate(grasps, labels, wrapped_angle_difference=wrapped).success)  # noqa: B023
            )
            if drawn != counted:
                raise SystemExit(f"{reading}: drawing and counting judge images differently")
            ratios.append(slow / fast)
        different = sum(
            grasp_iou(predicted, label, wrapped_angle_difference=wrapped) != drawn_iou(predicted, label, wrapped)
            for predicted, of_image in zip(map(published_rectangle, grasps), labels, strict=True)
            for label in of_image
        )
        click.echo(
            f"{reading}: {sum(counted)} successes either way, on the same images; {different} pairs with another IoU; "
            f"counting is {statistics.median(ratios):.0f} times as fast as drawing (runs: "
            f"{', '.join(f'{ratio:.0f}' for ratio in sorted(ratios))}; target {TARGET:.0f})"
        )


if __name__ == "__main__":
    main()
