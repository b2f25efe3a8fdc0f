"""Searches from start to end, without training: what is trained when, what is reused, what a resumed search does."""

from __future__ import annotations

import json
import math
from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise

import pytest
from scripted_workers import OPERATIONS, ScriptedWorkers, score_of
from search_data import ARCHITECTURE, SIZE

from ggcnn_net2net.architecture import build_ggcnn
from ggcnn_net2net.errors import (
    DatasetError,
    ModelFileError,
    ObjectSetError,
    SearchError,
    SurgeryError,
    TrainingError,
)
from ggcnn_net2net.parallel import Crash
from ggcnn_net2net.protocol import CORRECTED, PAPER
from ggcnn_net2net.search import SearchSettings, load_history, resume_search, start_search
from ggcnn_net2net.search.candidates import child_of
from ggcnn_net2net.search.journal import Journal, read_events
from ggcnn_net2net.search.reuse import TrainedElsewhere
from ggcnn_net2net.search.tree import CandidateTree
from ggcnn_net2net.training import Recipe

SMALL = SearchSettings(width=2, depth=3, recipe=Recipe(epochs=2, protocol=CORRECTED))


@pytest.fixture(scope="module")
def model():
    return build_ggcnn(ARCHITECTURE, input_size=SIZE, seed=0)


@pytest.fixture
def run(model, dataset, tmp_path):
    """Start a search in a folder of its own; returns (history, workers, folder)."""
    folders = iter(tmp_path / str(number) for number in range(100))

    def start(settings=SMALL, score=score_of, **options):
        directory, workers = next(folders), ScriptedWorkers(score)
        return start_search(model, dataset, settings, directory, workers, **options), workers, directory

    return start


def operations_on(history):
    return [candidate.operation for candidate, _ in history.path]


def keys_on(history):
    return [(candidate.key, score) for candidate, score in history.path]


def test_a_candidate_is_trained_once_and_met_again(run):
    history, workers, _ = run()
    keys = [job.candidate.key for job in workers.jobs]
    assert len(keys) == len(set(keys))
    places = [place.candidate for found in history.lookaheads for place in found.places]
    assert history.reused == len(places) - len(set(places)) > 0
    assert history.trained == len(keys) - 1  # the root is scored only
    assert workers.jobs[0].epochs == 0
    assert {job.epochs for job in workers.jobs[1:]} == {2}
    assert len(history.path) == 4
    assert all(child.parent == parent.key for (parent, _), (child, _) in pairwise(history.path))


def test_seeds_differ_between_candidates_and_follow_from_the_run_seed(run):
    _, workers, _ = run()
    _, again, _ = run()
    _, other, _ = run(replace(SMALL, seed=1))
    assert [job.seed for job in workers.jobs] == [job.seed for job in again.jobs]
    assert len({job.seed for job in workers.jobs}) == len(workers.jobs)
    assert {job.seed for job in workers.jobs}.isdisjoint(job.seed for job in other.jobs)
    assert {job.candidate.key for job in workers.jobs[1:]}.isdisjoint(job.candidate.key for job in other.jobs[1:])


def test_the_best_network_of_the_path_is_kept(run):
    history, workers, directory = run()
    best = max(history.path, key=lambda place: place[1])[0]
    assert (directory / "best.hdf5").read_text() == repr(workers.lineage[best.key])
    assert history.finished


def test_a_loss_is_minimised(run):
    history, _, _ = run(replace(SMALL, heuristic="loss", width=100))
    others, _, _ = run(replace(SMALL, width=100), score=lambda *places: -score_of(*places))
    assert operations_on(history) == operations_on(others)


def test_the_protocol_chooses_in_the_last_lookahead(run):
    def score(operations, epochs, replicate):
        return {"deeper(1)": 5, "deeper(2)": 9, "wider(1)": 7, "wider(2)": 1}.get(
            operations[-1] if operations else "", 0
        )

    one = SearchSettings(depth=1)
    assert one.protocol == PAPER
    assert operations_on(run(one, score)[0]) == ["root", "deeper(1)"]
    corrected = replace(one, recipe=Recipe(epochs=2, protocol=CORRECTED))
    assert operations_on(run(corrected, score)[0]) == ["root", "deeper(2)"]


def test_the_limit_of_parameters(run):
    history, _, _ = run(replace(SMALL, max_parameters=1300))
    assert max(one.parameters for one in history.candidates.values()) == 1300
    with_everything, _, _ = run()
    assert max(one.parameters for one in with_everything.candidates.values()) > 1300


def test_what_is_committed_to_can_be_trained_further(run):
    history, workers, _ = run(replace(SMALL, retrain=8))
    assert operations_on(history)[1:] == ["retrain(8)"] * 3
    retrained = [job for job in workers.jobs if job.candidate.is_retrained]
    assert [job.epochs for job in retrained] == [8] * 3
    assert [candidate.depth for candidate, _ in history.path] == [0, 1, 2, 3]


def test_without_success_further_training_is_left_out(run):
    def score(operations, epochs, replicate):
        return math.nan if epochs == 8 else score_of(operations, epochs, replicate)

    failing, _, _ = run(replace(SMALL, retrain=8), score)
    without, _, _ = run()
    assert operations_on(failing) == operations_on(without)


def test_replicates_are_averaged(run):
    history, workers, _ = run(replace(SMALL, replicates=3))
    child = next(one for one in history.candidates.values() if one.depth == 1)
    wanted = [score_of((child.operation,), 2, number) for number in range(3)]
    assert child.score == pytest.approx(sum(wanted) / 3)
    jobs = [job for job in workers.jobs if job.candidate.key == child.key]
    assert sorted(job.replicate for job in jobs) == [0, 1, 2]
    assert len({job.seed for job in jobs}) == 3


def test_successive_halving(run):
    settings = replace(SMALL, depth=1, halving=True, recipe=replace(SMALL.recipe, epochs=8))
    history, workers, _ = run(settings)
    first = {operation: score_of((operation,), 2, 0) for operation in OPERATIONS}
    survivors = sorted(first, key=first.get)[-2:]
    jobs = [(job.candidate.operation, job.epochs) for job in workers.jobs]
    assert sorted(jobs[1:5]) == sorted((operation, 2) for operation in OPERATIONS)
    # As few as the beam keeps are not halved any more.
    assert sorted(jobs[5:]) == sorted((operation, 8) for operation in survivors)
    states = {one.operation: one.state for one in history.candidates.values()}
    assert {name for name, state in states.items() if state == "pruned"} == OPERATIONS.keys() - set(survivors)
    best = max(survivors, key=lambda operation: score_of((operation,), 8, 0))
    assert operations_on(history) == ["root", best]


def test_failures_are_recorded_and_ranked_last(run):
    def score(operations, epochs, replicate):
        return math.nan if operations and operations[-1] == "wider(1)" else score_of(operations, epochs, replicate)

    history, _, _ = run(score=score)
    assert history.failed
    assert len(history.path) == 4
    assert "wider(1)" not in operations_on(history)
    failed = next(one for one in history.candidates.values() if one.state == "failed")
    assert failed.error == "TrainingError: as the script says"


@pytest.mark.parametrize(
    ("crash", "told"),
    [(Crash(-9, 2), "died 2 times, the last time with exit code -9: "), (Crash(None, 8), "died 8 times: ")],
)
def test_a_dead_worker_is_a_failure(run, crash, told):
    def score(operations, epochs, replicate):
        return crash if operations == ("wider(1)",) else score_of(operations, epochs, replicate)

    history, _, _ = run(score=score)
    failed = next(one for one in history.candidates.values() if one.state == "failed")
    assert told in failed.error
    assert len(history.path) == 4


def test_a_dead_worker_leaves_its_checkpoint_and_others_none(model, dataset, tmp_path):
    """What it has trained serves the next try; an error would come again from it."""

    class Leaving(ScriptedWorkers):
        def outcome(self, job):
            job.checkpoint_dir.mkdir(parents=True)
            return super().outcome(job)

    scores = {("wider(1)",): Crash(-9, 2), ("wider(2)",): math.nan}
    workers = Leaving(lambda names, *_: scores.get(names, 0.5))
    start_search(model, dataset, replace(SMALL, depth=1), tmp_path / "search", workers)
    assert len(workers.jobs) > 3
    assert [job.candidate.operation for job in workers.jobs if job.checkpoint_dir.exists()] == ["wider(1)"]


def test_failures_in_a_row_stop_the_search_and_can_be_tried_again(run, model, dataset, tmp_path):
    def score(operations, epochs, replicate):
        return math.nan if len(operations) == 2 else score_of(operations, epochs, replicate)

    directory = tmp_path / "failing"
    with pytest.raises(SearchError, match=r"3 failed candidates in a row.*as the script says.*retry-failed"):
        start_search(model, dataset, replace(SMALL, max_failures=3), directory, ScriptedWorkers(score))
    assert len(load_history(directory).failed) == 3
    repaired = ScriptedWorkers()
    repaired.lineage = {one.key: one.operations for one in load_history(directory).candidates.values()}
    history = resume_search(directory, repaired, retry_failed=True)
    assert not history.failed
    assert keys_on(history) == keys_on(run()[0])


def test_one_candidate_is_one_failure_however_often_it_is_trained(run):
    def score(operations, epochs, replicate):
        return math.nan if operations == ("wider(1)",) else score_of(operations, epochs, replicate)

    history, _, _ = run(replace(SMALL, replicates=3, max_failures=2), score)
    assert history.finished
    assert [candidate.operation for candidate in history.failed] == ["wider(1)"]


def test_a_root_without_a_score_ends_the_search(run):
    with pytest.raises(SearchError, match=r"start from.*as the script says"):
        run(score=lambda *_: math.nan)


@pytest.mark.parametrize(
    "settings",
    [
        SMALL,
        replace(SMALL, lookahead=False),
        replace(SMALL, retrain=4),
        replace(SMALL, replicates=2),
        replace(SMALL, halving=True, recipe=replace(SMALL.recipe, epochs=4)),
    ],
)
def test_a_search_that_stops_anywhere_ends_as_without_the_stop(run, model, dataset, tmp_path, settings):
    """A stop after every number of trainings; what was trained before is not trained again."""
    whole, workers, directory = run(settings)
    events = read_events(directory / "journal.jsonl")
    for number in range(1, len(workers.jobs), 3):
        stopped = tmp_path / f"stopped{number}"
        before, after = ScriptedWorkers(stop_after=number), ScriptedWorkers()
        with pytest.raises(KeyboardInterrupt):
            start_search(model, dataset, settings, stopped, before)
        after.lineage = before.lineage
        assert keys_on(resume_search(stopped, after)) == keys_on(whole)
        # A result that was not yet handed over is lost, and nothing else.
        assert len(before.jobs) + len(after.jobs) == len(workers.jobs)
        assert comparable(read_events(stopped / "journal.jsonl")) == comparable(events)


def comparable(events):
    """Which candidate of a level is done first makes no difference."""
    return sorted(json.dumps({**event, "started": 0, "data": 0}, sort_keys=True) for event in events)


def test_a_finished_search_has_nothing_left_to_do(run):
    history, _, directory = run()
    journal = (directory / "journal.jsonl").read_bytes()
    idle = ScriptedWorkers()
    assert keys_on(resume_search(directory, idle)) == keys_on(history)
    assert idle.jobs == []
    assert (directory / "journal.jsonl").read_bytes() == journal


def test_a_torn_last_line_is_trained_again(run):
    history, workers, directory = run()
    journal = directory / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    last = max(index for index, line in enumerate(lines) if json.loads(line)["event"] == "scored")
    journal.write_bytes(b"".join(lines[:last]) + lines[last][:40])
    again = ScriptedWorkers()
    again.lineage = workers.lineage
    assert keys_on(resume_search(directory, again)) == keys_on(history)
    assert len(again.jobs) == 1


def test_events_are_told_in_order(run, tmp_path):
    told = []
    _, _, directory = run(on_event=told.append)
    written = [event for event in told if event["event"] != "level"]
    assert written == read_events(directory / "journal.jsonl")
    levels = [(event["lookahead"], event["level"], event["levels"]) for event in told if event["event"] == "level"]
    assert levels == [(0, 1, 3), (0, 2, 3), (0, 3, 3), (1, 1, 2), (1, 2, 2), (2, 1, 1)]
    first, *_, last = [event for event in told if event["event"] == "level"]
    assert (len(first["candidates"]), first["known"]) == (4, 0)
    assert (len(last["candidates"]), last["known"]) == (4, 4)


def test_a_folder_holds_one_search(run, model, dataset):
    _, _, directory = run()
    with pytest.raises(SearchError, match=r"holds a search.*search resume"):
        start_search(model, dataset, SMALL, directory, ScriptedWorkers())


def test_one_process_at_a_time(run):
    _, _, directory = run()
    with Journal(directory / "journal.jsonl"), pytest.raises(SearchError, match="another process"):
        resume_search(directory, ScriptedWorkers())


def test_only_searches_are_resumed(tmp_path):
    for function in (load_history, lambda directory: resume_search(directory, ScriptedWorkers())):
        with pytest.raises(SearchError, match=r"no journal\.jsonl"):
            function(tmp_path / "nothing")
    assert not (tmp_path / "nothing").exists()


def test_other_data_is_refused(model, dataset, tmp_path):
    from search_data import write_dataset

    copy = tmp_path / "copy.h5"
    copy.write_bytes(dataset.read_bytes())
    start_search(model, copy, SMALL, tmp_path / "search", ScriptedWorkers())
    write_dataset(copy, train=8)
    with pytest.raises(SearchError, match=r"expected the dataset.*put it back"):
        resume_search(tmp_path / "search", ScriptedWorkers())
    copy.unlink()
    with pytest.raises(DatasetError, match="dataset file"):
        resume_search(tmp_path / "search", ScriptedWorkers())


def test_nothing_is_left_of_a_search_that_cannot_start(model, dataset, tmp_path):
    with pytest.raises(DatasetError, match="dataset file"):
        start_search(model, tmp_path / "missing.h5", SMALL, tmp_path / "search", ScriptedWorkers())
    larger = build_ggcnn(ARCHITECTURE, input_size=2 * SIZE, seed=0)
    with pytest.raises(DatasetError, match=r"images of \(144, 144\) px.*received \(72, 72\)"):
        start_search(larger, dataset, SMALL, tmp_path / "search", ScriptedWorkers())
    with pytest.raises(ModelFileError, match=r"teacher\.hdf5"):
        teacher = replace(SMALL, recipe=replace(SMALL.recipe, protocol=PAPER), distil=str(tmp_path / "teacher.hdf5"))
        start_search(model, dataset, teacher, tmp_path / "search", ScriptedWorkers())
    with pytest.raises(ObjectSetError, match="received 'procedual40'"):
        judged = replace(SMALL, heuristic="sim", sim_objects="procedual40")
        start_search(model, dataset, judged, tmp_path / "search", ScriptedWorkers())
    journal = tmp_path / "search" / "journal.jsonl"
    assert read_events(journal) == []
    assert {path.name for path in journal.parent.iterdir()} <= {"journal.jsonl", "journal.lock"}


def test_the_folder_of_an_object_set_is_found_from_elsewhere(model, dataset, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    start_search(model, dataset, replace(SMALL, sim_objects="mine"), tmp_path / "search", ScriptedWorkers())
    assert load_history(tmp_path / "search").settings.sim_objects == str(tmp_path / "mine")


def test_what_cannot_be_searched_is_refused_before_anything(model, dataset, tmp_path):
    def start(**changes):
        start_search(model, dataset, replace(SMALL, **changes), tmp_path / "search", ScriptedWorkers())

    size = model.count_params()
    with pytest.raises(SearchError, match=rf"expected a limit of \d+ .*this one with {size}, received {size}"):
        start(max_parameters=size)
    with pytest.raises(TrainingError, match="'nonsense'"):
        start(recipe=Recipe(optimizer="nonsense"))
    with pytest.raises(TrainingError, match="one batch of 32 images"):
        start(recipe=Recipe(batch_size=32))
    with pytest.raises(SurgeryError, match="transposed layers are changed with `transpose` alone"):
        upsampling = build_ggcnn("T3x3x2s1", input_size=SIZE, seed=0)
        start_search(upsampling, dataset, SMALL, tmp_path / "search", ScriptedWorkers())
    assert read_events(tmp_path / "search" / "journal.jsonl") == []


def test_a_search_whose_first_children_all_fail_has_found_nothing(run):
    with pytest.raises(SearchError, match=r"all 4 failed, .*as the script says.*--retry-failed"):
        run(score=lambda operations, *_: math.nan if operations else 0.5)


def test_a_root_that_failed_is_tried_again(run, model, dataset, tmp_path):
    directory = tmp_path / "failing"
    with pytest.raises(SearchError, match="search resume"):
        start_search(model, dataset, SMALL, directory, ScriptedWorkers(lambda *_: math.nan))
    assert keys_on(resume_search(directory, ScriptedWorkers())) == keys_on(run()[0])


def test_a_finished_search_whose_failures_are_tried_again(run, tmp_path):
    def score(operations, epochs, replicate):
        return math.nan if operations == ("wider(1)",) else score_of(operations, epochs, replicate)

    before, workers, directory = run(score=score)
    assert before.failed
    whole, _, _ = run()
    for stop in (1, math.inf):  # interrupted at first
        again = ScriptedWorkers(stop_after=stop)
        again.lineage = workers.lineage
        with nullcontext() if stop == math.inf else pytest.raises(KeyboardInterrupt):
            resume_search(directory, again, retry_failed=True)
        history = load_history(directory)
        assert history.finished == (stop == math.inf)
    assert not history.failed
    assert keys_on(history) == keys_on(whole)
    assert history.lookaheads == whole.lookaheads


def test_an_interrupted_second_try_goes_on_with_a_plain_resume(run):
    def score(operations, epochs, replicate):
        return math.nan if operations in (("wider(1)",), ("wider(2)",)) else score_of(operations, epochs, replicate)

    before, workers, directory = run(score=score)
    assert len(before.failed) == 2
    whole, _, _ = run()
    for stop, options in ((1, {"retry_failed": True}), (math.inf, {})):
        again = ScriptedWorkers(stop_after=stop)
        again.lineage = workers.lineage
        with nullcontext() if stop == math.inf else pytest.raises(KeyboardInterrupt):
            resume_search(directory, again, **options)
    history = load_history(directory)
    assert not history.failed
    assert keys_on(history) == keys_on(whole)
    assert history.lookaheads == whole.lookaheads


def test_other_versions_are_put_down(run, monkeypatch):
    history, _, directory = run()
    monkeypatch.setattr("ggcnn_net2net.search.run.versions", lambda: {"keras": "99"})
    for _ in range(2):  # once each change
        assert keys_on(resume_search(directory, ScriptedWorkers())) == keys_on(history)
        assert load_history(directory).later_versions == ({"keras": "99"},)
    assert load_history(directory).finished


def test_halving_does_not_train_anew_what_a_smaller_level_has_trained_to_the_end(model, dataset, tmp_path):
    """A level of two is not halved; they are met again among four."""
    settings = replace(SMALL, halving=True, recipe=replace(SMALL.recipe, epochs=8))
    workers = ScriptedWorkers()
    start_search(model, dataset, replace(settings, depth=1), tmp_path, workers)
    events = read_events(tmp_path / "journal.jsonl")
    with Journal(tmp_path / "journal.jsonl") as journal:
        tree = CandidateTree(tmp_path, events, workers, journal, lambda _: None, TrainedElsewhere(events[0], ()))
        parent = child_of(tree.root, "deeper(1)", settings, events[0]["data"]["train"])
        tree.scores([parent])
        children = tree.children(parent)
        few = tree.scores(children[:2])
        n_jobs = len(workers.jobs)
        many = tree.scores(children)
    assert many[:2] == few
    assert {(job.candidate.operation, job.epochs) for job in workers.jobs[n_jobs:]} == {
        (child.operation, epochs) for child in children[2:] for epochs in (2, 4, 8)
    }
