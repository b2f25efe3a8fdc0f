import json

import pytest
from click.testing import CliRunner

from ggcnn_net2net import zoo
from ggcnn_net2net.cli.zoo import zoo_command
from ggcnn_net2net.errors import ResultsError, SearchError
from ggcnn_net2net.search import SearchSettings
from ggcnn_net2net.search.journal import FORMAT

SHALLOW, GROWN = "C5x5x4_C3x3x2_T3x3x2_T5x5x4", "C5x5x4_C5x5x4_C3x3x2_T3x3x2_T5x5x4"


def scored(key, parent, operation, score, architecture):
    about = {"event": "scored", "candidate": key, "parent": parent, "operation": operation, "score": score}
    outcome = {"loss": 0.1, "parameters": 1000, "architecture": architecture, "operations": {}, "seconds": 2.4}
    return about | outcome | {"epochs": 2 if parent else 0, "replicate": 0, "started": 0.0, "worker": "here:1"}


def journal(best_score=0.60004):
    """One lookahead of one level from a network to its only child, on a dataset somewhere on a machine."""
    place = {"candidate": "child", "score": best_score, "kept": True, "pruned": False}
    return [
        {
            "event": "search",
            "format": FORMAT,
            "command": "ggcnn-net2net search start.hdf5 grasps.h5",
            "network": "/home/someone/start.hdf5",
            "root": "root",
            "settings": SearchSettings(width=1, depth=1).as_dict(),
            "data": {"path": "/home/someone/grasps.h5", "train": "aa", "test": "bb"},
            "versions": {"keras": "3.15.1"},
        },
        scored("root", None, "root", 0.5, SHALLOW),
        scored("child", "root", "deeper(1)", best_score, GROWN),
        {"event": "lookahead", "number": 0, "root": "root", "levels": [[place]], "leaf": "child", "path": ["child"]},
        {"event": "committed", "number": 0, "candidate": "child", "score": best_score},
        {"event": "finished", "path": ["root", "child"], "best": "child"},
    ]


@pytest.fixture
def write(tmp_path):
    def write(events):
        (tmp_path / "journal.jsonl").write_text("".join(json.dumps(event) + "\n" for event in events))
        return tmp_path

    return write


def test_the_search_is_told_without_places_of_the_machine(write):
    found = zoo.searched(write(journal()), GROWN)
    assert "/home" not in json.dumps(found)
    assert (found["network"], found["data"]) == ("start.hdf5", {"path": "grasps.h5", "train": "aa", "test": "bb"})
    assert (found["candidates"], found["seconds"]) == (1, 5)
    assert found["settings"]["beam"]["depth"] == 1
    assert found["path"] == [
        {"operation": "root", "parameters": 1000, "score": 0.5},
        {"operation": "deeper(1)", "parameters": 1000, "score": 0.6},
    ]


def test_the_best_may_be_the_start(write):
    assert zoo.searched(write(journal(0.4)), SHALLOW)["path"][1]["score"] == 0.4
    with pytest.raises(ResultsError, match=SHALLOW):
        zoo.searched(write(journal(0.4)), GROWN)


def test_another_search_and_an_unfinished_one_are_refused(write):
    with pytest.raises(ResultsError, match=f"{SHALLOW}, received .*{GROWN}"):
        zoo.searched(write(journal()), SHALLOW)
    with pytest.raises(ResultsError, match="search resume"):
        zoo.searched(write(journal()[:-1]), GROWN)


def test_a_folder_without_a_search_is_refused(tmp_path):
    with pytest.raises(SearchError, match="expected the folder of a search"):
        zoo.searched(tmp_path, SHALLOW)


def test_the_command_puts_it_on_record(trained, write, empty_zoo):
    arguments = ["add", str(trained), "mine", "--search", str(write(journal(0.4)))]
    result = CliRunner().invoke(zoo_command, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert zoo.provenance("mine")["search"]["command"] == "ggcnn-net2net search start.hdf5 grasps.h5"
