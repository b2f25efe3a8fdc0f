"""A running search in the terminal, or line by line where there is none."""

from __future__ import annotations

import time
from types import TracebackType

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from ggcnn_net2net.search.history import SearchHistory, read_history
from ggcnn_net2net.search.journal import Event, score_from_json
from ggcnn_net2net.search.report import counts, duration


class LiveView:
    """Shows where a search is: its level and beam, the best candidates, counts and time. A context manager.

    In a terminal it redraws itself. Elsewhere it prints a line for each level, run, commitment and the end; of what an
    interrupted search had done before, only how much it was.

    Args:
        console: where to show it.
        workers: candidates that are trained at the same time; for the time left.
    """

    def __init__(self, console: Console, workers: int = 1) -> None:
        self._console, self._workers = console, max(1, workers)  # a cluster may have none yet
        self._events: list[Event] = []
        self._level: Event | None = None
        self._read: tuple[int, SearchHistory | None] = (0, None)
        self._started = time.monotonic()
        self._live = Live(console=console, get_renderable=self.render) if console.is_terminal else None

    def __enter__(self) -> LiveView:
        self._started = time.monotonic()
        if self._live:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if self._live:
            self._live.stop()

    def on_event(self, event: Event) -> None:
        """Take notice of an event of the journal, or of a "level" that begins; of others, none.

        A level says {"event": "level", "lookahead": from 0, "level": from 1, "levels": of this lookahead, "known":
        candidates that have a score already, "candidates": [{"parent": key, "operation": "deeper(3)"}, ...]}.
        """
        kind = event.get("event")
        first = kind == "level" and self._level is None
        if kind == "level":
            self._level = event
        elif kind == "search" or self._events:
            self._events.append(event)
        history = None if self._live else self._history()
        if history is None or self._level is None:
            return
        for line in [*(_start(history) if first else ()), *_lines(history, event)]:
            self._console.print(line, markup=False, highlight=False, soft_wrap=True)

    def render(self) -> RenderableType:
        """What the terminal shows now."""
        history = self._history()
        if history is None or self._level is None:
            return Text("Scoring the network to start from ...")
        found = map(Text, counts(history))
        elapsed = f"Elapsed: {duration(time.monotonic() - self._started)}"
        if history.finished:
            return Group(*found, Text(elapsed))
        elapsed += f", left: at most {self._time_left(history, self._level)}"
        return Group(_progress(history, self._level), _beam(history, self._level), *found, Text(elapsed))

    def _history(self) -> SearchHistory | None:
        """Of all events so far; None before the first."""
        number, history = self._read
        if number != len(self._events):
            events = list(self._events)  # `render` runs in a thread of its own
            history = read_history(events)
            self._read = len(events), history
        return history

    def _time_left(self, history: SearchHistory, level: Event) -> str:
        trained = [item.seconds for item in history.candidates.values() if item.state != "root"]
        if not trained:
            return "-"
        return duration(trainings_left(history, level) * sum(trained) / len(trained) / self._workers)


def trainings_left(history: SearchHistory, level: Event) -> float:
    """At most so many candidates are still to be trained.

    Of this level, those without a score; of every later one, all children of as many networks as the beam is wide. A
    network at a depth has at most two operations more than the root for each operation before it, as *deeper* adds one
    layer. From the second lookahead on, the way that the one before chose is still in the beam, so the children of one
    network on each level are known, unless the search retrains; a retrain counts by its epochs.

    Args:
        history: so far.
        level: the event of the level that is being trained.
    """
    settings, root = history.settings, history.candidates[history.root]
    now = level["lookahead"]
    left = float(len(level["candidates"]) - _done(history, level))
    lookaheads = range(now, settings.depth) if settings.lookahead else [now]
    for lookahead in lookaheads:
        known = 1 if lookahead > 0 and not settings.retrain else 0
        for above in range(level["level"] if lookahead == now else 0, settings.depth - lookahead):
            expanded = settings.width if above else 1
            left += (expanded - known) * (root.children + 2 * (lookahead + above))
    return left + (len(lookaheads) * settings.retrain / settings.recipe.epochs if settings.lookahead else 0.0)


def _done(history: SearchHistory, level: Event) -> int:
    """Candidates of a level that are scored or failed; with successive halving at least once."""
    made = {(item.parent, item.operation): item for item in history.candidates.values()}
    found = [made.get((item["parent"], item["operation"])) for item in level["candidates"]]
    return sum(
        item is not None and (item.state == "failed" or len(item.replicate_scores) >= history.settings.replicates)
        for item in found
    )


def _position(history: SearchHistory, level: Event) -> str:
    lookaheads = history.settings.depth if history.settings.lookahead else 1
    return f"lookahead {level['lookahead'] + 1} of {lookaheads}, level {level['level']} of {level['levels']}"


def _progress(history: SearchHistory, level: Event) -> Table:
    done, total = _done(history, level), len(level["candidates"])
    row = Table.grid(padding=(0, 1))
    bar = ProgressBar(total, done, width=30)
    row.add_row(_position(history, level), bar, f"{done}/{total} candidates, {level['known']} were known")
    return row


def _beam(history: SearchHistory, level: Event) -> Table:
    """The networks whose children this level trains."""
    table = Table("beam", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in (history.score_name, "parameters"):
        table.add_column(heading, justify="right", no_wrap=True)
    for key in dict.fromkeys(item["parent"] for item in level["candidates"]):
        candidate = history.candidates[key]
        table.add_row(candidate.sequence, history.score_text(candidate.score), f"{candidate.parameters:,}")
    return table


def _start(history: SearchHistory) -> list[str]:
    """Where the search starts, and what an interrupted one had done before."""
    root, known = history.candidates[history.root], len(history.candidates) - 1
    start = f"start: {history.score_name} {history.score_text(root.score)}, {root.parameters:,} parameters"
    return [start, f"resumed with {known} candidates"] if known else [start]


def _lines(history: SearchHistory, event: Event) -> list[str]:
    """What an event means, in words; none for what is of no interest."""
    kind = event.get("event")
    if kind == "level":
        return [f"{_position(history, event)}: {len(event['candidates'])} candidates, {event['known']} known"]
    if kind == "finished":
        return ["finished"]  # the counts follow in the summary
    if kind not in ("scored", "failed", "committed"):
        return []
    candidate = history.candidates[event["candidate"]]
    score = history.score_text(score_from_json(event.get("score")))
    if kind == "committed":
        return [f"committed to {candidate.sequence}: {history.score_name} {score}"]
    run = f"{event['epochs']} epochs, {event['seconds']:.0f} s"
    if history.settings.replicates > 1:
        run += f", replicate {event['replicate'] + 1} of {history.settings.replicates}"
    if kind == "failed":
        return [f"  failed  {candidate.sequence} ({run}): {event['error']}"]
    return [f"  {score}  {candidate.sequence} ({candidate.parameters:,} parameters, {run})"]
