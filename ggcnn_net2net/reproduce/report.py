"""Table I for people: terminal, Markdown and bar chart."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from tabulate import tabulate

from ggcnn_net2net.atomic import replacing, write_text
from ggcnn_net2net.reproduce.results import Table1, Table1Row
from ggcnn_net2net.reproduce.statistics import Rate

HEADINGS = ("GG-CNN", "parameters", "success", "rate (95% interval)", "in bin", "paper", "p")


def print_table(console: Console, table: Table1) -> None:
    """Show the table in the terminal, with what a reader has to know below it."""
    shown = Table(title="Table I: success and size", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in HEADINGS:
        shown.add_column(heading, justify="left" if heading == HEADINGS[0] else "right", no_wrap=True)
    for row in table.rows:
        shown.add_row(*cells(row))
    console.print(shown)
    for line in captions(table):
        console.print(line, highlight=False, soft_wrap=True)


def cells(row: Table1Row) -> tuple[str, ...]:
    """The texts of one row, in the order of `HEADINGS`."""
    rate, in_bin = row.success, row.in_bin
    low, high = rate.interval
    return (
        row.network.name,
        f"{row.network.parameters:,}",
        f"{rate.successes}/{rate.trials}" if rate.trials else "-",
        f"{rate.value:.3f} ({low:.3f}-{high:.3f})" if rate.trials else "-",
        f"{in_bin.successes}/{in_bin.trials}" if rate.trials else "-",
        f"{row.network.paper.accuracy:.3f}" if row.network.paper else "-",
        f"{row.comparison.p_value:.3g}" if row.comparison else "-",
    )


def captions(table: Table1) -> list[str]:
    """What a reader has to know beside the numbers."""
    settings = table.scenes
    lines = [
        f"Objects {settings.object_set}, {settings.poses} pose(s) each, seed {settings.seed}, protocol "
        f"{table.protocol.name}. The paper: 40 ShapeNetSem objects, 5 poses each.",
        "Success: object within 0.7 m of the bin's centre (the paper's rule); in bin: between its walls. Interval: "
        "Wilson. Paper: its accuracy. p: McNemar's exact test against the published network, same scenes.",
    ]
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
        tabulate([cells(row) for row in table.rows], HEADINGS, tablefmt="pipe", disable_numparse=True),
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
    names = [f"{row.network.name}\n{row.network.parameters:,}" for row in table.rows]
    axes.set_xticks(list(positions), names)
    axes.set_ylim(0, 1)
    axes.set_ylabel("success rate, 95% interval")
    axes.set_title(f"Grasp success, {max((rate.trials for rate in rates), default=0)} grasps a network")
    figure.legend(loc="outside lower center", ncols=2, fontsize=8)
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
