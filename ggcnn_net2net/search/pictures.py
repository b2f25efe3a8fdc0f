"""Pictures of a search: score against depth as in Fig. 2 of the paper, score against size, and the tree."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from ggcnn_net2net.atomic import replacing
from ggcnn_net2net.search.history import CandidateRecord, SearchHistory

PATH, KEPT, OTHER, FAILED = "#d95f02", "#2b6cb0", "#9aa0a6", "#b00020"
"""Colours."""

Point = tuple[float, float]

# Of the tree, in inches.
_BOX_WIDTH, _KEPT_HEIGHT, _OTHER_HEIGHT = 0.92, 0.37, 0.16
_ROW_GAP, _FAMILY_GAP, _STUB, _MARGIN, _HEADER = 0.03, 0.12, 0.12, 0.25, 1.0
_LABEL_SIZE = 6.5  # points
_LETTER = 0.6 * _LABEL_SIZE / 72  # width
_MOST_PIXELS = 10_000  # of the longer side of a PNG


def write_depth_chart(history: SearchHistory, path: Path) -> None:
    """Write the score of every candidate against its depth, and the path through them (Fig. 2 of the paper).

    Args:
        history: of the search.
        path: picture to write; its suffix is the format.
    """
    figure, axes = _chart(history)
    kept = history.kept
    shown = [item for item in history.candidates.values() if item.comparable]
    _dots(axes, [(item.depth, item.score) for item in shown if item.key not in kept], OTHER, "candidate")
    _dots(axes, [(item.depth, item.score) for item in shown if item.key in kept], KEPT, "kept in the beam", "^")
    points = [(item, score) for item, score in history.path if not math.isnan(score)]
    _line(axes, [(item.depth, score) for item, score in points], PATH, "committed path")
    for number, (item, score) in enumerate(points):
        rises = number + 1 < len(points) and points[number + 1][1] > score
        axes.annotate(
            f"{item.parameters:,}",
            (item.depth, score),
            (4, -12 if rises else 12),  # the side to which the path does not go on
            textcoords="offset points",
            va="center",
            fontsize=8,
            color=PATH,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1},
        )
    axes.set_xlabel("depth: number of operations; beside the path: parameters")
    axes.set_xlim(-0.3, max([item.depth for item in shown], default=1) + 0.7)
    axes.xaxis.get_major_locator().set_params(integer=True)
    _finish(figure, path)


def write_size_chart(history: SearchHistory, path: Path) -> None:
    """Write the score of every candidate against its parameters, with the Pareto front of the two.

    Args:
        history: of the search.
        path: picture to write; its suffix is the format.
    """
    figure, axes = _chart(history)
    shown = [item for item in history.candidates.values() if item.comparable and item.parameters]
    _dots(axes, _sizes(shown), OTHER, "candidate")
    _line(axes, _sizes(history.front), KEPT, "Pareto front", drawstyle="steps-post", markersize=4, linewidth=1.2)
    _line(axes, _sizes(item for item, _ in history.path), PATH, "committed path", linestyle="--", linewidth=1.2)
    root = [item for item in shown if item.key == history.root]
    axes.plot(*_columns(_sizes(root)), "s", color="black", markersize=8, label="root", zorder=4)
    axes.set_xlabel("parameters")
    sizes = [item.parameters or 1 for item in shown]
    if sizes and max(sizes) > 10 * min(sizes):
        axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:,.0f}")
    _finish(figure, path)


def write_tree(history: SearchHistory, *paths: Path) -> None:
    """Write the search tree from left to right, every column one operation further, the best children on top.

    Args:
        history: of the search.
        paths: pictures to write; their suffixes are the formats. The texts of an SVG can be searched.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    places = _layout(history)
    label = _LETTER * max((len(item.operation) for item in history.candidates.values()), default=0)
    pitch = _BOX_WIDTH + 2 * _STUB + label + 0.1
    columns = 1 + max((column for column, _ in places.values()), default=0)
    width = max(columns * pitch - pitch + _BOX_WIDTH + 2 * _MARGIN, 8.0)
    height = _HEADER + max((y for _, y in places.values()), default=0.0) + _KEPT_HEIGHT + _MARGIN
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(height, 0))  # inches: texts keep to their boxes
    axes.axis("off")
    for column in range(columns):
        heading = f"operation {column}" if column else "root"
        axes.text(_MARGIN + column * pitch, _HEADER - 0.12, heading, fontsize=8, color="0.4")
    corners = {key: (_MARGIN + column * pitch, _HEADER + y) for key, (column, y) in places.items()}
    looks = _looks(history)
    for key, corner in corners.items():
        candidate = history.candidates[key]
        if candidate.parent is not None:
            _draw_edge(axes, candidate, looks, corners[candidate.parent], corner)
        _draw_node(axes, history, candidate, looks[key], corner)
    _draw_legend(figure, history)
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "ggcnn_net2net"}):
        for path in paths:
            with replacing(path) as temporary:
                figure.savefig(temporary, dpi=min(150, _MOST_PIXELS / max(width, height)))


def _looks(history: SearchHistory) -> dict[str, str]:
    """Colour of every candidate."""
    kept = history.kept
    path = {key for item, _ in history.path for key in (item.key, item.parent)}  # parent: what was trained further

    def colour(item: CandidateRecord) -> str:
        if item.key in path:
            return PATH
        if item.state == "failed":
            return FAILED
        return KEPT if item.key in kept else OTHER

    return {key: colour(item) for key, item in history.candidates.items()}


def _height(colour: str) -> float:
    """Of a node of that colour."""
    return _KEPT_HEIGHT if colour in (PATH, KEPT) else _OTHER_HEIGHT


def _layout(history: SearchHistory) -> dict[str, tuple[int, float]]:
    """Column and height of every candidate: parents beside the middle of their children, subtrees close together."""
    looks = _looks(history)
    children: dict[str | None, list[CandidateRecord]] = defaultdict(list)
    for candidate in sorted(history.candidates.values(), key=history.rank):
        children[candidate.parent].append(candidate)
    places: dict[str, tuple[int, float]] = {}
    free: dict[int, float] = defaultdict(float)  # where the empty part of a column begins

    def half_row(key: str) -> float:
        return (_height(looks[key]) + _ROW_GAP) / 2

    def put(key: str, column: int, y: float) -> None:
        places[key] = column, y
        free[column] = max(free[column], y + half_row(key))

    def move(key: str, by: float) -> None:
        put(key, places[key][0], places[key][1] + by)
        for child in children[key]:
            move(child.key, by)

    def lay(key: str, column: int) -> None:
        highest = free[column] + half_row(key)
        family = [child.key for child in children[key]]
        for child in family:
            lay(child, column + 1)
        middle = (places[family[0]][1] + places[family[-1]][1]) / 2 if family else highest
        put(key, column, middle)
        if middle < highest:
            move(key, highest - middle)
        if family:
            free[column + 1] += _FAMILY_GAP

    for root in children[None]:
        lay(root.key, 0)
    return places


def _draw_edge(
    axes: Any, child: CandidateRecord, looks: dict[str, str], start: tuple[float, float], end: tuple[float, float]
) -> None:
    """From a parent to a child, by a trunk that all children of the parent share; the operation beside the child."""
    colour = looks[child.key]
    left = start[0] + _BOX_WIDTH
    trunk = left + _STUB
    axes.plot(
        (left, trunk, trunk, end[0]),
        (start[1], start[1], end[1], end[1]),
        color=OTHER if colour == FAILED else colour,
        linewidth={PATH: 2.2, KEPT: 1.0}.get(colour, 0.5),
        zorder={PATH: 3, KEPT: 2}.get(colour, 1),
        solid_joinstyle="round",
    )
    axes.text(
        end[0] - 0.08,
        end[1],
        child.operation,
        ha="right",
        va="center_baseline",
        fontsize=_LABEL_SIZE,
        color={OTHER: "0.4"}.get(colour, colour),
        zorder=4,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6},
    )


def _draw_node(
    axes: Any, history: SearchHistory, candidate: CandidateRecord, colour: str, corner: tuple[float, float]
) -> None:
    """A box with score and parameters; its left side begins at the corner."""
    from matplotlib.patches import FancyBboxPatch

    height = _height(colour)
    left, middle = corner
    best = candidate == history.best
    axes.add_patch(
        FancyBboxPatch(
            (left, middle - height / 2),
            _BOX_WIDTH,
            height,
            boxstyle=f"round,pad=0,rounding_size={height / 5}",
            facecolor={PATH: "#fdebd8", KEPT: "#e6f0fa"}.get(colour, "white"),
            edgecolor="black" if best else colour,
            linewidth=2 if best else 1.2 if colour in (PATH, KEPT) else 0.5,
            linestyle="--" if candidate.state == "pruned" else "-",
            zorder=5,
        )
    )
    score = "failed" if candidate.state == "failed" else history.score_text(candidate.score)
    size = "" if candidate.parameters is None else f"{candidate.parameters:,}"
    centre = left + _BOX_WIDTH / 2
    if colour in (PATH, KEPT):
        write = partial(axes.text, centre, ha="center", va="center", zorder=6)
        write(middle - 0.075, score, fontsize=9, weight="bold")
        write(middle + 0.09, size, fontsize=7.5)
    else:
        text = f"{score}  {size}"
        axes.text(
            centre,
            middle,
            text,
            ha="center",
            va="center",
            fontsize=6.5,
            zorder=6,
            color=FAILED if colour == FAILED else "0.35",
        )


def _draw_legend(figure: Any, history: SearchHistory) -> None:
    from matplotlib.patches import Patch

    meanings = [
        Patch(facecolor="#fdebd8", edgecolor=PATH, label="committed path"),
        Patch(facecolor="#fdebd8", edgecolor="black", linewidth=2, label="best of the path"),
        Patch(facecolor="#e6f0fa", edgecolor=KEPT, label="kept in a beam"),
        Patch(facecolor="white", edgecolor=OTHER, label="not kept"),
        Patch(facecolor="white", edgecolor=OTHER, linestyle="--", label="pruned"),
        Patch(facecolor="white", edgecolor=FAILED, label="failed"),
    ]
    width, height = figure.get_size_inches()
    title = f"{len(history.candidates)} candidates from {history.network}: {history.score_name} and parameters"
    figure.text(_MARGIN / width, 1 - 0.3 / height, title, fontsize=12, weight="bold", parse_math=False)
    figure.legend(
        handles=meanings,
        loc="upper left",
        bbox_to_anchor=((_MARGIN - 0.1) / width, 1 - 0.35 / height),
        ncols=len(meanings),
        frameon=False,
        fontsize=8,
        columnspacing=1.2,
        handlelength=1.5,
    )


def _chart(history: SearchHistory) -> tuple[Any, Any]:
    from matplotlib.figure import Figure  # slow to import

    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    axes.set_ylabel(history.score_name)
    axes.grid(axis="y", color="0.92")
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _dots(axes: Any, points: Sequence[Point], colour: str, label: str, marker: str = "o") -> None:
    axes.scatter(*_columns(points), s=18, alpha=0.6, color=colour, marker=marker, linewidths=0, label=label)


def _line(axes: Any, points: Sequence[Point], colour: str, label: str, **style: Any) -> None:
    usual = {"markersize": 7, "linewidth": 2, "zorder": 3}
    axes.plot(*_columns(points), marker="o", color=colour, label=label, **usual | style)


def _sizes(candidates: Iterable[CandidateRecord]) -> list[Point]:
    """Parameters and score."""
    return [(item.parameters, item.score) for item in candidates if item.parameters]


def _columns(points: Sequence[Point]) -> tuple[list[float], list[float]]:
    return [x for x, _ in points], [y for _, y in points]


def _finish(figure: Any, path: Path) -> None:
    figure.legend(loc="outside upper center", ncols=4, frameon=False, fontsize=9)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=150)
