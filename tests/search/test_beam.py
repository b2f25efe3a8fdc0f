"""Toy trees with known answers. A node is the tuple of the turns that lead to it; the root is ()."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise, product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ggcnn_net2net.errors import SearchError
from ggcnn_net2net.search.beam import BeamSearch, SearchResult, search

Node = tuple[int, ...]


class Toy:
    """A tree that is given by the scores of its nodes. It counts how often each is asked for."""

    def __init__(self, scores: dict[Node, float]) -> None:
        self.known = scores
        self.asked: list[Node] = []
        self.committed: list[Node] = []

    def children(self, node: Node) -> Sequence[Node]:
        return sorted(child for child in self.known if child[:-1] == node and child != node)

    def scores(self, nodes: Sequence[Node]) -> Sequence[float]:
        self.asked += nodes
        return [self.known[node] for node in nodes]

    def commit(self, node: Node) -> Node:
        self.committed.append(node)
        return node


def nodes_of(result: SearchResult) -> list[Node]:
    return [node for node, _ in result.path]


#            ()=3
#       (0)=2       (1)=4
#   5   3   7     2   9   5
SMALL = {
    (): 3, (0,): 2, (1,): 4,
    (0, 0): 5, (0, 1): 3, (0, 2): 7, (1, 0): 2, (1, 1): 9, (1, 2): 5,
}  # fmt: skip


def test_two_levels_by_hand():
    result = search(Toy(SMALL), (), BeamSearch(width=2, depth=2))
    assert result.path == (((), 3), ((1,), 4), ((1, 1), 9))
    first, second = result.lookaheads
    assert [entry.node for entry in first.levels[0]] == [(1,), (0,)]
    assert [entry.node for entry in first.levels[1]] == [(1, 1), (0, 2), (1, 2), (0, 0), (0, 1), (1, 0)]
    assert [entry.kept for entry in first.levels[1]] == [True, True, False, False, False, False]
    assert [entry.node for entry in first.path] == [(1,), (1, 1)]
    assert [entry.node for entry in second.levels[0]] == [(1, 1), (1, 2), (1, 0)]


def test_a_narrow_beam_loses_what_a_wide_one_finds():
    scores = SMALL | {(0, 2): 12}
    assert nodes_of(search(Toy(scores), (), BeamSearch(width=1, depth=2))) == [(), (1,), (1, 1)]
    assert nodes_of(search(Toy(scores), (), BeamSearch(width=2, depth=2))) == [(), (0,), (0, 2)]


def test_lookahead_commits_to_the_ancestor_of_the_best_leaf_not_to_the_best_child():
    scores = SMALL | {(0, 2): 12}
    toy = Toy(scores)
    search(toy, (), BeamSearch(width=3, depth=2))
    assert toy.committed == [(0,), (0, 2)]


def test_last_lookahead_as_published_takes_the_last_of_the_beam():
    scores = {(): 1, (0,): 5, (1,): 9, (2,): 7}
    assert nodes_of(search(Toy(scores), (), BeamSearch(depth=1))) == [(), (1,)]
    published = BeamSearch(depth=1, last_entry=True)
    assert nodes_of(search(Toy(scores), (), published)) == [(), (0,)]
    # Only the nodes kept count, and only in the last lookahead.
    assert nodes_of(search(Toy(scores), (), BeamSearch(width=2, depth=1, last_entry=True))) == [(), (2,)]
    assert nodes_of(search(Toy(SMALL), (), BeamSearch(width=2, depth=2, last_entry=True))) == [(), (1,), (1, 2)]


def test_without_lookahead_the_path_leads_to_the_best_leaf():
    toy = Toy(SMALL)
    result = search(toy, (), BeamSearch(width=2, depth=2, lookahead=False, last_entry=True))
    assert result.path == (((), 3), ((1,), 4), ((1, 1), 9))
    assert len(result.lookaheads) == 1
    assert toy.committed == []
    assert len(toy.asked) == len(set(toy.asked))


def test_minimising():
    result = search(Toy(SMALL), (), BeamSearch(width=3, depth=2, maximise=False))
    assert nodes_of(result) == [(), (1,), (1, 0)]
    negative = {node: -score for node, score in SMALL.items()}
    assert nodes_of(search(Toy(negative), (), BeamSearch(width=3, depth=2))) == nodes_of(result)


def test_of_equal_scores_the_first_born_wins():
    scores = {(): 0} | {(turn,): 1 for turn in range(5)} | {(turn, 0): 2 for turn in range(5)}
    result = search(Toy(scores), (), BeamSearch(width=2, depth=2))
    assert [entry.node for entry in result.lookaheads[0].levels[0] if entry.kept] == [(0,), (1,)]
    assert nodes_of(result) == [(), (0,), (0, 0)]


def test_fewer_children_than_the_beam_and_an_early_end():
    scores = {(): 0, (0,): 1, (1,): 2, (0, 0): 5}
    result = search(Toy(scores), (), BeamSearch(width=3, depth=5))
    assert nodes_of(result) == [(), (0,), (0, 0)]
    assert nodes_of(search(Toy({(): 0}), (), BeamSearch())) == [()]


def test_failed_nodes_are_ranked_last_and_never_expanded():
    nan = math.nan
    scores = {(): 0, (0,): nan, (1,): 1, (0, 0): 100, (1, 0): 2, (1, 1): nan}
    toy = Toy(scores)
    result = search(toy, (), BeamSearch(width=3, depth=2))
    assert nodes_of(result) == [(), (1,), (1, 0)]
    assert (0, 0) not in toy.asked
    first = result.lookaheads[0].levels[0]
    assert [(entry.node, entry.kept) for entry in first] == [((1,), True), ((0,), False)]
    assert nodes_of(search(Toy({(): 0, (0,): nan, (1,): nan}), (), BeamSearch(last_entry=True))) == [()]


def test_what_a_commitment_returns_is_the_next_root():
    class Retrained(Toy):
        def commit(self, node: Node) -> Node:
            return (*node[:-1], node[-1] + 10)

    scores = {(): 0, (0,): 1, (1,): 2, (11,): 3, (11, 0): 7, (11, 10): 8, (1, 0): 4}
    toy = Retrained({**scores})
    toy.children = lambda node: {(): [(0,), (1,)], (1,): [(1, 0)], (11,): [(11, 0)]}.get(node, [])
    result = search(toy, (), BeamSearch(depth=2))
    assert result.path == (((), 0), ((11,), 3), ((11, 10), 8))


def test_patience():
    scores = {(0,) * depth: float(min(depth, 3)) for depth in range(10)}
    assert len(search(Toy(scores), (), BeamSearch(depth=9)).path) == 10
    assert nodes_of(search(Toy(scores), (), BeamSearch(depth=9, patience=2)))[-1] == (0,) * 5
    falling = {node: -score for node, score in scores.items()}
    lowest = BeamSearch(depth=9, patience=2, maximise=False)
    assert nodes_of(search(Toy(falling), (), lowest))[-1] == (0,) * 5


@pytest.mark.parametrize("wrong", [{"width": 0}, {"depth": 0}, {"patience": 0}])
def test_wrong_settings(wrong):
    with pytest.raises(SearchError, match="1 or more"):
        BeamSearch(**wrong)


@st.composite
def trees(draw, failing: bool = False) -> dict[Node, float]:
    """Up to three children a node, three levels below the root; few different scores, so that many are equal."""
    scores: dict[Node, float] = {(): 0.0}
    for depth, turns in product(range(1, 4), [range(3)]):
        for node in [node for node in scores if len(node) == depth - 1]:
            for turn in draw(st.lists(st.sampled_from(turns), unique=True, max_size=3)):
                failed = failing and draw(st.integers(0, 4)) == 0
                scores[*node, turn] = math.nan if failed else float(draw(st.integers(0, 4)))
    return scores


def deepest_best(scores: dict[Node, float], root: Node, levels: int) -> Node | None:
    """Of all nodes up to `levels` below the root, on the deepest level that has any: the best."""
    below = [node for node in scores if node[: len(root)] == root and len(root) < len(node) <= len(root) + levels]
    if not below:
        return None
    depth = max(map(len, below))
    leaves = [node for node in below if len(node) == depth]

    def place(node: Node) -> tuple:
        """Of equal scores, the child of the better parent comes first, and of one parent's the first."""
        return () if node == root else (-scores[node], place(node[:-1]), node[-1])

    return min(leaves, key=place)


@given(trees(), st.integers(1, 4))
def test_a_beam_that_keeps_everything_agrees_with_brute_force(scores, depth):
    result = search(Toy(scores), (), BeamSearch(width=100, depth=depth))
    expected: list[Node] = [()]
    for levels in range(depth, 0, -1):
        leaf = deepest_best(scores, expected[-1], levels)
        if leaf is None:
            break
        expected.append(leaf[: len(expected[-1]) + 1])
    assert [scores[node] for node in nodes_of(result)] == [scores[node] for node in expected]
    assert nodes_of(result) == expected


def plain_search(scores: dict[Node, float], settings: BeamSearch) -> list[Node]:
    """The path of a search, as the paper tells it, without anything that is kept on the way."""
    sign = 1 if settings.maximise else -1
    path: list[Node] = [()]
    for levels in range(settings.depth, 0, -1):
        beam, reached = [path[-1]], []
        for _ in range(levels):
            born = [child for parent in beam for child in Toy(scores).children(parent)]
            beam = sorted(
                (child for child in born if scores[child] == scores[child]), key=lambda child: -sign * scores[child]
            )[: settings.width]
            reached = beam or reached
        if not reached:
            break
        leaf = reached[-1] if settings.last_entry and settings.lookahead and levels == 1 else reached[0]
        if not settings.lookahead:
            return [leaf[:depth] for depth in range(len(leaf) + 1)]
        path.append(leaf[: len(path)])
        gains = [sign * scores[node] for node in path]
        patience = settings.patience or len(gains)
        if len(gains) > patience and max(gains[-patience:]) <= max(gains[:-patience]):
            break
    return path


@given(
    trees(failing=True),
    st.builds(
        BeamSearch,
        width=st.integers(1, 3),
        depth=st.integers(1, 4),
        lookahead=st.booleans(),
        maximise=st.booleans(),
        last_entry=st.booleans(),
        patience=st.none() | st.integers(1, 3),
    ),
)
def test_any_search_agrees_with_a_plain_one(scores, settings):
    assert nodes_of(search(Toy(scores), (), settings)) == plain_search(scores, settings)


@given(trees(), st.integers(1, 3), st.integers(1, 4), st.booleans(), st.booleans())
def test_invariants(scores, width, depth, maximise, lookahead):
    toy = Toy(scores)
    settings = BeamSearch(width=width, depth=depth, maximise=maximise, lookahead=lookahead)
    result = search(toy, (), settings)
    nodes = nodes_of(result)
    assert len(nodes) <= depth + 1
    assert all(child[:-1] == parent for parent, child in pairwise(nodes))
    assert all(scores[node] == score for node, score in result.path)
    for found in result.lookaheads:
        for level in found.levels:
            ranked = [entry.score if maximise else -entry.score for entry in level]
            assert ranked == sorted(ranked, reverse=True)
            assert sum(entry.kept for entry in level) == min(width, len(level))
    again = search(Toy(scores), (), settings)
    assert again.path == result.path
