"""The files of a report, read back."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace

import pytest
from journals import MadeUpNetworks, by_hand, failed, lookahead, place, scored, start
from rich.console import Console

from ggcnn_net2net.protocol import CORRECTED
from ggcnn_net2net.search.history import read_history
from ggcnn_net2net.search.report import COLUMNS, counts, duration, markdown, rich_summary, write_report
from ggcnn_net2net.search.settings import SearchSettings
from ggcnn_net2net.training import Recipe


@pytest.fixture(scope="module")
def by_hand_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "new"
    return folder, write_report(read_history(by_hand()), folder)


def rows_of(folder):
    with (folder / "candidates.csv").open(newline="") as stream:
        return {row["candidate"]: row for row in csv.DictReader(stream)}


def test_all_files_are_there(by_hand_folder):
    folder, paths = by_hand_folder
    assert sorted(paths) == sorted(folder.iterdir())
    assert all(path.stat().st_size > 100 for path in paths)


def test_csv(by_hand_folder):
    rows = rows_of(by_hand_folder[0])
    assert list(rows) == ["root", "a", "b", "ad", "aw", "bd", "bw"]
    assert tuple(rows["bd"]) == COLUMNS
    assert list(rows["bd"].values()) == [
        "bd", "b", "2", "deeper(1)", "wider(1), deeper(1)", "trained", "0.8", "1250", "C9x9x8_T9x9x8", "2", "0.01",
        "10.0", "0, 1", "True", "",
    ]  # fmt: skip
    assert (rows["aw"]["state"], rows["aw"]["score"], rows["aw"]["error"]) == ("failed", "", "the loss is not finite")
    assert (rows["a"]["on_path"], rows["a"]["lookaheads"]) == ("False", "0")
    assert (rows["root"]["parent"], rows["root"]["operations"], rows["root"]["loss"]) == ("", "", "")


def test_json_has_the_same_and_more(by_hand_folder):
    folder, _ = by_hand_folder
    records = json.loads((folder / "candidates.json").read_text())
    for record, row in zip(records, rows_of(folder).values(), strict=True):
        assert {name: "" if record[name] is None else str(record[name]) for name in COLUMNS} == row
    assert records[5]["replicate_scores"] == [0.8]
    assert records[4]["score"] is None
    assert records[4]["traceback"] == "Traceback: ..."


def table_of(text, heading):
    """Cells of the first Markdown table after a heading, without its head."""
    lines = text.split(f"## {heading}\n")[1].splitlines()
    table = [line for line in lines[: lines.index("", 2)] if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table[2:]]


def test_markdown():
    text = markdown(read_history(by_hand()))
    assert table_of(text, "Path") == [
        ["0", "root", "C9x9x8_T9x9x8", "1,000", "0.500", "-"],
        ["1", "wider(1)", "C9x9x8_T9x9x8", "1,200", "0.600", "+0.100"],
        ["2", "deeper(1)", "C9x9x8_T9x9x8", "1,250", "0.800", "+0.200"],
    ]
    assert table_of(text, "Failed") == [["deeper(1), wider(1)", "aw", "the loss is not finite"]]
    settings = dict(table_of(text, "Settings"))
    assert (settings["beam.width"], settings["recipe.protocol"], settings["retrain"]) == ("2", "PAPER", "0")
    assert "5 candidates trained, 1 failed, 0:00:56 of work" in text
    assert "2 were met again by a later lookahead and reused: 29% of all trainings avoided" in text
    assert "Scores are of the test images that the search selected on" in text
    assert "not finished" not in text
    assert "not finished" in markdown(read_history(by_hand()[:-1]))


def test_an_error_with_a_bar_does_not_break_the_table():
    events = [start(SearchSettings()), scored("root", None, "root", 0.5)]
    events.append(failed("a", "root", "deeper(1)", error="a | b"))
    assert r"| a \| b" in markdown(read_history(events))


@pytest.mark.parametrize("length", [1, 2, 5, 9])
def test_unfinished_searches_can_be_reported(tmp_path, length):
    history = read_history(by_hand()[:length])
    assert all(path.is_file() for path in write_report(history, tmp_path))
    assert len(rows_of(tmp_path)) == len(history.candidates)


def summary(history):
    console = Console(width=140, record=True, file=io.StringIO())
    console.print(rich_summary(history))
    return console.export_text()


def test_summary_of_the_terminal():
    text = summary(read_history(by_hand()))
    rows = [line.split() for line in text.splitlines()]
    assert ["2", "deeper(1)", "C9x9x8_T9x9x8", "1,250", "0.800", "+0.200"] in rows
    assert "Best on the path: wider(1), deeper(1), IoU rate 0.800, 1,250 parameters." in text
    assert "not finished" in summary(read_history(by_hand()[:1]))


def test_gains_of_the_loss_are_negative_where_it_falls():
    networks = MadeUpNetworks(SearchSettings(depth=2, heuristic="loss"))
    rows = table_of(markdown(read_history(networks.run())), "Path")
    assert rows[0][-2] == "0.71100"
    assert rows[1][-1].startswith("-0.0")


def test_counts_name_the_pruned():
    events = [start(SearchSettings(halving=True)), scored("root", None, "root", 0.5, epochs=0)]
    events += [scored("a", "root", "deeper(1)", 0.9, epochs=1), scored("b", "root", "wider(1)", 0.7)]
    events.append(lookahead(0, "root", [[place("b", 0.7, kept=True), place("a", 0.9, pruned=True)]], ["b"]))
    assert "1 of the trained ones were stopped early by successive halving." in counts(read_history(events))
    assert not any("halving" in line for line in counts(read_history(by_hand())))


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0:00:00"), (59.6, "0:01:00"), (3723, "1:02:03"), (360_000, "100:00:00")]
)
def test_durations(seconds, text):
    assert duration(seconds) == text


def test_what_differs_from_the_protocol_is_told():
    protocol = replace(CORRECTED, wider_noise=0.5)
    settings = dict(
        table_of(markdown(read_history([start(SearchSettings(recipe=Recipe(protocol=protocol)))])), "Settings")
    )
    assert (settings["recipe.protocol"], settings["recipe.protocol.wider_noise"]) == ("CORRECTED", "0.5")
    assert "recipe.protocol.masked_loss" not in settings


def test_what_was_taken_is_not_counted_as_work():
    events = by_hand()
    events[3]["taken_from"] = "elsewhere"
    history = read_history(events)
    assert (history.trained, history.taken, history.seconds) == (4, 1, 46.0)
    assert "1 more were taken from other searches, which have trained them." in counts(history)
    assert not any("taken" in line for line in counts(read_history(by_hand())))


def test_other_versions_are_told():
    resumed = {"event": "resumed", "retry_failed": False, "versions": {"keras": "4.0"}}
    text = markdown(read_history([*by_hand()[:5], resumed, *by_hand()[5:]]))
    assert "with keras 3.15.1." in text
    assert "**Resumed with other versions**: keras 4.0." in text
    assert "Resumed" not in markdown(read_history(by_hand()))
