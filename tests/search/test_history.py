"""Journals by hand with known answers, and consistency with the beam search."""

from __future__ import annotations

import math
import subprocess
import sys

import pytest
from journals import MadeUpNetworks, by_hand, failed, key_of, lookahead, place, scored, start

from ggcnn_net2net.errors import SearchError
from ggcnn_net2net.search.history import read_history
from ggcnn_net2net.search.settings import SearchSettings


def keys(candidates):
    return [candidate.key for candidate in candidates]


def test_every_number_of_a_search_by_hand():
    history = read_history(by_hand())
    assert list(history.candidates) == ["root", "a", "b", "ad", "aw", "bd", "bw"]
    assert [(candidate.key, score) for candidate, score in history.path] == [("root", 0.5), ("b", 0.6), ("bd", 0.8)]
    assert history.finished
    assert history.trained == 5
    assert keys(history.failed) == ["aw"]
    assert history.reused == 2
    assert history.avoided == 2 / 7
    assert history.seconds == 1 + 5 * 10 + 5
    assert history.best == history.best_of_all == history.candidates["bd"]
    assert keys(history.front) == ["root", "a", "bd"]  # b and ad are larger than a, and worse
    assert history.kept == {"a": [0], "b": [0], "bd": [0, 1], "ad": [0], "bw": [1]}
    assert history.score_name == "IoU rate"
    assert (history.network, history.settings.width) == ("published", 2)


def test_every_field_of_a_candidate():
    candidates = read_history(by_hand()).candidates
    root, best, lost = candidates["root"], candidates["bd"], candidates["aw"]
    assert (root.state, root.depth, root.sequence, root.operations, root.parent) == ("root", 0, "root", (), None)
    assert math.isnan(root.loss)
    assert (best.state, best.depth, best.sequence) == ("trained", 2, "wider(1), deeper(1)")
    assert (best.parent, best.operation, best.parameters, best.epochs) == ("b", "deeper(1)", 1250, 2)
    assert (best.score, best.replicate_scores, best.loss, best.seconds) == (0.8, (0.8,), 0.01, 10)
    assert (best.architecture, best.children, best.error) == ("C9x9x8_T9x9x8", 2, "")
    assert lost.state == "failed"
    assert math.isnan(lost.score)
    assert (lost.error, lost.traceback) == ("the loss is not finite", "Traceback: ...")
    assert lost.parameters == 1200  # its parent knew
    assert lost.architecture == ""


@pytest.mark.parametrize("length", range(1, len(by_hand()) + 1))
def test_a_search_can_end_anywhere(length):
    history = read_history(by_hand()[:length])
    assert history.finished == (length == len(by_hand()))
    assert len(history.path) == [0, 1, 2, 3][(length > 1) + (length > 9) + (length > 11)]
    assert (history.best is None) == (length == 1)
    assert history.reused == (2 if length > 10 else 0)


def test_lowest_score_is_best_when_the_loss_decides():
    events = by_hand()
    events[0] = start(SearchSettings(width=2, depth=2, heuristic="loss"))
    history = read_history(events)
    assert history.best.key == "root"
    assert history.best_of_all.key == "bw"
    assert keys(history.front) == ["root", "bw"]
    assert history.score_text(0.0123456) == "0.01235"


def test_a_score_is_the_mean_over_replicates_at_the_most_epochs():
    events = [start(SearchSettings(replicates=2, halving=True)), scored("root", None, "root", 0.5, epochs=0)]
    events += [
        scored("a", "root", "deeper(1)", score, epochs=1, replicate=seed) for seed, score in ((0, 0.1), (1, 0.2))
    ]
    assert read_history(events).candidates["a"].score == pytest.approx(0.15)
    events += [
        scored("a", "root", "deeper(1)", score, replicate=seed, loss=loss)
        for seed, score, loss in ((1, 0.8, 0.3), (0, 0.6, 0.1))
    ]
    candidate = read_history(events).candidates["a"]
    assert candidate.replicate_scores == (0.6, 0.8)
    assert candidate.score == pytest.approx(0.7)
    assert candidate.loss == pytest.approx(0.2)
    assert candidate.seconds == 40
    assert candidate.epochs == 2


def test_one_replicate_that_fails_fails_the_candidate_until_it_is_tried_again():
    events = [start(SearchSettings(replicates=2)), scored("root", None, "root", 0.5)]
    events += [scored("a", "root", "deeper(1)", 0.6), failed("a", "root", "deeper(1)", replicate=1)]
    candidate = read_history(events).candidates["a"]
    assert (candidate.state, candidate.error) == ("failed", "the loss is not finite")
    events.append(scored("a", "root", "deeper(1)", 0.8, replicate=1))
    candidate = read_history(events).candidates["a"]
    assert (candidate.state, candidate.error, candidate.traceback) == ("trained", "", "")
    assert candidate.score == pytest.approx(0.7)


def test_a_score_that_is_not_a_number_is_a_failure():
    events = [start(SearchSettings()), scored("root", None, "root", 0.5), scored("a", "root", "deeper(1)", None)]
    assert read_history(events).candidates["a"].error == "the score is not a number"


def test_pruned_candidates_are_trained_but_not_compared():
    events = [start(SearchSettings(width=1, depth=2, halving=True)), scored("root", None, "root", 0.5, epochs=0)]
    events += [scored("a", "root", "deeper(1)", 0.9, epochs=1), scored("b", "root", "wider(1)", 0.95, epochs=1)]
    events += [scored("b", "root", "wider(1)", 0.7)]
    events.append(lookahead(0, "root", [[place("b", 0.7, kept=True), place("a", 0.9, pruned=True)]], ["b"]))
    history = read_history(events)
    assert history.candidates["a"].state == "pruned"
    assert history.trained == 2
    assert history.best_of_all.key == "b"
    assert keys(history.front) == ["b"]  # of the same size as the root
    # A later lookahead trains it to the end.
    events.append({"event": "committed", "number": 0, "candidate": "b", "score": 0.7})
    events.append(scored("a", "root", "deeper(1)", 0.75))
    events.append(lookahead(1, "b", [[place("a", 0.75, kept=True)]], ["a"]))
    assert read_history(events).candidates["a"].state == "trained"


def test_what_was_retrained_is_on_the_path_at_the_same_depth():
    history = read_history(MadeUpNetworks(SearchSettings(depth=2, retrain=8)).run())
    assert [candidate.depth for candidate, _ in history.path] == [0, 1, 2]
    assert [candidate.operation for candidate, _ in history.path[1:]] == ["retrain(8)"] * 2
    assert len(history.path[-1][0].operations) == 4
    assert history.reused == 0


def test_a_lookahead_that_is_told_twice_counts_once_and_leads_where_the_last_says():
    events = by_hand()[:-1]
    events.append(scored("aw", "a", "wider(1)", 0.9))
    deepest = [place("aw", 0.9, True), place("bd", 0.8, True), place("ad", 0.55), place("bw", 0.3)]
    events.append(lookahead(0, "root", [[place("a", 0.7, True), place("b", 0.6, True)], deepest], ["a", "aw"]))
    events.append({"event": "committed", "number": 0, "candidate": "a", "score": 0.7})
    history = read_history(events)
    assert keys(candidate for candidate, _ in history.path) == ["root", "a"]
    assert [found.number for found in history.lookaheads] == [0]
    assert history.failed == []


@pytest.mark.parametrize("lookahead", [True, False])
@pytest.mark.parametrize("failing", [0.0, 0.1])
def test_agrees_with_the_beam_search(lookahead, failing):
    networks = MadeUpNetworks(SearchSettings(depth=4, lookahead=lookahead), failing)
    history = read_history(networks.run())
    places = [entry.node for found in networks.lookaheads for level in found.levels for entry in level]
    lost = [node for node in places if math.isnan(networks.known[node])]
    assert len(history.candidates) == len(set(places)) + 1
    assert len(history.failed) == len(set(lost))
    assert history.reused == len(places) - len(set(places)) - (len(lost) - len(set(lost)))
    assert history.trained == len(set(places)) - len(set(lost))
    assert (history.reused > 0) == lookahead
    assert len(history.path) == 5
    for candidate, score in history.path:
        assert score == networks.known[candidate.operations]
        assert candidate.key == key_of(candidate.operations)
    best = max(score for score in networks.known.values() if not math.isnan(score))
    assert history.best_of_all.score == best
    for item in history.front:
        rivals = [other for other in history.candidates.values() if other.parameters <= item.parameters]
        assert all(not other.score > item.score for other in rivals)


@pytest.mark.parametrize(
    "events",
    [
        [],
        by_hand()[1:],
        [{**by_hand()[0], "format": "another"}],
        [{**by_hand()[0], "settings": {"beam": {}}}],
        [by_hand()[0], by_hand()[2]],
        [*by_hand()[:2], {"event": "scored", "candidate": "a"}],
        [*by_hand()[:2], lookahead(0, "root", [[place("nobody", 0.5, True)]], ["nobody"])],
        [*by_hand()[:9], {"event": "committed", "number": 0}],
        [*by_hand()[:9], {"event": "committed", "number": 0, "candidate": "nobody", "score": 1}],
        [*by_hand()[:2], {**by_hand()[2], "score": "high"}],
    ],
    ids=["empty", "no start", "format", "settings", "no parent", "fields", "place", "committed", "nobody", "text"],
)
def test_bad_journals(events):
    with pytest.raises(SearchError, match="expected"):
        read_history(events)


def test_unknown_kinds_of_events_are_passed_over():
    assert read_history([*by_hand(), {"event": "coffee"}]).trained == 5


def test_nothing_heavy_is_imported():
    code = "import sys, ggcnn_net2net.search.history, ggcnn_net2net.search.live\n"
    code += "print([name for name in ('keras', 'tensorflow', 'matplotlib') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_decisions_from_before_a_retry_do_not_count():
    """It stops after the new lookahead, before the commitment: the old one does not belong to it."""
    events = by_hand()
    resumed = {"event": "resumed", "retry_failed": True, "versions": events[0]["versions"]}
    again = scored("aw", "a", "wider(1)", 0.9)
    other = lookahead(
        0, "root", [[place("a", 0.7, True), place("b", 0.6, True)], [place("aw", 0.9, True)]], ["a", "aw"]
    )
    history = read_history([*events, resumed, again, other])
    assert not history.finished
    assert [one.key for one, _ in history.path] == ["root"]
    assert [found.path for found in history.lookaheads] == [("a", "aw")]
    assert not history.failed
    assert read_history([*events, resumed]).lookaheads == ()
