"""What happened in a search, one JSON line an event, in the order in which it happened.

The file is only ever appended to. A line counts when it is whole and on the disk; a torn last line, from a process that
was killed while it wrote, is ignored and cut off by the next writer.
"""

from __future__ import annotations

import json
import math
import os
import shlex
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any

from ggcnn_net2net.atomic import alone
from ggcnn_net2net.errors import SearchError

FORMAT = "ggcnn_net2net search 1"
JOURNAL_FILE = "journal.jsonl"
"""Name of the journal in the folder of a search."""

RESUMED = "resumed"
"""Kind of the event written when a search resumes with other package versions, or retries failed candidates."""
_SUPERSEDED = ("failed", "lookahead", "committed", "finished")
"""Kinds of events that no longer count once failed candidates are tried again: the search may then go another way."""

Event = dict[str, Any]
"""JSON values; the key "event" names its kind."""


def resume_command(directory: Path, *options: str) -> str:
    """What a user types to go on with a search.

    Args:
        directory: folder of the search.
        options: of `search resume`.

    Returns:
        The command, quoted for a shell.
    """
    return shlex.join(["ggcnn-net2net", "search", "resume", str(directory), *options])


def score_to_json(score: float) -> float | None:
    """A score as the journal holds it: JSON knows neither NaN nor infinity, which stand for a failure."""
    return score if math.isfinite(score) else None


def score_from_json(value: float | None) -> float:
    """The inverse of `score_to_json`; a failure is NaN."""
    return math.nan if value is None else float(value)


def read_events(path: Path) -> list[Event]:
    """All whole events of a journal; none where there is no file.

    Args:
        path: of the journal.

    Returns:
        The events in the order in which they happened.

    Raises:
        SearchError: a line that is no event before the last one: the file was changed by something else.
    """  # noqa: DOC501 -- the ValueError is caught
    if not path.is_file():
        return []
    events = []
    for number, line in enumerate(_whole_lines(path.read_bytes()), start=1):
        try:
            event = json.loads(line)
            if not isinstance(event, dict) or "event" not in event:
                raise ValueError("no event")
        except ValueError as error:
            raise SearchError(
                f"expected one event a line in {path}, received {line[:80]!r} in line {number}"
            ) from error
        events.append(event)
    return events


def in_force(events: Sequence[Event]) -> list[Event]:
    """The events that still count: neither failures nor decisions from before failed candidates were tried again.

    Args:
        events: of `read_events`.

    Returns:
        The others, in their order.
    """
    retried = max((index for index, event in enumerate(events) if event.get("retry_failed")), default=0)
    return [event for index, event in enumerate(events) if index > retried or event["event"] not in _SUPERSEDED]


class Journal:
    """The writing end of a journal. One at a time holds it, also across processes."""

    def __init__(self, path: Path) -> None:
        """Open a journal for writing, and cut off a torn last line.

        Raises:
            SearchError: another process is writing to it.
        """
        self.path = Path(path)
        refusal = SearchError(
            f"expected {self.path.parent} to be free, another process searches there: wait for it, or choose another "
            "folder"
        )
        self._held = ExitStack()
        self._held.enter_context(alone(self.path.with_suffix(".lock"), refusal))
        self._stream = self.path.open("ab")
        whole = sum(map(len, _whole_lines(self.path.read_bytes())))
        if whole < self._stream.tell():
            self._stream.truncate(whole)

    def append(self, event: Event) -> None:
        """Write an event; it is on the disk when this returns."""
        self._stream.write(json.dumps(event).encode() + b"\n")
        self._stream.flush()
        os.fsync(self._stream.fileno())

    def close(self) -> None:
        """Let others write."""
        self._stream.close()
        self._held.close()

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


def _whole_lines(content: bytes) -> list[bytes]:
    lines = content.splitlines(keepends=True)
    return lines if not lines or lines[-1].endswith(b"\n") else lines[:-1]
