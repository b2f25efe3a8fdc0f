import json
import math
import multiprocessing

import pytest

from ggcnn_net2net.errors import SearchError
from ggcnn_net2net.search.journal import Journal, read_events, score_from_json, score_to_json

EVENTS = [{"event": "one", "score": 0.1 + 0.2}, {"event": "two", "nested": [1, None, {"ä": True}]}]


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "search" / "journal.jsonl"
    with Journal(path) as journal:
        for event in EVENTS:
            journal.append(event)
    return path


def test_what_was_written_is_read(path):
    assert read_events(path) == EVENTS
    assert len(path.read_text().splitlines()) == 2


def test_no_file_has_no_events(tmp_path):
    assert read_events(tmp_path / "none.jsonl") == []


def test_events_are_appended_to_what_is_there(path):
    with Journal(path) as journal:
        journal.append({"event": "three"})
    assert read_events(path) == [*EVENTS, {"event": "three"}]


@pytest.mark.parametrize("cut", range(1, 30, 4))
def test_a_torn_last_line_is_ignored_and_cut_off(path, cut):
    path.write_bytes(path.read_bytes()[:-cut])
    assert read_events(path) == EVENTS[:1]
    with Journal(path) as journal:
        journal.append({"event": "three"})
    assert read_events(path) == [EVENTS[0], {"event": "three"}]


@pytest.mark.parametrize("line", ["no json", "[1]", '{"no": "event"}'])
def test_a_damaged_line_is_an_error_that_names_it(path, line):
    path.write_text(f"{json.dumps(EVENTS[0])}\n{line}\n{json.dumps(EVENTS[1])}\n")
    with pytest.raises(SearchError, match=r"journal\.jsonl.*line 2"):
        read_events(path)


def append_one(path, outcomes):
    try:
        with Journal(path) as journal:
            journal.append({"event": "other process"})
        outcomes.put("written")
    except SearchError as error:
        outcomes.put(str(error))


def test_another_process_waits_for_its_turn(path):
    context = multiprocessing.get_context("spawn")
    outcomes = context.Queue()

    def try_from_elsewhere():
        process = context.Process(target=append_one, args=(path, outcomes))
        process.start()
        process.join(60)
        return outcomes.get(timeout=10)

    with Journal(path):
        assert "another process searches there" in try_from_elsewhere()
        assert read_events(path) == EVENTS
    assert try_from_elsewhere() == "written"
    assert read_events(path) == [*EVENTS, {"event": "other process"}]


@pytest.mark.parametrize("score", [0.0, -1.5, math.nan, math.inf, -math.inf])
def test_scores_are_json(score):
    value = json.loads(json.dumps(score_to_json(score), allow_nan=False))
    assert value == (score if math.isfinite(score) else None)
    assert math.isnan(score_from_json(value)) == (value is None)
