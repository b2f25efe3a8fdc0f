"""Candidates that other searches have trained: the same network, data, recipe and seed need not be trained twice."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ggcnn_net2net.atomic import replacing
from ggcnn_net2net.search.candidates import root_candidate
from ggcnn_net2net.search.history import read_history
from ggcnn_net2net.search.journal import JOURNAL_FILE, Event, read_events
from ggcnn_net2net.search.settings import SearchSettings
from ggcnn_net2net.search.trainer import Job, model_file
from ggcnn_net2net.versions import versions

if TYPE_CHECKING:
    import keras

_NOT_OF_A_CANDIDATE = ("beam", "max_parameters", "retrain", "max_failures")
"""Settings that decide which candidates are tried but not their results. A candidate's key covers its training."""


@dataclass(frozen=True)
class _Trained:
    directory: Path
    event: Event


class TrainedElsewhere:
    """What other searches know of candidates that this one may meet."""

    def __init__(self, begun: Event, directories: Iterable[Path]) -> None:
        """Read their journals.

        Args:
            begun: first event of this search's journal.
            directories: folders of other searches, which may still run. Those that train or score in another way, or
                with other versions of the packages, have nothing that could be taken; nor have those that are gone.
        """
        self._trained: dict[tuple[str, int, int], _Trained] = {}
        for directory in directories:
            events = read_events(directory / JOURNAL_FILE)
            if events and _comparable(events[0]) == _comparable(begun) and _versions_are(begun["versions"], events):
                for event in events:
                    if event["event"] == "scored":
                        key = (event["candidate"], event["epochs"], event["replicate"])
                        self._trained.setdefault(key, _Trained(directory, event))

    def take(self, job: Job) -> Event | None:
        """Copy the network of a job's candidate into this search.

        Returns:
            The event "scored" of the other search, with its folder as `taken_from`; None if no search has the network.
        """
        known = self._trained.get((job.candidate.key, job.epochs, job.replicate))
        if known is None:
            return None
        if job.replicate == 0:
            source, target = (
                model_file(directory, job.candidate.key) for directory in (known.directory, job.directory)
            )
            if not source.is_file():
                return None
            target.parent.mkdir(parents=True, exist_ok=True)
            with replacing(target) as temporary:
                shutil.copyfile(source, temporary)
        return {**known.event, "taken_from": str(known.directory)}


def differences(model: keras.Model, settings: SearchSettings, dataset: Path, directory: Path) -> list[str]:
    """Why nothing can be taken from a search.

    Args:
        model: the network that the new search starts from.
        settings: of the new search.
        dataset: what the new search trains and scores on.
        directory: folder of the search to take candidates from.

    Returns:
        Names of what differs and matters to a candidate, such as "recipe.images_per_epoch", "train images" or
        "network"; none also where there is no search.

    Raises:
        SearchError: the journal is not that of a search.
    """
    from ggcnn_net2net.datasets.hdf5 import fingerprints_of
    from ggcnn_net2net.training.checkpoint import fingerprint_of

    events = read_events(directory / JOURNAL_FILE)
    if not events:
        return []
    read_history(events)  # refuses what is no search
    begun = events[0]
    plain = json.loads(json.dumps(settings.as_dict()))  # as the journal holds it
    new, old = (_flat(_candidate_settings(values)) for values in (plain, begun["settings"]))
    differing = sorted(name for name in new.keys() | old.keys() if new.get(name) != old.get(name))
    found = fingerprints_of(dataset)
    differing += [f"{split} images" for split in found if found[split] != begun["data"][split]]
    if root_candidate(fingerprint_of(model), begun["data"]["train"]).key != begun["root"]:
        differing.append("network")
    return differing if _versions_are(versions(), events) else [*differing, "versions of the packages"]


def _flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """{"recipe.epochs": 2, ...} of nested settings."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, dict) else {f"{prefix}{name}": value}
    return flat


def _versions_are(versions: dict[str, str], events: Iterable[Event]) -> bool:
    """Whether a search, resumed or not, has always run with these."""
    return all(event["versions"] == versions for event in events if "versions" in event)


def _comparable(begun: Event) -> dict[str, Any]:
    data = {split: begun["data"][split] for split in ("train", "test")}
    return {"settings": _candidate_settings(begun["settings"]), "data": data}


def _candidate_settings(settings: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in settings.items() if name not in _NOT_OF_A_CANDIDATE}
