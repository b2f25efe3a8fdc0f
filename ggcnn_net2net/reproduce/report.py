"""Table I for people: terminal, Markdown and bar chart."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from textwrap import fill

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from tabulate import tabulate

from ggcnn_net2net.atomic import replacing, write_text
from ggcnn_net2net.reproduce.networks import CONTROL
from ggcnn_net2net.reproduce.results import Table1, Table1Row
from ggcnn_net2net.reproduce.statistics import PairedComparison, Rate

HEADINGS = ("GG-CNN", "parameters", "success", "rate (95% interval)", "in bin", "paper", "p")
CONTROL_HEADING = "p (control)"
_LABEL_WIDTH = 18  # characters of a network's name that fit below its bars


def print_table(console: Console, table: Table1) -> None:
    """Show the table in the terminal, with what a reader has to know below it."""
    shown = Table(title="Table I: success and size", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in headings(table):
        shown.add_column(heading, justify="left" if heading == HEADINGS[0] else "right", no_wrap=True)
    for row in cells(table):
        shown.add_row(*map(escape, row))
    # A narrow terminal breaks lines, which can still be read; rich would cut numbers.
    shown.width = console.measure(shown, options=console.options.update(max_width=1000)).maximum
    console.print(shown, soft_wrap=True)
    for line in captions(table):
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def headings(table: Table1) -> tuple[str, ...]:
    """Of the columns; one more where the table has a control."""
    return (*HEADINGS, CONTROL_HEADING) if table.has_control else HEADINGS


def cells(table: Table1) -> list[tuple[str, ...]]:
    """The texts of all rows, in the order of `headings`."""
    rows = [_cells(row) for row in table.rows]
    return rows if table.has_control else [row[: len(HEADINGS)] for row in rows]


def _cells(row: Table1Row) -> tuple[str, ...]:
    rate, in_bin = row.success, row.in_bin
    low, high = rate.interval
    return (
        row.network.name,
        f"{row.network.parameters:,}",
        f"{rate.successes}/{rate.trials}" if rate.trials else "-",
        f"{rate.value:.3f} ({low:.3f}-{high:.3f})" if rate.trials else "-",
        f"{in_bin.successes}/{in_bin.trials}" if rate.trials else "-",
        f"{row.network.paper.accuracy:.3f}" if row.network.paper else "-",
        _p_value(row.comparison),
        _p_value(row.control_comparison),
    )


def _p_value(comparison: PairedComparison | None) -> str:
    return f"{comparison.p_value:.3g}" if comparison else "-"


def captions(table: Table1) -> list[str]:
    """What a reader has to know beside the numbers."""
    settings = table.scenes
    original = "the stand-in of the published network" if table.has_stand_in else "the published network"
    lines = [
        f"Objects {settings.object_set}, {settings.poses} pose(s) each, seed {settings.seed}, protocol "
        f"{table.protocol.name}. The paper: 40 ShapeNetSem objects, 5 poses each.",
        "Success: object within 0.7 m of the bin's centre (the paper's rule); in bin: between its walls. Interval: "
        f"Wilson. Paper: its accuracy. p: McNemar's exact test against {original}, same scenes.",
    ]
    sizes = {field.name: (getattr(table.gripper, field.name), field.default) for field in fields(table.gripper)}
    changed = ", ".join(f"{name} {value}" for name, (value, of_paper) in sizes.items() if value != of_paper)
    if changed:
        lines.append(f"Gripper not the paper's: {changed}. Rates of different grippers cannot be compared.")
    if table.has_control:
        lines.append(
            f"{CONTROL_HEADING}: the same test against the row {CONTROL}, the original with more training and no "
            "surgery: what is left of a gain once more training is accounted for."
        )
    networks = [row.network for row in table.rows]
    papers = ", ".join(f"{network.name} {network.paper.parameters:,}" for network in networks if network.paper)
    if papers:
        lines.append(f"The paper's parameters: {papers}.")
    for row in table.rows:
        if row.network.note:
            lines.append(f"{row.network.name}: {row.network.note}")
        if row.network.sha256:
            lines.append(f"{row.network.name}: {row.network.file}, SHA-256 {row.network.sha256}")
        failures = ", ".join(f"{count} {name}" for name, count in row.outcomes.most_common() if name != "success")
        if failures:
            lines.append(f"{row.network.name}, failures: {failures}")
    if table.crashed:
        lines.append(
            f"INCOMPLETE: {table.crashed} grasp(s) were lost because a worker process died; run the command again"
        )
    return lines


def write_markdown(path: Path, table: Table1, command: str, versions: dict[str, str]) -> None:
    """Write the table as Markdown, with the command and versions that made it."""
    lines = [
        "# Table I",
        "",
        tabulate(cells(table), headings(table), tablefmt="pipe", disable_numparse=True),
        "",
        *(f"* {line}" for line in captions(table)),
        f"* Made by `{command}` with {', '.join(f'{name} {number}' for name, number in versions.items())}.",
    ]
    write_text(path, "\n".join(lines) + "\n")


def write_chart(path: Path, table: Table1) -> None:
    """Write a bar chart: our rates with their intervals beside the paper's."""
    from matplotlib.figure import Figure  # slow to import

    figure = Figure(figsize=(1.6 + 1.6 * len(table.rows), 4), layout="constrained")
    axes = figure.subplots()
    positions = range(len(table.rows))
    rates = [row.success for row in table.rows]
    axes.bar(
        [position - 0.2 for position in positions],
        [rate.value if rate.trials else 0 for rate in rates],
        0.38,
        yerr=_error_bars(rates),
        capsize=4,
        color="0.35",
        label=f"here ({table.scenes.object_set})",
    )
    axes.bar(
        [position + 0.2 for position in positions],
        [row.network.paper.accuracy if row.network.paper else 0 for row in table.rows],
        0.38,
        color="0.8",
        edgecolor="0.35",
        hatch="//",
        label="paper (ShapeNetSem)",
    )
    for position, row in zip(positions, table.rows, strict=True):
        if not row.success.trials:
            axes.annotate("no model", (position - 0.2, 0.02), rotation=90, ha="center", fontsize=8)
    names = [
        f"{fill(row.network.name, _LABEL_WIDTH, break_on_hyphens=False)}\n{row.network.parameters:,}"
        for row in table.rows
    ]
    axes.set_xticks(list(positions), names, parse_math=False)
    axes.set_ylim(0, 1)
    axes.set_ylabel("success rate, 95% interval")
    axes.set_title(f"Grasp success, {max((rate.trials for rate in rates), default=0)} grasps a network")
    legend = figure.legend(loc="outside lower center", ncols=2, fontsize=8)
    for text in legend.get_texts():
        text.set_parse_math(False)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=150)


def _error_bars(rates: Iterable[Rate]) -> list[list[float]]:
    below, above = [], []
    for rate in rates:
        low, high = rate.interval if rate.trials else (0.0, 0.0)
        value = rate.value if rate.trials else 0.0
        below.append(value - low)
        above.append(high - value)
    return [below, above]
