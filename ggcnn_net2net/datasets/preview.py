"""A picture of what is in a dataset: images, grasp rectangles and label maps side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ggcnn_net2net.atomic import replacing
from ggcnn_net2net.datasets.augmentation import PLAIN, Sample, augment
from ggcnn_net2net.datasets.concatenation import splits_of
from ggcnn_net2net.datasets.raw import open_scenes
from ggcnn_net2net.grasping import RSS_2018

_PANELS = ("image", "depth, rectangles", "quality", "angle", "width")
_ABREAST = 2  # samples in a line of the sheet
_INCHES = 1.5  # side of an image
_CAPTION = 50  # characters


def preview_samples(path: Path, count: int, depth: str = "perfect") -> list[tuple[str, Sample]]:
    """Up to `count` samples with captions, spread evenly over a dataset file or a folder of raw scenes.

    Raw scenes are shown as the crop around their grasps, neither rotated nor zoomed.

    Args:
        path: the file or the folder.
        count: most samples.
        depth: of a Jacquard folder, "perfect" or "stereo".

    Returns:
        Captions and samples.

    Raises:
        DatasetError: neither a dataset file nor a folder of raw scenes, or one that is damaged.
    """
    if Path(path).is_dir():
        scenes = open_scenes(path, depth=depth)
        chosen = (scenes[index] for index in _spread(len(scenes), count))
        return [
            (f"{scene.name}, {scene.object_name}"[:_CAPTION], augment(scene, np.random.default_rng(0), PLAIN))
            for scene in chosen
        ]
    rows = [(dataset, row) for dataset in splits_of(path) for row in range(len(dataset))]
    samples = ((*rows[index], rows[index][0].sample(rows[index][1])) for index in _spread(len(rows), count))
    return [(f"{dataset.split} {row}: {sample.name}"[:_CAPTION], sample) for dataset, row, sample in samples]


def write_sheet(path: Path, samples: Sequence[tuple[str, Sample]]) -> None:
    """Draw samples with their captions to a PNG.

    Openings of rectangles are thin and light, jaws thick and red. Pixels without label are grey; angles have a cyclic
    colour map, because -90° and 90° are the same.

    Args:
        path: file to write.
        samples: captions and samples, as of `preview_samples`.
    """
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    lines = -(-len(samples) // _ABREAST)
    columns = _ABREAST * len(_PANELS)
    figure, axes = pyplot.subplots(
        lines, columns, squeeze=False, figsize=(columns * _INCHES, lines * (_INCHES + 0.3) + 0.6), layout="constrained"
    )
    for axis in axes.flat:
        axis.axis("off")
    drawn: list[Any] = []
    for index, (caption, sample) in enumerate(samples):
        line, block = divmod(index, _ABREAST)
        drawn = _draw_sample(axes[line, block * len(_PANELS) :][: len(_PANELS)], caption, sample)
    for axis, title in zip(axes[0], _PANELS * _ABREAST, strict=True):
        place = {"xy": (0.5, 1), "xycoords": "axes fraction", "xytext": (0, 14), "textcoords": "offset points"}
        axis.annotate(title, ha="center", fontsize=8, parse_math=False, **place)  # above the captions
    halves = (axes[:, : columns // 2], axes[:, columns // 2 :])
    labels = ("angle, degrees", "width, pixels")
    for image, label, half, step in zip(drawn, labels, halves, (45, 50), strict=True):
        low, high = image.get_clim()
        ticks = np.arange(low, high + 1, step)
        bar = figure.colorbar(image, ax=half, location="bottom", ticks=ticks, shrink=0.6, aspect=40, pad=0.01)
        bar.set_label(label, fontsize=8)
        bar.ax.tick_params(labelsize=8)
    with replacing(Path(path)) as temporary:
        figure.savefig(temporary, dpi=100)
    pyplot.close(figure)


def _draw_sample(axes: Any, caption: str, sample: Sample) -> list[Any]:
    """Draw the panels of a sample; return the images of angle and width."""
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection

    unlabelled = sample.maps.quality == 0
    axes[0].imshow(sample.rgb)
    axes[0].set_title(caption, fontsize=6, loc="left", parse_math=False)
    low, high = np.percentile(sample.depth, (1, 99))
    axes[1].imshow(sample.depth, cmap="gray", vmin=low, vmax=max(high, low + 1e-6))
    corners = sample.rectangles[..., ::-1]  # (col, row), as matplotlib counts
    thickness = min(1.0, 30 / max(len(corners), 1))
    for first, colour, width in ((0, "gold", thickness / 2), (1, "red", thickness)):
        edges = [edge for start in (first, first + 2) for edge in corners[:, [start, (start + 1) % 4]]]
        axes[1].add_collection(LineCollection(edges, colors=colour, linewidths=width, alpha=0.8))
    axes[1].set(xlim=(-0.5, sample.depth.shape[1] - 0.5), ylim=(sample.depth.shape[0] - 0.5, -0.5))
    axes[2].imshow(sample.maps.quality, cmap="gray", vmin=0, vmax=1)
    angles = np.ma.masked_array(np.degrees(sample.maps.angle), unlabelled)
    widths = np.ma.masked_array(sample.maps.width, unlabelled)
    return [
        axes[3].imshow(angles, cmap=colormaps["hsv"].with_extremes(bad="lightgray"), vmin=-90, vmax=90),
        axes[4].imshow(
            widths, cmap=colormaps["viridis"].with_extremes(bad="lightgray"), vmin=0, vmax=RSS_2018.width_scale
        ),
    ]


def _spread(length: int, count: int) -> Iterator[int]:
    """`count` indices spread evenly over `length`, or all of them."""
    count = min(length, count)
    return (index * length // count for index in range(count))
