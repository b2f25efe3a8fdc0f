"""A prediction as files: a picture to look at, and JSON for programs."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ggcnn_net2net.atomic import replacing, write_text
from ggcnn_net2net.grasping import grasp_to_rectangle
from ggcnn_net2net.inference.drawing import draw_grasp
from ggcnn_net2net.inference.predictor import Prediction


def write_prediction_json(path: Path, prediction: Prediction, origin: dict[str, Any]) -> None:
    """Write grasps, how the image was read, and where everything came from.

    Args:
        path: file to write.
        prediction: what to write.
        origin: image, network, preset and so on; written first.
    """
    window = prediction.window
    content = {
        **origin,
        "depth_unit": prediction.depth_unit,
        "image_shape": list(prediction.metres.shape),
        "missing_pixels": int(np.isnan(prediction.metres).sum()),
        "window": {**asdict(window), "network_shape": list(window.network_shape)},
        "frames": {
            "row, col, width_px": "pixels of the image, (0, 0) at the centre of the upper left one, rows down",
            "angle": "radians from the column axis to the closing direction, counter-clockwise as seen",
            "position, closing_direction, opening": "metres, camera's optical frame: x right, y down, z forward",
        },
        "grasps": [
            {**asdict(grasp), "rectangle_row_col": grasp_to_rectangle(grasp).round(3).tolist()}
            for grasp in prediction.grasps
        ],
    }
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def write_prediction_picture(path: Path, prediction: Prediction, title: str) -> None:
    """Draw depth and quality with the grasp rectangles, numbered from the best; readable in grey.

    Args:
        path: picture to write; its suffix is the format.
        prediction: what to draw.
        title: line above.
    """
    from matplotlib import colormaps
    from matplotlib.figure import Figure
    from matplotlib.patheffects import withStroke

    metres, window = prediction.metres, prediction.window
    figure = Figure(figsize=(13, 5.6), dpi=100, layout="constrained")
    depth, quality = figure.subplots(1, 2)
    low, high = np.nanpercentile(window.cut(metres), (1, 99))
    colours = colormaps["gray"].with_extremes(bad="#9db8d9")
    shades = depth.imshow(metres, cmap=colours, vmin=low, vmax=max(high, low + 1e-6))
    figure.colorbar(shades, ax=depth, fraction=0.046, pad=0.03)
    depth.set_title("depth [m]; bluish: missing; frame: what the network sees", fontsize=10)
    left, top = window.left - 0.5, window.top - 0.5
    extent = (left, left + window.width, top + window.height, top)
    depth.plot(
        (left, left + window.width, left + window.width, left, left),
        (top, top, top + window.height, top + window.height, top),
        color="white",
        linewidth=0.8,
        path_effects=[withStroke(linewidth=2, foreground="black")],
    )
    shades = quality.imshow(prediction.maps[0], cmap="gray", vmin=0, vmax=1, extent=extent)
    figure.colorbar(shades, ax=quality, fraction=0.046, pad=0.03)
    quality.set_title("quality as predicted, before smoothing", fontsize=10)
    for axes in (depth, quality):
        axes.set(xlim=(-0.5, metres.shape[1] - 0.5), ylim=(metres.shape[0] - 0.5, -0.5))
        for number, grasp in reversed(list(enumerate(prediction.grasps, start=1))):  # the best on top
            draw_grasp(axes, grasp, str(number))
    figure.suptitle(title, fontsize=11, parse_math=False)
    with replacing(path) as temporary:
        figure.savefig(temporary)
