"""What a search has done so far, from its journal. No Keras."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from ggcnn_net2net.errors import SearchError
from ggcnn_net2net.search.journal import FORMAT, RESUMED, Event, in_force, score_from_json
from ggcnn_net2net.search.settings import HEURISTICS, LOSS, SearchSettings

State = Literal["root", "trained", "pruned", "failed"]

_SURGERIES = ("deeper(", "wider(")


@dataclass(frozen=True)
class CandidateRecord:
    """A network that the search has tried."""

    key: str
    parent: str | None
    """Key of the network it was made of; None for the root."""
    operation: str
    """deeper(3), wider(3), retrain(8), or "root"."""
    operations: tuple[str, ...]
    """All operations from the root on; none for the root."""
    depth: int
    """Surgeries from the root on; a retrain is none."""
    state: State
    """"pruned": stopped early by successive halving, so its score is of fewer epochs. "failed": without a score."""
    score: float
    """Mean over its replicates, at the most epochs; NaN if one of them failed."""
    replicate_scores: tuple[float, ...]
    """One a training seed; NaN for one that failed."""
    parameters: int | None
    """None where nobody could count them."""
    architecture: str
    """In the paper's notation; empty if it failed."""
    children: int
    """Number of operations that can be applied to it."""
    epochs: int
    loss: float
    """Mean training loss of the last epoch, over its replicates; NaN where there is none."""
    seconds: float
    """Work on it, all replicates and epochs together; of another search if it was taken from there."""
    taken_from: str
    """Folder of the other search that has trained it; empty if this one has."""
    error: str
    """Why it failed, in one line; empty if it did not."""
    traceback: str

    @property
    def sequence(self) -> str:
        """Its operations as one text."""
        return ", ".join(self.operations) or self.operation

    @property
    def comparable(self) -> bool:
        """Whether it has a score, of as many epochs as the others'."""
        return self.state in ("root", "trained")


@dataclass(frozen=True)
class Place:
    """A candidate on a level of a lookahead."""

    candidate: str
    score: float
    kept: bool
    """Whether it was in the beam."""
    pruned: bool


@dataclass(frozen=True)
class Lookahead:
    """One beam search from a committed candidate."""

    number: int
    root: str
    levels: tuple[tuple[Place, ...], ...]
    """Best first."""
    path: tuple[str, ...]
    """From the child of the root down to the leaf that decided."""

    @property
    def places(self) -> list[Place]:
        """Of all levels."""
        return [place for level in self.levels for place in level]


@dataclass(frozen=True)
class SearchHistory:
    """A search, finished or not."""

    command: str
    network: str
    """What the search started from: "published", or a file."""
    root: str
    """Its key."""
    settings: SearchSettings
    data: Mapping[str, str]
    versions: Mapping[str, str]
    later_versions: tuple[Mapping[str, str], ...]
    """Other versions of the packages with which the search was resumed; none as a rule."""
    candidates: Mapping[str, CandidateRecord]
    """By key, in the order in which they first appeared."""
    lookaheads: tuple[Lookahead, ...]
    path: tuple[tuple[CandidateRecord, float], ...]
    """What was committed to so far with its score, root first; empty before the root was scored."""
    finished: bool

    @property
    def score_name(self) -> str:
        """What the score measures."""
        return HEURISTICS[self.settings.heuristic]

    def score_text(self, score: float, sign: str = "") -> str:
        """A score for people; with sign="+" a difference of scores."""
        digits = 5 if self.settings.heuristic == LOSS else 3
        return "-" if math.isnan(score) else f"{score:{sign}.{digits}f}"

    @property
    def trained(self) -> int:
        """Candidates that were trained here and have a score, the pruned ones included. The root is none."""
        return sum(item.state in ("trained", "pruned") and not item.taken_from for item in self.candidates.values())

    @property
    def taken(self) -> int:
        """Candidates that another search has trained. The root is none."""
        return sum(item.state != "root" and bool(item.taken_from) for item in self.candidates.values())

    @property
    def failed(self) -> list[CandidateRecord]:
        """Candidates without a score."""
        return [candidate for candidate in self.candidates.values() if candidate.state == "failed"]

    @property
    def reused(self) -> int:
        """Places in lookaheads whose candidate had a score from an earlier lookahead, so that nothing was trained."""
        seen: set[str] = set()
        count = 0
        for lookahead in self.lookaheads:
            here = [place.candidate for place in lookahead.places]
            count += sum(key in seen and self.candidates[key].state != "failed" for key in here)
            seen.update(here)
        return count

    @property
    def avoided(self) -> float:
        """Share of trainings that reuse made unnecessary, 0 to 1."""
        return self.reused / (self.trained + self.taken + self.reused) if self.reused else 0.0

    @property
    def seconds(self) -> float:
        """Work on all candidates that were not taken from other searches, summed over the workers."""
        return sum(candidate.seconds for candidate in self.candidates.values() if not candidate.taken_from)

    @property
    def kept(self) -> dict[str, list[int]]:
        """Numbers of the lookaheads in whose beam a candidate was, by its key."""
        found: dict[str, list[int]] = {}
        for lookahead in self.lookaheads:
            for key in [place.candidate for place in lookahead.places if place.kept]:
                found.setdefault(key, []).append(lookahead.number)
        return found

    @property
    def best(self) -> CandidateRecord | None:
        """The best of the path, of equal ones the first; None as long as nothing has a score."""
        return self._best(candidate for candidate, _ in self.path)

    @property
    def best_of_all(self) -> CandidateRecord | None:
        """The best of all candidates but the pruned ones, of equal ones the first; None as long as there is none."""
        return self._best(self.candidates.values())

    @property
    def front(self) -> list[CandidateRecord]:
        """The Pareto front, smallest first: those for which no candidate of at most their size scores better."""
        sized = [item for item in self.candidates.values() if item.comparable]
        front: list[CandidateRecord] = []
        for candidate in sorted(sized, key=lambda item: (item.parameters or 0, self.rank(item))):
            if not front or self.rank(candidate) < self.rank(front[-1]):
                front.append(candidate)
        return front

    def rank(self, candidate: CandidateRecord) -> float:
        """Sorts candidates best first, those without a score last."""
        sign = -1 if self.settings.beam.maximise else 1
        return math.inf if math.isnan(candidate.score) else sign * candidate.score

    def _best(self, candidates: Iterable[CandidateRecord]) -> CandidateRecord | None:
        return min((item for item in candidates if item.comparable), key=self.rank, default=None)


def read_history(events: Iterable[Event]) -> SearchHistory:
    """Make sense of a journal.

    Args:
        events: of `read_events`, in their order. The search may be unfinished: they may end anywhere after the first.
            Kinds of events that are not known are passed over.

    Returns:
        What the search has done.

    Raises:
        SearchError: not the journal of a search, or one that something else has changed: values missing, or candidates
            that are used before they have a score or a failure.
    """
    events = list(events)
    if not events or (events[0].get("event"), events[0].get("format")) != ("search", FORMAT):
        raise SearchError(
            f"expected a journal that begins with an event 'search' of the format {FORMAT!r}, received "
            f"{str(events[0])[:100] if events else 'no event'}: name the folder of a search"
        )
    try:
        return _history(in_force(events))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise SearchError(
            f"expected the journal of a search, received one with a missing or wrong value, {error!r}: it was changed "
            "by something else, or written by another version"
        ) from error


def _history(events: Sequence[Event]) -> SearchHistory:
    begun = events[0]
    settings = SearchSettings.from_dict(begun["settings"])
    lookaheads = {event["number"]: _lookahead(event) for event in events if event["event"] == "lookahead"}
    committed = {event["number"]: event for event in events if event["event"] == "committed"}
    full = settings.recipe.epochs if settings.halving else 0
    candidates = _candidates(events, list(lookaheads.values()), full)
    path = [(candidates[begun["root"]], candidates[begun["root"]].score)] if candidates else []
    valid = []
    for number in range(len(lookaheads)):
        lookahead = lookaheads.get(number)
        if lookahead is None or lookahead.root != path[-1][0].key:
            break  # of an earlier run, which retried failures have led elsewhere
        valid.append(lookahead)
        if not settings.lookahead:
            path += [(candidates[key], candidates[key].score) for key in lookahead.path]
        if number not in committed:
            break
        path.append((candidates[committed[number]["candidate"]], score_from_json(committed[number]["score"])))
    return SearchHistory(
        command=begun["command"],
        network=begun["network"] or "a network without a name",
        root=begun["root"],
        settings=settings,
        data=begun["data"],
        versions=begun["versions"],
        later_versions=tuple(
            event["versions"]
            for event in events
            if event["event"] == RESUMED and event["versions"] != begun["versions"]
        ),
        candidates=candidates,
        lookaheads=tuple(valid),
        path=tuple(path),
        finished=any(event["event"] == "finished" for event in events),
    )


def _lookahead(event: Event) -> Lookahead:
    levels = [
        tuple(Place(item["candidate"], score_from_json(item["score"]), item["kept"], item["pruned"]) for item in level)
        for level in event["levels"]
    ]
    return Lookahead(event["number"], event["root"], tuple(levels), tuple(event["path"]))


def _candidates(events: Sequence[Event], lookaheads: Sequence[Lookahead], full: int) -> dict[str, CandidateRecord]:
    """Candidates by key; with successive halving, those with less than `full` epochs are pruned, or not done yet."""
    runs: dict[str, list[Event]] = {}
    for event in events:
        if event["event"] in ("scored", "failed"):
            runs.setdefault(event["candidate"], []).append(event)
    places = [place for lookahead in lookaheads for place in lookahead.places]
    # Another lookahead may have trained it to the end.
    pruned = {place.candidate for place in places if place.pruned}
    pruned -= {place.candidate for place in places if not place.pruned}
    candidates: dict[str, CandidateRecord] = {}
    for key, about in runs.items():
        first = about[0]
        parent = None if first["parent"] is None else candidates[first["parent"]]
        sizes = {} if parent is None else _last(runs[parent.key], "operations", {})
        early = first["operation"].startswith(_SURGERIES) and max(run["epochs"] for run in about) < full
        candidates[key] = _candidate(about, parent, sizes.get(first["operation"]), early or key in pruned)
    never_tried = {place.candidate for place in places} - candidates.keys()
    if never_tried:
        raise KeyError(*never_tried)
    return candidates


def _state(score: float, pruned: bool, is_root: bool) -> State:
    if math.isnan(score):
        return "failed"
    if pruned:
        return "pruned"
    return "root" if is_root else "trained"


def _candidate(
    runs: Sequence[Event], parent: CandidateRecord | None, parameters: int | None, pruned: bool
) -> CandidateRecord:
    """One candidate from its events; `parameters` as its parent expected them."""
    first = runs[0]
    operations = (*parent.operations, first["operation"]) if parent else ()
    epochs = max(run["epochs"] for run in runs)
    # The last word on each replicate; what failed may have been tried again.
    latest = {run["replicate"]: run for run in runs if run["epochs"] == epochs}
    scores = [score_from_json(latest[replicate].get("score")) for replicate in sorted(latest)]
    score = _mean(scores)
    failures = [run for run in latest.values() if run["event"] == "failed"]
    unscored = "the score is not a number" if math.isnan(score) else ""
    return CandidateRecord(
        key=first["candidate"],
        parent=first["parent"],
        operation=first["operation"],
        operations=operations,
        depth=sum(operation.startswith(_SURGERIES) for operation in operations),
        state=_state(score, pruned, is_root=parent is None),
        score=score,
        replicate_scores=tuple(scores),
        parameters=_last(runs, "parameters", parameters),
        architecture=_last(runs, "architecture", ""),
        children=len(_last(runs, "operations", {})),
        epochs=epochs,
        loss=_mean([score_from_json(run.get("loss")) for run in latest.values()]),
        seconds=sum(run["seconds"] for run in runs),
        taken_from=_last(runs, "taken_from", ""),
        error=_last(failures, "error", unscored),
        traceback=_last(failures, "traceback", ""),
    )


def _last(runs: Sequence[Event], name: str, otherwise: Any) -> Any:
    return next((run[name] for run in reversed(runs) if name in run), otherwise)


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else math.nan
