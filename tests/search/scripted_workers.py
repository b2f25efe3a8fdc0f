"""Workers that train nothing: what a candidate scores is a function of its operations."""

from __future__ import annotations

import hashlib
import itertools
import math

from ggcnn_net2net.search.trainer import model_file

OPERATIONS = {"deeper(1)": 100, "deeper(2)": 200, "wider(1)": 300, "wider(2)": 400}


def score_of(operations: tuple[str, ...], epochs: int, replicate: int) -> float:
    """In [0, 1), of two digits, so that some are equal."""
    text = repr((operations, epochs, replicate))
    return int(hashlib.sha256(text.encode()).hexdigest()[:8], 16) % 100 / 100


class ScriptedWorkers:
    """Implements `parallel.Workers`; NaN as a score stands for a failure. Keeps the jobs it was given."""

    count = 2

    def __init__(self, score=score_of, stop_after=math.inf) -> None:
        self.score = score
        self.jobs = []
        self.stop_after = stop_after
        self.lineage = {}

    def run(self, function, inputs):
        jobs = [job for (job,) in inputs]
        # Results come in another order than the inputs.
        for index in itertools.chain(range(1, len(jobs), 2), range(0, len(jobs), 2)):
            if len(self.jobs) >= self.stop_after:
                raise KeyboardInterrupt
            self.jobs.append(jobs[index])
            yield index, self.outcome(jobs[index])

    def outcome(self, job):
        facts = {**job.facts(), "seconds": 1.0, "started": 0.0, "worker": "scripted:1"}
        operations = self.operations(job.candidate)
        score = self.score(operations, job.epochs, job.replicate)
        if not isinstance(score, float) and not isinstance(score, int):
            return score
        if math.isnan(score):
            return {**facts, "event": "failed", "error": "TrainingError: as the script says", "traceback": "..."}
        file = model_file(job.directory, job.candidate.key)
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(repr(operations))
        parameters = 1000 + sum(OPERATIONS.get(one, 0) for one in operations)
        return {
            **facts,
            "event": "scored",
            "score": score,
            "loss": 0.1,
            "parameters": parameters,
            "architecture": "",
            "operations": {name: parameters + more for name, more in OPERATIONS.items()},
        }

    def operations(self, candidate):
        """All operations from the root on, retrainings included."""
        before = self.lineage.get(candidate.parent, ())
        self.lineage[candidate.key] = () if candidate.parent is None else (*before, candidate.operation)
        return self.lineage[candidate.key]
