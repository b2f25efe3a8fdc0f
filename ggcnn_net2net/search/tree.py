"""The tree of networks that the beam search walks through: it trains what is not known yet, and keeps the journal."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from ggcnn_net2net.errors import SearchError
from ggcnn_net2net.parallel import Crash, Workers
from ggcnn_net2net.search.beam import Lookahead
from ggcnn_net2net.search.candidates import RETRAIN, ROOT, Candidate, Results, child_of, seed_of
from ggcnn_net2net.search.journal import Event, Journal, resume_command, score_to_json
from ggcnn_net2net.search.reuse import TrainedElsewhere
from ggcnn_net2net.search.settings import SearchSettings
from ggcnn_net2net.search.trainer import Job, run_job


class CandidateTree:
    """What `beam.search` needs to know of the networks (`beam.Tree`)."""

    def __init__(
        self,
        directory: Path,
        events: Sequence[Event],
        workers: Workers,
        journal: Journal,
        on_event: Callable[[Event], None],
        elsewhere: TrainedElsewhere,
    ) -> None:
        """Prepare to walk.

        Args:
            directory: folder of the search.
            events: what its journal holds already; the first one says what the search is.
            workers: where candidates are trained.
            journal: takes what becomes known.
            on_event: told about what becomes known, and about every level that begins.
            elsewhere: what other searches have trained.
        """
        begun = events[0]
        self.directory = directory
        self.settings = SearchSettings.from_dict(begun["settings"])
        self.root = Candidate(begun["root"], None, ROOT)
        self._data = begun["data"]
        self._workers, self._journal, self._on_event = workers, journal, on_event
        self._elsewhere = elsewhere
        self._results: dict[str, Results] = {}
        self._pruned: dict[str, float] = {}
        self._failed_in_a_row: set[str] = set()
        self._level = self._commitments = 0
        self._written = {_text(event) for event in events}
        for event in events:
            if event["event"] in ("scored", "failed"):
                self._learn(event)

    def children(self, node: Candidate) -> Sequence[Candidate]:
        """A child for every operation that is possible and leads to a network within the limit of parameters."""
        limit = self.settings.max_parameters or math.inf
        operations = self._results[node.key].operations
        return [
            child_of(node, operation, self.settings, self._data["train"])
            for operation, parameters in operations.items()
            if parameters <= limit
        ]

    def scores(self, nodes: Sequence[Candidate]) -> Sequence[float]:
        """Train and score what is not known yet. With successive halving, the pruned ones have no score."""
        if not nodes[0].is_child:
            self._train(nodes)
            scores = [self._score(node) for node in nodes]
            if nodes[0] == self.root and math.isnan(scores[0]):
                error = self._results[self.root.key].error or "a score that is not a number"
                raise SearchError(
                    f"expected a network that can be scored to start from, received {error}; remove the cause, and go "
                    f"on with `{resume_command(self.directory)}`"
                )
            return scores
        self._begin_level(nodes)
        survivors = self._survivors(nodes)
        self._train(survivors)
        scores = [math.nan if node.key in self._pruned else self._score(node) for node in nodes]
        if self._commitments == 0 and self._level == 1 and all(map(math.isnan, scores)):
            raise SearchError(
                f"expected a child of the first network that can be trained, all {len(survivors)} failed, the last "
                f"with: {self._results[survivors[-1].key].error}; remove the cause, and go on with "
                f"`{resume_command(self.directory, '--retry-failed')}`"
            )
        return scores

    def _survivors(self, nodes: Sequence[Candidate]) -> list[Candidate]:
        """Those that successive halving leaves to be trained to the end; without it, all."""
        survivors = list(nodes)
        for epochs in self.settings.rungs[:-1]:
            if len(survivors) > self.settings.width:
                # What an earlier level, too small to halve, has trained to the end must not be trained anew.
                done = [node for node in survivors if self._has_score(node) and not self._has_score(node, epochs)]
                racing = [node for node in survivors if node not in done]
                self._train(racing, epochs)
                pruned = self._worse_half(racing, epochs)
                survivors = [node for node in survivors if node not in pruned]
        return survivors

    def commit(self, node: Candidate) -> Candidate:
        """The node, trained further if the search retrains; if that fails, the node as it was."""
        if self.settings.retrain:
            further = child_of(node, f"{RETRAIN}({self.settings.retrain})", self.settings, self._data["train"])
            self._train([further])
            node = node if math.isnan(self._score(further)) else further
        self.write(
            {"event": "committed", "number": self._commitments, "candidate": node.key, "score": self._score(node)}
        )
        self._commitments += 1
        self._level = 0
        return node

    def note_lookahead(self, found: Lookahead[Candidate]) -> None:
        """Put a lookahead down in the journal."""
        self.write(
            {
                "event": "lookahead",
                "number": self._commitments,
                "root": found.root.node.key,
                "levels": [
                    [
                        {
                            "candidate": entry.node.key,
                            "score": score_to_json(self._pruned.get(entry.node.key, entry.score)),
                            "kept": entry.kept,
                            "pruned": entry.node.key in self._pruned,
                        }
                        for entry in level
                    ]
                    for level in found.levels
                ],
                "leaf": found.leaf.node.key,
                "path": [entry.node.key for entry in found.path],
            }
        )
        self._pruned = {}

    def write(self, event: Event) -> None:
        """Append an event to the journal unless it is there already: a resumed search repeats its earlier events."""
        if _text(event) not in self._written:
            self._journal.append(event)
            self._written.add(_text(event))
            self._on_event(event)

    def _train(self, nodes: Iterable[Candidate], epochs: int | None = None) -> None:
        """Train and score the nodes that have no result yet, for the epochs of a rung; None: to the end."""
        jobs = [
            self._job(node, self._epochs(node) if epochs is None else epochs, replicate)
            for node in nodes
            for replicate in range(self._replicates(node))
        ]
        jobs = [job for job in jobs if not self._knows(job) and not self._take(job)]
        for index, outcome in self._workers.run(run_job, [(job,) for job in jobs]):
            job = jobs[index]
            event = job.crashed(outcome) if isinstance(outcome, Crash) else outcome
            self.write(event)
            self._learn(event)
            # A checkpoint serves an interrupted training, also by a worker that died, the next rung, and children that
            # carry the optimizer on.
            if epochs is None and not self.settings.carry_optimizer and not isinstance(outcome, Crash):
                shutil.rmtree(job.checkpoint_dir, ignore_errors=True)
            self._count_failures(event)

    def _job(self, node: Candidate, epochs: int, replicate: int) -> Job:
        seed = seed_of(node, replicate, self.settings.seed)
        return Job(self.directory, self.settings, self._data["path"], node, epochs, replicate, seed)

    def _epochs(self, node: Candidate) -> int:
        """Epochs after which a node is fully trained."""
        if node.is_child:
            return self.settings.rungs[-1]
        return self.settings.retrain if node.is_retrained else 0

    def _replicates(self, node: Candidate) -> int:
        """The root was not trained here, and what is committed to is one network."""
        return self.settings.replicates if node.is_child else 1

    def _knows(self, job: Job) -> bool:
        known = self._results.get(job.candidate.key)
        return known is not None and (job.epochs, job.replicate) in known.scores

    def _take(self, job: Job) -> bool:
        """Take a candidate from another search, if one has it."""
        event = self._elsewhere.take(job)
        if event is not None:
            self.write(event)
            self._learn(event)
        return event is not None

    def _learn(self, event: Event) -> None:
        self._results.setdefault(event["candidate"], Results()).learn(event)

    def _score(self, node: Candidate, epochs: int | None = None) -> float:
        epochs = self._epochs(node) if epochs is None else epochs
        return self._results[node.key].score(epochs, self._replicates(node))

    def _has_score(self, node: Candidate, epochs: int | None = None) -> bool:
        epochs = self._epochs(node) if epochs is None else epochs
        return all(self._knows(self._job(node, epochs, replicate)) for replicate in range(self._replicates(node)))

    def _worse_half(self, nodes: list[Candidate], epochs: int) -> list[Candidate]:
        """Prune on a rung; at least as many as the beam is wide go on."""
        scores = {node.key: self._score(node, epochs) for node in nodes}
        ranked = sorted(nodes, key=lambda node: self.settings.beam.rank(scores[node.key]))
        pruned = ranked[max(self.settings.width, math.ceil(len(nodes) / 2)) :]
        self._pruned |= {node.key: scores[node.key] for node in pruned}
        return pruned

    def _begin_level(self, nodes: Sequence[Candidate]) -> None:
        """Tell which candidates come next."""
        self._level += 1
        self._on_event(
            {
                "event": "level",
                "lookahead": self._commitments,
                "level": self._level,
                "levels": self.settings.depth - self._commitments,
                "candidates": [vars(node) for node in nodes],
                "known": sum(self._knows(self._job(node, self._epochs(node), 0)) for node in nodes),
            }
        )

    def _count_failures(self, event: Event) -> None:
        if event["event"] != "failed":
            self._failed_in_a_row.clear()
            return
        self._failed_in_a_row.add(event["candidate"])  # with replicates it may fail more than once
        if len(self._failed_in_a_row) >= self.settings.max_failures:
            command = resume_command(self.directory, "--retry-failed")
            raise SearchError(
                f"stopped after {len(self._failed_in_a_row)} failed candidates in a row, the last with: "
                f"{event['error']}; remove the cause, and go on with `{command}`"
            )


def _text(event: Event) -> str:
    return json.dumps(event, sort_keys=True)
