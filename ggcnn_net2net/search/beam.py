"""Beam search with and without lookahead (sections II and III-A of the paper), over any tree. No Keras.

A lookahead of n levels is a plain beam search of that depth: of all children of the nodes kept on a level, the `width`
best are kept on the next one. Its best leaf then says which child of the root to commit to, and the next lookahead
starts from that child with one level less.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from ggcnn_net2net.errors import SearchError

Node = TypeVar("Node")


class Tree(Protocol[Node]):
    """What is searched."""

    def children(self, node: Node) -> Sequence[Node]:
        """Children of a node, in a fixed order; may be none."""
        ...

    def scores(self, nodes: Sequence[Node]) -> Sequence[float]:
        """Scores of nodes, all children of one level at once; NaN for one that failed, which is ranked last."""
        ...

    def commit(self, node: Node) -> Node:
        """Called with the child that a lookahead chose; what it returns (say, trained further) is the next root."""
        ...


@dataclass(frozen=True)
class BeamSearch:
    """Settings of a search. The defaults are the paper's, but for its defect in the last lookahead."""

    width: int = 3
    """Nodes kept on a level."""
    depth: int = 5
    """Levels below the root."""
    lookahead: bool = True
    """Whether only one level is committed to at a time."""
    maximise: bool = True
    """Whether the highest score is the best, or the lowest."""
    last_entry: bool = False
    """Whether the last lookahead, of one level, chooses the last of the nodes kept instead of the best, as the public
    code of the paper does: of children that score 5, 9 and 7 it takes the 5."""
    patience: int | None = None
    """Commitments in a row without a better score than all before, after which the search stops; None: never."""

    def __post_init__(self) -> None:
        if self.width < 1 or self.depth < 1 or (self.patience is not None and self.patience < 1):
            raise SearchError(
                "expected a beam width, depth and patience of 1 or more, received "
                f"{self.width}, {self.depth} and {self.patience}"
            )

    def rank(self, score: float) -> tuple[bool, float]:
        """Sorts scores best first, NaN last.

        Args:
            score: of a node.

        Returns:
            A key for `sorted` and `min`.
        """
        return math.isnan(score), -score if self.maximise else score


@dataclass(frozen=True, eq=False)
class Entry(Generic[Node]):
    """A node that was scored, in its place in a lookahead."""

    node: Node
    score: float
    parent: Entry[Node] | None
    """None for the root of the lookahead."""
    kept: bool = True
    """Whether it is among the nodes that are expanded."""


@dataclass(frozen=True)
class Lookahead(Generic[Node]):
    """One beam search from a committed node."""

    root: Entry[Node]
    levels: tuple[tuple[Entry[Node], ...], ...]
    """All nodes scored on each level, best first."""
    leaf: Entry[Node]
    """The node that decides."""
    path: tuple[Entry[Node], ...]
    """From the child of the root down to the leaf."""


@dataclass(frozen=True)
class SearchResult(Generic[Node]):
    """What a search found."""

    path: tuple[tuple[Node, float], ...]
    """The nodes committed to, root first, with their scores after the commitment."""
    lookaheads: tuple[Lookahead[Node], ...]
    """One for each commitment with lookahead, a single one without."""


def search(
    tree: Tree[Node],
    root: Node,
    settings: BeamSearch,
    on_lookahead: Callable[[Lookahead[Node]], None] = lambda _: None,
) -> SearchResult[Node]:
    """Search a tree.

    Args:
        tree: gives children and scores.
        root: where to start.
        settings: width, depth, lookahead.
        on_lookahead: called after each lookahead, before its commitment.

    Returns:
        The path. It ends early where there are no children that could be scored, or out of patience.
    """
    start: Entry[Node] = Entry(root, tree.scores([root])[0], None)
    path, lookaheads = [(start.node, start.score)], []
    for levels in range(settings.depth, 0, -1):
        last_entry = settings.last_entry and settings.lookahead and levels == 1
        found = look_ahead(tree, start, levels, settings, last_entry)
        if found is None:
            break
        lookaheads.append(found)
        on_lookahead(found)
        if not settings.lookahead:
            path += [(entry.node, entry.score) for entry in found.path]
            break
        chosen = found.path[0]
        node = tree.commit(chosen.node)
        score = chosen.score if node == chosen.node else tree.scores([node])[0]
        start = Entry(node, score, None)
        path.append((node, score))
        if settings.patience is not None and _stagnant([score for _, score in path], settings):
            break
    return SearchResult(tuple(path), tuple(lookaheads))


def look_ahead(
    tree: Tree[Node], root: Entry[Node], depth: int, settings: BeamSearch, last_entry: bool = False
) -> Lookahead[Node] | None:
    """A beam search of at most `depth` levels below `root`; None if the root has no child that can be scored."""
    levels: list[tuple[Entry[Node], ...]] = []
    beam: list[Entry[Node]] = [root]
    for _ in range(depth):
        born = [(child, parent) for parent in beam for child in tree.children(parent.node)]
        level = _ranked(born, tree.scores([child for child, _ in born]), settings) if born else ()
        kept = [entry for entry in level if entry.kept]
        if not kept:
            break
        levels.append(level)
        beam = kept
    if not levels:
        return None
    leaf = beam[-1] if last_entry else beam[0]
    return Lookahead(root, tuple(levels), leaf, _path_to(leaf))


def _ranked(
    born: Sequence[tuple[Node, Entry[Node]]], scores: Sequence[float], settings: BeamSearch
) -> tuple[Entry[Node], ...]:
    """Entries of the children, best first; ties go to the child of the better parent, then to the earlier child."""
    order = sorted(range(len(born)), key=lambda index: settings.rank(scores[index]))
    return tuple(
        Entry(
            node=born[index][0],
            score=scores[index],
            parent=born[index][1],
            kept=rank < settings.width and not math.isnan(scores[index]),
        )
        for rank, index in enumerate(order)
    )


def _path_to(leaf: Entry[Node]) -> tuple[Entry[Node], ...]:
    path = [leaf]
    while path[0].parent is not None and path[0].parent.parent is not None:
        path.insert(0, path[0].parent)
    return tuple(path)


def _stagnant(scores: Sequence[float], settings: BeamSearch) -> bool:
    """Whether the last `patience` scores bring nothing above all before them."""
    assert settings.patience is not None
    if len(scores) <= settings.patience:
        return False
    sign = 1 if settings.maximise else -1
    before, recent = scores[: -settings.patience], scores[-settings.patience :]
    return max(sign * score for score in recent) <= max(sign * score for score in before)
