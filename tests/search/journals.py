"""Journals of searches that never happened: one by hand with known answers, and beam searches over made-up networks."""

from __future__ import annotations

import hashlib
import math
import random
from collections.abc import Sequence
from typing import Any

from ggcnn_net2net.search.beam import Lookahead, search
from ggcnn_net2net.search.journal import FORMAT
from ggcnn_net2net.search.settings import SearchSettings

Event = dict[str, Any]


def start(settings: SearchSettings) -> Event:
    """The first event of a search."""
    return {
        "event": "search",
        "format": FORMAT,
        "command": "ggcnn-net2net search published data.h5",
        "network": "published",
        "root": "root",
        "settings": settings.as_dict(),
        "data": {"path": "data.h5", "train": "aa", "test": "bb"},
        "versions": {"keras": "3.15.1"},
    }


def scored(key: str, parent: str | None, operation: str, score: float | None, **values: Any) -> Event:
    """A training that gave a score."""
    usual = {"epochs": 2, "replicate": 0, "loss": 0.01, "parameters": 1000, "architecture": "C9x9x8_T9x9x8"}
    usual |= {"operations": {"deeper(1)": 1100, "wider(1)": 1200}, "seconds": 10.0, "started": 0.0, "worker": "here:1"}
    about = {"event": "scored", "candidate": key, "parent": parent, "operation": operation, "score": score}
    return about | usual | values


def failed(key: str, parent: str, operation: str, **values: Any) -> Event:
    """A training that failed."""
    about = {"event": "failed", "candidate": key, "parent": parent, "operation": operation, "epochs": 2, "replicate": 0}
    return about | {"error": "the loss is not finite", "traceback": "Traceback: ...", "seconds": 5.0} | values


def place(key: str, score: float | None, kept: bool = False, pruned: bool = False) -> Event:
    """A candidate on a level."""
    return {"candidate": key, "score": score, "kept": kept, "pruned": pruned}


def lookahead(number: int, root: str, levels: list[list[Event]], path: list[str]) -> Event:
    """A lookahead that leads to the last of `path`."""
    return {"event": "lookahead", "number": number, "root": root, "levels": levels, "leaf": path[-1], "path": path}


def by_hand() -> list[Event]:
    """Beam 2, depth 2, lookahead. Path root 0.5, b 0.6, bd 0.8. In the second lookahead bd and bw are met again."""
    return [
        start(SearchSettings(width=2, depth=2)),
        scored("root", None, "root", 0.5, epochs=0, loss=None, seconds=1.0),
        scored("a", "root", "deeper(1)", 0.7, parameters=1100),
        scored("b", "root", "wider(1)", 0.6, parameters=1200),
        scored("ad", "a", "deeper(1)", 0.55, parameters=1300),
        failed("aw", "a", "wider(1)"),
        scored("bd", "b", "deeper(1)", 0.8, parameters=1250),
        scored("bw", "b", "wider(1)", 0.3, parameters=1900),
        lookahead(
            0,
            "root",
            [
                [place("a", 0.7, True), place("b", 0.6, True)],
                [place("bd", 0.8, True), place("ad", 0.55, True), place("bw", 0.3), place("aw", None)],
            ],
            ["b", "bd"],
        ),
        {"event": "committed", "number": 0, "candidate": "b", "score": 0.6},
        lookahead(1, "b", [[place("bd", 0.8, True), place("bw", 0.3, True)]], ["bd"]),
        {"event": "committed", "number": 1, "candidate": "bd", "score": 0.8},
        {"event": "finished", "path": ["root", "b", "bd"], "best": "bd"},
    ]


class MadeUpNetworks:
    """A tree as `beam.search` wants it. A node is its operations; a network of n layers has 2n children.

    A child's score is its parent's and some noise. Everything the search asks for is written to `events`, each training
    once.
    """

    def __init__(self, settings: SearchSettings, failing: float = 0.0) -> None:
        self.settings, self.failing = settings, failing
        self.events = [start(settings)]
        self.known: dict[tuple[str, ...], float] = {}
        self.lookaheads: list[Lookahead[tuple[str, ...]]] = []

    def run(self) -> list[Event]:
        """All events of a search."""
        result = search(self, (), self.settings.beam, self._on_lookahead)
        path = [key_of(node) for node, _ in result.path]
        self.events.append({"event": "finished", "path": path, "best": path[-1]})
        return self.events

    def children(self, node: tuple[str, ...]) -> list[tuple[str, ...]]:
        return [(*node, f"{name}({layer + 1})") for name in ("deeper", "wider") for layer in range(layers_of(node))]

    def scores(self, nodes: Sequence[tuple[str, ...]]) -> list[float]:
        for node in nodes:
            if node not in self.known:
                self._train(node)
        return [self.known[node] for node in nodes]

    def commit(self, node: tuple[str, ...]) -> tuple[str, ...]:
        node = (*node, f"retrain({self.settings.retrain})") if self.settings.retrain else node
        [score] = self.scores([node])
        number = len(self.lookaheads) - 1
        self.events.append({"event": "committed", "number": number, "candidate": key_of(node), "score": score})
        return node

    def _train(self, node: tuple[str, ...]) -> None:
        dice = random.Random(repr(node))
        parent = None if not node else key_of(node[:-1])
        operation = node[-1] if node else "root"
        if node and dice.random() < self.failing:
            self.known[node] = math.nan
            self.events.append(failed(key_of(node), str(parent), operation))
            return
        score = round(self.known[node[:-1]] + dice.gauss(0.0, 0.015), 3) if node else 0.711
        self.known[node] = score
        event = scored(
            key_of(node),
            parent,
            operation,
            score,
            epochs=2 if node else 0,
            parameters=parameters_of(node),
            architecture="_".join(f"C3x3x{8 * (layer + 1)}" for layer in range(layers_of(node))),
            operations={child[-1]: parameters_of(child) for child in self.children(node)},
            seconds=dice.uniform(9, 15),
        )
        self.events.append(event)

    def _on_lookahead(self, found: Lookahead[tuple[str, ...]]) -> None:
        self.lookaheads.append(found)
        levels = [
            [place(key_of(e.node), None if math.isnan(e.score) else e.score, e.kept) for e in level]
            for level in found.levels
        ]
        path = [key_of(entry.node) for entry in found.path]
        self.events.append(lookahead(len(self.lookaheads) - 1, key_of(found.root.node), levels, path))


def key_of(node: tuple[str, ...]) -> str:
    return hashlib.sha256(repr(node).encode()).hexdigest()[:16] if node else "root"


def layers_of(node: tuple[str, ...]) -> int:
    return 3 + sum(operation.startswith("deeper") for operation in node)


def parameters_of(node: tuple[str, ...]) -> int:
    size = 62_420
    for operation in node:
        if operation.startswith("deeper"):
            size += 2_320
        elif operation.startswith("wider"):
            size += 41_000 if operation == "wider(1)" else 9_000
    return size
