"""What a search takes from others, and what it does not."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import pytest
from scripted_workers import ScriptedWorkers
from search_data import ARCHITECTURE, SIZE, write_dataset

from ggcnn_net2net.architecture import build_ggcnn
from ggcnn_net2net.errors import SearchError
from ggcnn_net2net.protocol import CORRECTED, PAPER
from ggcnn_net2net.search import SearchSettings, resume_search, start_search
from ggcnn_net2net.search.journal import read_events
from ggcnn_net2net.search.reuse import differences
from ggcnn_net2net.training import Recipe

FIRST = SearchSettings(width=2, depth=3, recipe=Recipe(epochs=2, protocol=CORRECTED), score_images=4)
WIDER = replace(FIRST, width=3)


@pytest.fixture(scope="module")
def model():
    return build_ggcnn(ARCHITECTURE, input_size=SIZE, seed=0)


@pytest.fixture
def lineage():
    """What all workers of a test know of candidates: one that was taken has children, too."""
    return {}


@pytest.fixture
def search(model, dataset, tmp_path, lineage):
    """Function: run a search in a folder of this name; returns (history, keys of what was trained, folder)."""

    def search(name, settings=FIRST, *, reuse=(), data=dataset, stop_after=float("inf")):
        workers = ScriptedWorkers(stop_after=stop_after)
        workers.lineage = lineage
        directory = tmp_path / name
        history = start_search(model, data, settings, directory, workers, reuse=reuse)
        return history, [job.candidate.key for job in workers.jobs], directory

    return search


def outcome(history):
    return [(candidate.key, score) for candidate, score in history.path], history.lookaheads


def models_in(directory):
    return {path.parent.name: path.read_text() for path in (directory / "candidates").glob("*/model.hdf5")}


@pytest.mark.parametrize("settings", [WIDER, replace(FIRST, lookahead=False), replace(FIRST, max_parameters=1500)])
def test_the_result_is_that_of_a_search_on_its_own(search, settings):
    alone, all_trained, _ = search("alone", settings)
    _, before, first = search("first")
    history, trained, directory = search("second", settings, reuse=[first])
    assert outcome(history) == outcome(alone)
    assert set(trained) == set(all_trained) - set(before)
    assert len(trained) < len(all_trained)
    assert (directory / "best.hdf5").read_text() == models_in(directory)[history.best.key]
    assert models_in(directory).keys() == history.candidates.keys()


def test_what_was_taken_says_where_from(search):
    _, before, first = search("first")
    _, trained, directory = search("second", WIDER, reuse=[first])
    begun, *events = read_events(directory / "journal.jsonl")
    assert begun["reuse"] == [str(first)]
    scored = [event for event in events if event["event"] == "scored"]
    assert {event["candidate"] for event in scored if event.get("taken_from") == str(first)} <= set(before)
    assert {event["candidate"] for event in scored if "taken_from" not in event} == set(trained)
    # ... and is taken from this one as from any.
    _, again, _ = search("third", WIDER, reuse=[directory])
    assert again == []


@pytest.mark.parametrize(
    "other",
    [
        replace(FIRST, seed=1),
        replace(FIRST, score_images=5),
        replace(FIRST, heuristic="loss"),
        replace(FIRST, threads=2),
        replace(FIRST, transpose=True),
        replace(FIRST, recipe=Recipe(epochs=3, protocol=CORRECTED)),
        replace(FIRST, recipe=Recipe(epochs=2, protocol=PAPER)),
    ],
)
def test_nothing_is_taken_where_anything_matters(search, other):
    _, _, first = search("first", other)
    _, alone, _ = search("alone")
    _, trained, _ = search("second", reuse=[first])
    assert trained == alone


def test_nothing_is_taken_of_other_data_or_versions(search, tmp_path):
    _, alone, first = search("first")
    _, trained, _ = search("other_data", data=write_dataset(tmp_path / "other.h5", test=7), reuse=[first])
    assert len(trained) == len(alone)
    journal = first / "journal.jsonl"
    begun, *rest = journal.read_text().splitlines()
    event = json.loads(begun)
    event["versions"]["tensorflow"] = "2.0"
    journal.write_text("\n".join([json.dumps(event), *rest, ""]))
    assert search("other_versions", reuse=[first])[1] == alone


def test_a_failure_and_a_network_that_is_gone_are_not_taken(search):
    history, before, first = search("first")
    gone = history.path[1][0].key
    shutil.rmtree(first / "candidates" / gone)
    _, trained, _ = search("second", reuse=[first])
    assert trained == [gone]
    assert len(before) > 1


def test_a_resumed_search_goes_on_taking_and_does_without_what_is_gone(search, lineage, tmp_path):
    alone, all_trained, _ = search("alone", WIDER)
    _, before, first = search("first")
    new = set(all_trained) - set(before)
    with pytest.raises(KeyboardInterrupt):
        search("second", WIDER, reuse=[first], stop_after=1)
    shutil.copytree(tmp_path / "second", tmp_path / "copy")
    workers = ScriptedWorkers()
    workers.lineage = lineage
    history = resume_search(tmp_path / "second", workers)
    assert outcome(history) == outcome(alone)
    assert len(workers.jobs) == len(new) - 1
    shutil.rmtree(first)
    workers.jobs = []
    assert outcome(resume_search(tmp_path / "copy", workers)) == outcome(alone)
    assert len(workers.jobs) > len(new) - 1


def test_folders_without_a_search_and_settings_that_need_more_are_refused(search, tmp_path):
    with pytest.raises(SearchError, match="expected the folder of a search"):
        search("second", reuse=[tmp_path])
    _, _, first = search("first")
    taught = replace(FIRST, distil="teacher.hdf5", recipe=Recipe(epochs=2, protocol=PAPER))
    for settings in (replace(FIRST, halving=True), replace(FIRST, carry_optimizer=True), taught):
        with pytest.raises(SearchError, match="leave `reuse` out"):
            search("third", settings, reuse=[first])
    assert not (tmp_path / "third" / "journal.jsonl").exists()


def test_what_differs_is_named(search, model, dataset, tmp_path, monkeypatch):
    _, _, first = search("first")
    assert differences(model, replace(WIDER, max_parameters=1500), dataset, first) == []
    other = replace(FIRST, score_images=3, recipe=replace(FIRST.recipe, images_per_epoch=8, protocol=PAPER))
    found = differences(model, other, write_dataset(tmp_path / "other.h5", train=11), first)
    assert {"recipe.images_per_epoch", "recipe.protocol.name", "score_images", "train images"} <= set(found)
    assert not {"width", "beam.width", "recipe.epochs"} & set(found)
    assert differences(model, FIRST, dataset, tmp_path / "none") == []
    start = build_ggcnn(ARCHITECTURE, input_size=SIZE, seed=1)
    assert differences(start, FIRST, dataset, first) == ["network"]
    monkeypatch.setattr("ggcnn_net2net.search.reuse.versions", lambda: {"keras": "99"})
    assert differences(model, FIRST, dataset, first) == ["versions of the packages"]
