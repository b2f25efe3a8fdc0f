"""How many trainings a beam search with lookahead asks for, and how many it is spared by using results again.

    python benchmarks/search_reuse.py
    python benchmarks/search_reuse.py --transpose

A lookahead starts one level below the one before, in the part of the tree that was searched already. Every place of a
network on a level of a lookahead is a training in the public code of the paper; where results are used again, a network
is trained once. Nothing is trained here: scores are random, either that of the parent plus noise or independent of it,
and the search is the package's own. The operations are the paper's, *deeper* and *wider* of each layer; *deeper* adds
one. Scores are in standard deviations of the noise; that of the root is 0.

The last lookahead chooses the last entry of the beam, as published, or the best: after all trainings, so that their
number is the same either way. The score of the network that the search ends with is not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import count

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from ggcnn_net2net.search.beam import BeamSearch, SearchResult, search

LAYERS = {False: 3, True: 6}
"""Layers of the original network that are searched: without and with transposed convolutions."""

Node = tuple[int, ...]
"""The operations that lead to a network: i for deeper(i), -i for wider(i)."""
Scores = Callable[[float, float], float]
"""(score of the parent, noise) -> score."""

SCORES: dict[str, Scores] = {
    "parent's + noise": lambda parent, noise: parent + noise,
    "independent": lambda _, noise: noise,
}


class RandomTree:
    """Networks with random scores. Implements `Tree`."""

    def __init__(self, seed: int, layers: int, score: Scores) -> None:
        self._seed, self._layers, self._score = seed, layers, score
        self._known: dict[Node, float] = {(): 0.0}

    def children(self, node: Node) -> Sequence[Node]:
        """All operations on all layers."""
        layers = range(1, self._layers + sum(operation > 0 for operation in node) + 1)
        return [(*node, sign * layer) for sign in (1, -1) for layer in layers]

    def scores(self, nodes: Sequence[Node]) -> Sequence[float]:
        """Scores, functions of the seed and the node alone."""
        return [self._score_of(node) for node in nodes]

    def commit(self, node: Node) -> Node:
        """The node itself: nothing is trained further."""
        return node

    def _score_of(self, node: Node) -> float:
        if node not in self._known:
            # No zeros: they would add nothing to the seed.
            numbers = [2 * abs(operation) + (operation > 0) for operation in node]
            noise = float(np.random.default_rng([self._seed, *numbers]).normal())
            self._known[node] = self._score(self._score_of(node[:-1]), noise)
        return self._known[node]


def counts_of(result: SearchResult[Node]) -> tuple[list[int], list[int]]:
    """Trainings that each lookahead asks for, and those among them that were not done before."""
    asked: list[int] = []
    new: list[int] = []
    done: set[Node] = set()
    for lookahead in result.lookaheads:
        nodes = [entry.node for level in lookahead.levels for entry in level]
        asked.append(len(nodes))
        new.append(len(set(nodes) - done))
        done.update(nodes)
    return asked, new


def figures(results: Sequence[SearchResult[Node]]) -> dict[str, str]:
    """What the searches took, by name: means, and ranges in brackets."""
    asked, done = np.moveaxis(np.array([counts_of(result) for result in results]), 1, 0)
    totals, done_totals = asked.sum(axis=1), done.sum(axis=1)
    return {
        "trainings asked for": with_range(totals, ".0f"),
        "trainings done": with_range(done_totals, ".0f"),
        "spared": with_range(1 - done_totals / totals, ".0%"),
        **{
            f"lookahead {number}: asked for, done": f"{asked_mean:.1f}, {done_mean:.1f}"
            for number, asked_mean, done_mean in zip(count(1), asked.mean(axis=0), done.mean(axis=0), strict=False)
        },
    }


def with_range(values: np.ndarray, form: str) -> str:
    """Mean, and the least and the greatest in brackets."""
    return f"{values.mean():{form}} ({values.min():{form}} to {values.max():{form}})"


@click.command()
@click.option("--beam", default=3, show_default=True, type=click.IntRange(min=1), help="Width of the beam.")
@click.option("--depth", default=5, show_default=True, type=click.IntRange(min=1))
@click.option("--transpose", is_flag=True, help="Search the transposed convolutions, too.")
@click.option("--trees", default=1000, show_default=True, type=click.IntRange(min=1))
@click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0))
def main(beam: int, depth: int, transpose: bool, trees: int, seed: int) -> None:
    """Search random trees and print what it takes: means, with the range in brackets."""
    layers = LAYERS[transpose]
    table = Table("", title=f"beam {beam}, depth {depth}, {layers} layers at the root, {trees} trees, seed {seed}")
    columns = []
    for name, score in SCORES.items():
        results = {
            last_entry: [
                search(RandomTree(seed + number, layers, score), (), BeamSearch(beam, depth, last_entry=last_entry))
                for number in range(trees)
            ]
            for last_entry in (True, False)
        }
        ends = {
            f"score at the end, {choice} of the last beam": with_range(
                np.array([result.path[-1][1] for result in results[last_entry]]), ".2f"
            )
            for choice, last_entry in (("last", True), ("best", False))
        }
        columns.append(figures(results[False]) | ends)
        table.add_column(name)
    for row in columns[0]:
        table.add_row(row, *(column[row] for column in columns))
    Console().print(table)


if __name__ == "__main__":
    main()
