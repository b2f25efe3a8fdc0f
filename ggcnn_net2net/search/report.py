"""What a search found, for people and for other programs: CSV, JSON, Markdown, pictures and the terminal."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ggcnn_net2net.atomic import replacing, write_text
from ggcnn_net2net.protocol import CORRECTED, PAPER
from ggcnn_net2net.search.history import SearchHistory
from ggcnn_net2net.search.journal import score_to_json
from ggcnn_net2net.search.pictures import write_depth_chart, write_size_chart, write_tree

if TYPE_CHECKING:
    from rich.console import RenderableType

COLUMNS = (
    "candidate", "parent", "depth", "operation", "operations", "state", "score", "parameters", "architecture", "epochs",
    "loss", "seconds", "lookaheads", "on_path", "error",
)  # fmt: skip
"""Of candidates.csv, in this order. "operations" is the sequence from the root, "lookaheads" the numbers of those that
kept the candidate, both separated by ", ". What is not known is empty."""

PATH_HEADINGS = ("depth", "operation", "architecture", "parameters", "score", "gain")
UNFINISHED = "The search is not finished."
_PRESETS = {protocol.name: protocol.as_dict() for protocol in (PAPER, CORRECTED)}
_SIZE_HEADINGS = ("parameters", "score", "operations", "candidate")


def write_report(history: SearchHistory, folder: Path) -> list[Path]:
    """Write all that is known of a search; it may still run.

    Args:
        history: of the search.
        folder: where to write; made if it is not there.

    Returns:
        The files: report.md, candidates.csv (one row a candidate, `COLUMNS`), candidates.json (the same as a list of
        records, with the scores of the replicates, the tracebacks, and the search that a candidate was taken from),
        score.png, parameters.png, tree.svg, tree.png.
    """
    names = ("report.md", "candidates.csv", "candidates.json", "score.png", "parameters.png", "tree.svg", "tree.png")
    paths = [Path(folder) / name for name in names]
    report, table, records, score, size, *tree = paths
    write_candidates(history, table, records)
    write_depth_chart(history, score)
    write_size_chart(history, size)
    write_tree(history, *tree)
    write_text(report, markdown(history))
    return paths


def write_candidates(history: SearchHistory, table: Path, records: Path) -> None:
    """Write one row a candidate, in the order in which the search met them, as CSV and as JSON."""
    rows = _records(history)
    with replacing(table) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    write_text(records, json.dumps(rows, indent=1, allow_nan=False) + "\n")


def _records(history: SearchHistory) -> list[dict[str, Any]]:
    kept, path = history.kept, {candidate.key for candidate, _ in history.path}
    return [
        {
            "candidate": item.key,
            "parent": item.parent,
            "depth": item.depth,
            "operation": item.operation,
            "operations": ", ".join(item.operations),
            "state": item.state,
            "score": score_to_json(item.score),
            "parameters": item.parameters,
            "architecture": item.architecture,
            "epochs": item.epochs,
            "loss": score_to_json(item.loss),
            "seconds": item.seconds,
            "lookaheads": ", ".join(str(number) for number in kept.get(item.key, [])),
            "on_path": item.key in path,
            "error": item.error,
            "replicate_scores": [score_to_json(score) for score in item.replicate_scores],
            "traceback": item.traceback,
            "taken_from": item.taken_from,
        }
        for item in history.candidates.values()
    ]


def path_rows(history: SearchHistory) -> list[tuple[str, ...]]:
    """Texts of the path under `PATH_HEADINGS`, the root first; gain: over the row before."""
    scores = [score for _, score in history.path]
    gains = [math.nan, *(after - before for before, after in pairwise(scores))]
    return [
        (
            str(item.depth),
            item.operation,
            item.architecture,
            _count(item.parameters),
            history.score_text(score),
            history.score_text(gain, "+"),
        )
        for (item, score), gain in zip(history.path, gains, strict=False)
    ]


def counts(history: SearchHistory) -> list[str]:
    """What the search has done, in a few lines."""
    lines = [
        f"{history.trained} candidates trained, {len(history.failed)} failed, {duration(history.seconds)} of work, "
        "summed over the workers.",
        *([f"{history.taken} more were taken from other searches, which have trained them."] if history.taken else []),
        f"{history.reused} were met again by a later lookahead and reused: {history.avoided:.0%} of all trainings "
        "avoided.",
    ]
    pruned = sum(item.state == "pruned" for item in history.candidates.values())
    if pruned:
        lines.append(f"{pruned} of the trained ones were stopped early by successive halving.")
    for name, best in (("on the path", history.best), ("of all", history.best_of_all)):
        if best:
            size = _count(best.parameters)
            score = history.score_text(best.score)
            lines.append(f"Best {name}: {best.sequence}, {history.score_name} {score}, {size} parameters.")
    return lines


def duration(seconds: float) -> str:
    """Hours, minutes and seconds, like 1:02:03."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


def markdown(history: SearchHistory) -> str:
    """The report as a Markdown text; its pictures are expected beside it."""
    front = [
        (_count(item.parameters), history.score_text(item.score), item.sequence, item.key) for item in history.front
    ]
    failures = [(item.sequence, item.key, item.error) for item in history.failed]
    sections = [
        f"# Search from {history.network}",
        *([] if history.finished else [f"**{UNFINISHED}**"]),
        *counts(history),
        "## Path",
        _table(path_rows(history), PATH_HEADINGS),
        f"Score: {history.score_name}.",
        _how_biased(history),
        "![Score against depth](score.png)",
        "## Score against size",
        "No candidate of at most the same size scores better than these:",
        _table(front, _SIZE_HEADINGS),
        "![Score against parameters](parameters.png)",
        "## Failed",
        _table(failures, ("operations", "candidate", "error")) if failures else "None.",
        "## Settings",
        _table(_flat(history.settings.as_dict()), ("setting", "value")),
        f"Data: `{history.data['path']}`, train {history.data['train']}, test {history.data['test']}.",
        f"Made by `{history.command}` with {_versions(history.versions)}.",
        *(f"**Resumed with other versions**: {_versions(later)}." for later in history.later_versions),
        "## Tree",
        "![All candidates](tree.svg)",
    ]
    return "\n\n".join(sections) + "\n"


def _how_biased(history: SearchHistory) -> str:
    scenes = "simulated scenes" if history.settings.heuristic == "sim" else "test images"
    return (
        f"**Scores are of the {scenes} that the search selected on.** The best of {len(history.candidates)} noisy "
        "scores is partly luck, so they promise more than the networks keep, the more so the more candidates there "
        "are and the less data scores them. Judge the result on data that the search has not seen."
    )


def rich_summary(history: SearchHistory) -> RenderableType:
    """The path and the counts for the terminal."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(title=f"Path of the search, by {history.score_name}", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in PATH_HEADINGS:
        table.add_column(heading, justify="left" if heading in ("operation", "architecture") else "right")
    for (candidate, _), row in zip(history.path, path_rows(history), strict=True):
        table.add_row(*row, style="bold" if candidate == history.best else "")
    lines = counts(history) if history.finished else [UNFINISHED, *counts(history)]
    return Group(table, *(Text(line) for line in lines))


def _table(rows: Sequence[Sequence[str]], headings: Sequence[str]) -> str:
    from tabulate import tabulate

    cells = [[cell.replace("|", r"\|") for cell in row] for row in rows]
    return tabulate(cells, headings, tablefmt="pipe", disable_numparse=True)


def _versions(versions: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {text}" for name, text in versions.items())


def _flat(settings: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Settings within settings as `recipe.epochs`; of a protocol its name, and what differs from its preset."""
    rows = []
    for name, value in settings.items():
        if name == "protocol":
            rows.append((f"{prefix}{name}", str(value["name"])))
            usual = _PRESETS.get(value["name"], {})
            rows += _flat(
                {field: text for field, text in value.items() if text != usual.get(field)}, f"{prefix}{name}."
            )
        elif isinstance(value, dict):
            rows += _flat(value, f"{prefix}{name}.")
        else:
            rows.append((f"{prefix}{name}", str(value)))
    return rows


def _count(parameters: int | None) -> str:
    return "-" if parameters is None else f"{parameters:,}"
