"""Losses of a training run as a table and as a picture."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

from ggcnn_net2net import atomic
from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.training.checkpoint import History


def columns_of(history: History) -> list[str]:
    """Everything that is known of an epoch, or of some: a run can be prolonged with validation, or without."""
    return list(dict.fromkeys(name for entry in history for name in entry))


def series_of(history: History, name: str) -> list[float]:
    """One value of each epoch, NaN where it was not computed."""
    return [entry.get(name, math.nan) for entry in history]


def write_history(history: History, path: Path) -> None:
    """Write one line an epoch as CSV; what was not computed is empty."""
    with atomic.replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, fieldnames=columns_of(history))
        writer.writeheader()
        writer.writerows(history)


def write_curves(history: History, path: Path, title: str) -> None:
    """Write a picture of the loss, and of its four parts, over the epochs."""
    from matplotlib.figure import Figure  # slow to import

    figure = Figure(figsize=(10, 4), layout="constrained")
    whole, parts = figure.subplots(1, 2)
    _plot(whole, history, {"loss": "loss"})
    _plot(parts, history, {head: f"{head}_loss" for head in HEADS})
    figure.suptitle(title, parse_math=False)
    with atomic.replacing(path) as temporary:
        figure.savefig(temporary, dpi=120)


_MARKERS = "osv^"  # colours alone cannot be told apart in grey


def _plot(axes: Any, history: History, names: dict[str, str]) -> None:
    epochs = [entry["epoch"] + 1 for entry in history]
    for number, (label, name) in enumerate(names.items()):
        style = {"color": f"C{number}", "marker": _MARKERS[number], "markersize": 4}
        axes.plot(epochs, series_of(history, name), label=label, **style)
        if f"val_{name}" in columns_of(history):
            axes.plot(epochs, series_of(history, f"val_{name}"), linestyle="--", **style)
    axes.set_xlabel("epoch (dashed: validation)")
    axes.set_yscale("log")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1), ncols=len(names), frameon=False)
