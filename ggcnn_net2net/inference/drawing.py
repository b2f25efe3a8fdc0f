"""Grasp rectangles in pictures."""

from __future__ import annotations

from typing import Any

from ggcnn_net2net.grasping import Grasp, grasp_to_rectangle

_JAW, _OPENING = "#ff3b30", "white"


def draw_grasp(axes: Any, grasp: Grasp, label: str = "") -> None:
    """Draw a grasp rectangle over an image; the edges where the fingers go down are bold, all have a dark rim.

    Args:
        axes: of matplotlib, in pixels of the image.
        grasp: what to draw.
        label: stands at its centre.
    """
    from matplotlib.patheffects import withStroke

    corners = grasp_to_rectangle(grasp)[:, ::-1]  # (col, row), as matplotlib counts
    for start in range(4):
        jaw = start % 2 == 1  # edges 1-2 and 3-0; 0-1 is the closing direction
        width = 3.0 if jaw else 1.2
        axes.plot(
            *corners[[start, (start + 1) % 4]].T,
            color=_JAW if jaw else _OPENING,
            linewidth=width,
            solid_capstyle="round",
            path_effects=[withStroke(linewidth=width + 2, foreground="black")],
        )
    axes.annotate(
        label,
        (grasp.col, grasp.row),
        color="white",
        ha="center",
        va="center",
        fontsize=9,
        path_effects=[withStroke(linewidth=2.5, foreground="black")],
    )
