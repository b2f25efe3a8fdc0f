"""The networks of a search: who they are, and what is known of them.

A candidate is a parent, an operation and the way it is trained. All of it, with the data and the seed, is in its key,
so that the same candidate is known again when a later lookahead, or a resumed search, meets it.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from typing import Any

from ggcnn_net2net.search.journal import Event, score_from_json
from ggcnn_net2net.search.settings import SearchSettings

ROOT = "root"
RETRAIN = "retrain"


@dataclass(frozen=True)
class Candidate:
    """A network of the search."""

    key: str
    """16 hex digits."""
    parent: str | None
    """Key of the network that it was made of; None for the root."""
    operation: str
    """"deeper(3)", "retrain(8)" for further training after a commitment, or "root"."""

    @property
    def is_child(self) -> bool:
        """Whether an operation made it."""
        return self.operation != ROOT and not self.is_retrained

    @property
    def is_retrained(self) -> bool:
        """Whether further training made it."""
        return self.operation.startswith(RETRAIN)


def root_candidate(network: str, data: str) -> Candidate:
    """The network that a search starts from, given hashes of it and of the data."""
    return Candidate(hash_of([network, data]), None, ROOT)


def child_of(parent: Candidate, operation: str, settings: SearchSettings, data: str) -> Candidate:
    """The candidate that `operation` makes of `parent`, trained on `data` (a hash)."""
    recipe = settings.recipe.as_dict()
    del recipe["seed"]  # every candidate has its own, of the search's seed
    identity = {
        "parent": parent.key,
        "operation": operation,
        "recipe": recipe,
        "carry_optimizer": settings.carry_optimizer,
        "distil": [settings.distil, settings.distil_weight if settings.distil else None],
        "data": data,
        "seed": settings.seed,
    }
    return Candidate(hash_of(identity), parent.key, operation)


def seed_of(candidate: Candidate, replicate: int, seed: int) -> int:
    """Seed of a candidate's surgery and training, derived from the seed of the search, parent and operation."""
    return int(hash_of([seed, candidate.parent, candidate.operation, replicate])[:8], 16)


def hash_of(value: Any) -> str:
    """First 16 hex digits of the SHA-256 of a value of JSON."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:16]


@dataclass
class Results:
    """What is known of a candidate."""

    scores: dict[tuple[int, int], float] = field(default_factory=dict)
    """By epochs and replicate; NaN where it failed."""
    operations: dict[str, int] = field(default_factory=dict)
    """Operations that can be applied to it, and the parameters of what they make."""
    error: str = ""
    """Why it failed; empty if it did not."""

    def learn(self, event: Event) -> None:
        """Take over what an event "scored" or "failed" says."""
        self.scores[event["epochs"], event["replicate"]] = score_from_json(event.get("score"))
        self.error = event.get("error", self.error)
        if event["replicate"] == 0:
            self.operations = event.get("operations", {})

    def score(self, epochs: int, replicates: int) -> float:
        """Mean over the replicates; NaN if one of them failed."""
        return sum(self.scores[epochs, number] for number in range(replicates)) / replicates
