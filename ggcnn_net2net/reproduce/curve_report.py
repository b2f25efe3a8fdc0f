"""Curves for people: a picture, the numbers in it as CSV, and a Markdown table."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tabulate import tabulate

from ggcnn_net2net.atomic import replacing, write_text
from ggcnn_net2net.reproduce.curves import IOU, SCORE, SIM, CurvePoint, CurveResult
from ggcnn_net2net.reproduce.experiments import Experiment

_METRICS = {IOU: "IoU rate", SIM: "SIM, success rate in simulation"}
_TRIALS = {
    IOU: "IoU rate: {} test images of",
    SCORE: "IoU rate: {} test images that the search selected on, of",
    SIM: "SIM: {} grasps of",
}
Style = dict[str, Any]
_STYLES = (("#1b6ca8", "o"), ("#d1600a", "s"), ("#2a8a4a", "^"), ("#8b4a9e", "D"))  # markers, for those who see grey
_OURS: Style = {"linestyle": "-", "linewidth": 2, "marker": "o", "markersize": 5, "zorder": 3}
_PAPERS: Style = {
    "linestyle": "--",
    "linewidth": 1.1,
    "marker": "o",
    "markersize": 4,
    "markerfacecolor": "white",
    "alpha": 0.6,
}
_CSV_COLUMNS = (
    *("figure", "curve", "protocol", "metric", "depth", "operation", "parameters", "architecture"),
    *("value", "low", "high", "successes", "trials", "paper"),
)


def write_report(folder: Path, experiment: Experiment, results: Sequence[CurveResult], source: str) -> list[Path]:
    """Write a picture, and the numbers in it, named after the experiment.

    Args:
        folder: where to.
        experiment: what it is.
        results: of `curves.results_of`.
        source: where our numbers come from, for the reader.

    Returns:
        The picture, the Markdown table, the CSV.
    """
    paths = [folder / f"{experiment.name}{suffix}" for suffix in (".png", ".md", ".csv")]
    picture, markdown, table = paths
    _write_picture(picture, experiment, results)
    write_text(markdown, _markdown(experiment, results, source))
    write_text(table, _csv(experiment, results))
    return paths


def not_run(results: Sequence[CurveResult]) -> list[str]:
    """Which curves have no results yet, one line per protocol with such curves."""
    protocols = list(dict.fromkeys(result.protocol for result in results))
    missing = {
        name: [one.curve.name for one in results if one.protocol == name and not one.points] for name in protocols
    }
    return [f"not run yet in protocol {name}: {', '.join(curves)}" for name, curves in missing.items() if curves]


def conditions(results: Sequence[CurveResult]) -> list[str]:
    """How our numbers were made, a line for each metric and way."""
    lines: dict[str, None] = {}
    for metric in (IOU, SIM):
        for point in (point for result in results for point in result.drawn(metric)):
            trials = _TRIALS[point.metric].format(point.trials or "the")
            search = f"search from {point.network}, budget {point.budget}, seed {point.seed}"
            lines[f"{trials} {point.objects}; {search}"] = None
    return list(lines)


def _write_picture(path: Path, experiment: Experiment, results: Sequence[CurveResult]) -> None:
    from matplotlib.figure import Figure  # slow to import

    protocols = list(dict.fromkeys(result.protocol for result in results))
    notes = conditions(results)
    figure = Figure(figsize=(10, 1.5 + 3.3 * len(protocols) + 0.18 * len(notes)), dpi=130, layout="constrained")
    grid = figure.subplots(len(protocols), len(_METRICS), squeeze=False, sharex=True, sharey="col")
    styles: dict[str, Style] = {
        curve.name: {"color": colour, "marker": marker}
        for curve, (colour, marker) in zip(experiment.curves, _STYLES, strict=False)
    }
    for row, protocol in zip(grid, protocols, strict=True):
        shown = [result for result in results if result.protocol == protocol]
        for axes, (metric, name) in zip(row, _METRICS.items(), strict=True):
            _draw_panel(axes, shown, metric, styles)
            axes.set_title(f"{name}, {protocol}", fontsize=10, loc="left")
            axes.set_xlim(-0.35, experiment.depth + 0.35)
            axes.set_xticks(range(experiment.depth + 1))
    for axes in grid[-1]:
        axes.set_xlabel("operations")
    handles = _legend(styles, results)
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=3 if len(handles) > 5 else len(handles),
        title=experiment.title,
        title_fontproperties={"size": 13, "weight": "bold"},
        frameon=False,
        fontsize=9,
    )
    if notes:
        figure.supxlabel("\n".join(notes), fontsize=8, color="0.35", parse_math=False)
    with replacing(path) as temporary:
        figure.savefig(temporary)


def _draw_panel(axes: Any, results: Sequence[CurveResult], metric: str, styles: dict[str, Style]) -> None:
    axes.grid(axis="y", color="0.92")
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelbottom=True, labelleft=True)
    for number, result in enumerate(results):
        style = styles[result.curve.name]
        shift = 0.07 * (number - (len(results) - 1) / 2)  # or else the intervals hide each other
        papers = result.paper_at(metric)
        axes.plot([depth + shift for depth, _ in papers], [value for _, value in papers], **_PAPERS | style)
        _draw_ours(axes, result.drawn(metric), shift, style)
    missing = [result.curve.name for result in results if not result.drawn(metric)]
    if missing:
        axes.margins(y=0.12)  # room for the note
        note = f"not run yet: {', '.join(missing)}"
        axes.annotate(note, (0, 0), (4, 4), "axes fraction", "offset points", fontsize=8, color="0.4")


def _draw_ours(axes: Any, points: Sequence[CurvePoint], shift: float, style: Style) -> None:
    depths, values = [point.depth + shift for point in points], [point.value for point in points]
    axes.plot(depths, values, **_OURS | style)
    for depth, point in zip(depths, points, strict=True):
        if point.interval is not None:
            axes.plot((depth, depth), point.interval, color=style["color"], linewidth=1, alpha=0.7, zorder=2)


def _legend(styles: dict[str, Style], results: Sequence[CurveResult]) -> list[Any]:
    from matplotlib.lines import Line2D

    handles = [Line2D([], [], linewidth=2, label=name, **style) for name, style in styles.items()]
    handles.append(Line2D([], [], color="0.3", label="here, with 95% interval", **_OURS))
    if any(result.paper for result in results):
        handles.append(Line2D([], [], color="0.3", label="the paper, read off its figure", **_PAPERS))
    return handles


def _markdown(experiment: Experiment, results: Sequence[CurveResult], source: str) -> str:
    lines = [f"# {experiment.title}", "", source, ""]
    lines += [f"* {line}" for line in (*conditions(results), *not_run(results))]
    lines += [
        "* IoU: over all test images. Search: what the search saw of the network, on the images it selected on. "
        "In brackets: Wilson 95% interval. Paper: read off its plots (±0.003).",
        "",
    ]
    headings = ("operations", "last", "parameters", "IoU", "IoU, search", "IoU, paper", "SIM", "SIM, paper")
    for result in results:
        rows = [_cells(result, depth) for depth in _depths(result)]
        if rows:
            table = tabulate(rows, headings, tablefmt="pipe", disable_numparse=True)
            lines += [f"## {result.curve.name}, {result.protocol}", "", table, ""]
    return "\n".join(lines)


def _depths(result: CurveResult) -> list[int]:
    return sorted({depth for _, depth in result.paper} | {point.depth for point in result.points})


def _cells(result: CurveResult, depth: int) -> tuple[str, ...]:
    ours = {point.metric: point for point in result.points if point.depth == depth}
    known = next(iter(ours.values()), None)
    paper = {metric: result.paper.get((metric, depth)) for metric in (IOU, SIM)}
    return (
        str(depth),
        known.operation if known else "-",
        f"{known.parameters:,}" if known else "-",
        _rate(ours.get(IOU)),
        f"{ours[SCORE].value:.3f}" if SCORE in ours else "-",
        "-" if paper[IOU] is None else f"{paper[IOU]:.3f}",
        _rate(ours.get(SIM)),
        "-" if paper[SIM] is None else f"{paper[SIM]:.3f}",
    )


def _rate(point: CurvePoint | None) -> str:
    if point is None:
        return "-"
    if point.interval is None:
        return f"{point.value:.3f}"
    low, high = point.interval
    return f"{point.successes}/{point.trials} = {point.value:.3f} ({low:.3f}-{high:.3f})"


def _csv(experiment: Experiment, results: Sequence[CurveResult]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_CSV_COLUMNS)
    for result in results:
        for metric in _METRICS:
            ours = {point.depth: point for point in result.drawn(metric)}
            papers = dict(result.paper_at(metric))
            for depth in sorted(ours.keys() | papers.keys()):
                point = ours.get(depth)
                place = (experiment.name, result.curve.name, result.protocol, point.metric if point else metric, depth)
                writer.writerow((*place, *_csv_cells(point), papers.get(depth, "")))
    return text.getvalue()


def _csv_cells(point: CurvePoint | None) -> tuple[Any, ...]:
    if point is None:
        return ("",) * 8
    counts = ("", "") if point.interval is None else (point.successes, point.trials)
    return (
        *(point.operation, point.parameters, point.architecture, point.value),
        *(point.interval or ("", "")),
        *counts,
    )
