"""Start a search in a new folder, or go on with one."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ggcnn_net2net.atomic import replacing
from ggcnn_net2net.errors import DatasetError, SearchError, SurgeryError
from ggcnn_net2net.parallel import LocalWorkers, Workers
from ggcnn_net2net.search.beam import search
from ggcnn_net2net.search.candidates import root_candidate
from ggcnn_net2net.search.heuristics import prepare_simulation, simulation_of
from ggcnn_net2net.search.history import SearchHistory, read_history
from ggcnn_net2net.search.journal import (
    FORMAT,
    JOURNAL_FILE,
    RESUMED,
    Event,
    Journal,
    in_force,
    read_events,
    resume_command,
    score_from_json,
)
from ggcnn_net2net.search.reuse import TrainedElsewhere
from ggcnn_net2net.search.settings import FROM_PARENT, SIM, SearchSettings
from ggcnn_net2net.search.trainer import TEACHER_FILE, model_file
from ggcnn_net2net.search.tree import CandidateTree
from ggcnn_net2net.versions import versions

if TYPE_CHECKING:
    import keras

    from ggcnn_net2net.training import Recipe

BEST_FILE = "best.hdf5"

OnEvent = Callable[[Event], None]
"""Told about every event, see `docs/beam_search.md`."""


def start_search(
    model: keras.Model,
    dataset: Path,
    settings: SearchSettings,
    directory: Path,
    workers: Workers,
    *,
    name: str = "",
    command: str = "",
    reuse: Sequence[Path] = (),
    on_event: OnEvent = lambda _: None,
) -> SearchHistory:
    """Search for a better network by surgery and training (sections II and III-A of the paper).

    The result depends on the network, the dataset, the settings and the versions of the packages, and not on the number
    of workers or on interruptions.

    Args:
        model: the network to start from.
        dataset: HDF5 file with a train and a test split, see `datasets.hdf5`.
        settings: of the search.
        directory: folder to write. Must not hold a search.
        workers: where candidates are trained, `parallel.LocalWorkers` or `cluster.DaskWorkers`. On other machines both
            paths have to mean the same files.
        name: what the network is called in reports.
        command: how the user started it, for the record.
        reuse: folders of other searches, from which candidates are taken that are the same there: the search ends as it
            would have without them, earlier.
        on_event: told about what happens.

    Returns:
        What came of it. The best network of the path is in `directory/best.hdf5`.

    Raises:
        SearchError: the folder holds a search, one of `reuse` holds none, the limit of parameters leaves nothing to
            try, the network cannot be scored, or all its children or too many candidates in a row failed.
        TrainingError: a recipe that cannot train: its optimizer, or more images a step than there are.
        DatasetError: a dataset that cannot be read, or has images of another size than the network or the teacher
            takes.
        SurgeryError: no operation can be applied to the network at all.
        ModelFileError: a teacher that cannot be read.
        ObjectSetError, DataNotFoundError: objects of the heuristic "sim" that cannot be had.
    """
    from ggcnn_net2net.simulation.object_sets import absolute_spec

    directory, dataset = Path(directory).absolute(), Path(dataset).absolute()
    settings = replace(settings, sim_objects=absolute_spec(settings.sim_objects))  # a search may go on from elsewhere
    _check_reuse(settings, reuse)
    with Journal(directory / JOURNAL_FILE) as journal:
        if read_events(journal.path):
            raise SearchError(
                f"expected a new folder, {directory} holds a search: go on with "
                f"`{resume_command(directory)}`, or name another one"
            )
        begun = _prepare(model, dataset, settings, directory, name, command)
        begun["reuse"] = [str(Path(other).absolute()) for other in reuse]
        journal.append(begun)
        return _search(directory, [begun], workers, journal, on_event)


def resume_search(
    directory: Path,
    workers: Workers,
    *,
    retry_failed: bool = False,
    on_event: OnEvent = lambda _: None,
) -> SearchHistory:
    """Go on with a search where it stopped; what comes of it is the same, bit for bit, as without the interruption.

    With other versions of the packages it may not be; the journal and the report then tell both.

    Args:
        directory: its folder. The dataset has to be where it was.
        workers: see `start_search`; need not be as many as before.
        retry_failed: train candidates again that failed before. Otherwise they stay failed, but for the first network,
            without which there is no search.
        on_event: told about what happened before, and then about what happens.

    Returns:
        What is known at the end, as of `start_search`.

    Raises:
        SearchError: no search there, another process is at it, other data, or failures as of `start_search`.
    """
    directory = Path(directory).absolute()
    load_history(directory)  # refuses what is no search
    with Journal(directory / JOURNAL_FILE) as journal:
        events = read_events(journal.path)
        _check_data(events[0])
        resumed = {"event": RESUMED, "retry_failed": retry_failed, "versions": versions(), "started": time.time()}
        before = [event["versions"] for event in events if event["event"] in ("search", RESUMED)]
        if retry_failed or resumed["versions"] != before[-1]:
            journal.append(resumed)
            events.append(resumed)
        root = events[0]["root"]
        events = [event for event in in_force(events) if not _tried_again(event, root)]
        return _search(directory, events, workers, journal, on_event)


def _tried_again(event: Event, root: str) -> bool:
    """Whether the event is a failure of the root, which is always tried again: without it there is no search."""
    if event.get("candidate") != root:
        return False
    return event["event"] == "failed" or (event["event"] == "scored" and math.isnan(score_from_json(event["score"])))


def load_history(directory: Path) -> SearchHistory:
    """What is known of a search, which may still run.

    Args:
        directory: folder of the search.

    Returns:
        Candidates, lookaheads and path so far.

    Raises:
        SearchError: no search there.
    """
    path = Path(directory) / JOURNAL_FILE
    if not path.exists():
        raise SearchError(f"expected the folder of a search, {directory} has no {JOURNAL_FILE}: name another one")
    return read_history(read_events(path))


def _prepare(
    model: keras.Model, dataset: Path, settings: SearchSettings, directory: Path, name: str, command: str
) -> Event:
    """Check and copy what the search needs.

    Returns:
        The journal's first event.
    """
    from ggcnn_net2net.datasets.hdf5 import fingerprints_of
    from ggcnn_net2net.model_files import load_ggcnn, save_ggcnn
    from ggcnn_net2net.training.checkpoint import fingerprint_of

    check_search(model, dataset, settings)
    data = {"path": str(dataset), **fingerprints_of(dataset)}
    root = root_candidate(fingerprint_of(model), data["train"])
    save_ggcnn(model, model_file(directory, root.key))
    if settings.distil not in (None, FROM_PARENT):
        save_ggcnn(load_ggcnn(settings.distil), directory / TEACHER_FILE)
    return {
        "event": "search",
        "format": FORMAT,
        "command": command,
        "network": name,
        "root": root.key,
        "settings": settings.as_dict(),
        "data": data,
        "versions": versions(),
        "started": time.time(),
    }


def check_search(model: keras.Model, dataset: Path, settings: SearchSettings) -> None:
    """See that a search can begin, as `start_search` does before it writes anything.

    Args:
        model: the network to start from.
        dataset: of the search.
        settings: of the search.

    Raises:
        SearchError, TrainingError, DatasetError, SurgeryError, ModelFileError, ObjectSetError, DataNotFoundError: as
            `start_search`.
    """
    from ggcnn_net2net.model_files import load_ggcnn

    _check_children(model, settings)
    _check_size(model, dataset)
    _check_recipe(settings.recipe, dataset)
    if settings.distil not in (None, FROM_PARENT):
        _check_size(load_ggcnn(settings.distil), dataset)
    if settings.heuristic == SIM:
        simulation_of(settings)


def _check_reuse(settings: SearchSettings, reuse: Sequence[Path]) -> None:
    for directory in reuse:
        load_history(directory)  # refuses what is no search
    # A teacher is known by its file's name alone.
    taught_by_file = settings.distil not in (None, FROM_PARENT)
    if reuse and (settings.halving or settings.carry_optimizer or taught_by_file):
        raise SearchError(
            "expected a search without successive halving, carried optimizers and a teacher's file to take candidates "
            "from others, received one whose candidates need more than a network and its score: leave `reuse` out"
        )


def _check_children(model: keras.Model, settings: SearchSettings) -> None:
    """See that there is something to search."""
    from ggcnn_net2net.net2net import operations, parameters_after

    possible = operations(model, transpose=settings.transpose)  # raises where surgery is impossible
    if not possible:
        raise SurgeryError(
            "expected a network with a layer that can be changed, received one without: "
            + ("choose another" if settings.transpose else "transposed layers are changed with `transpose` alone")
        )
    smallest = min(parameters_after(model, possible))
    if settings.max_parameters is not None and smallest > settings.max_parameters:
        raise SearchError(
            f"expected a limit of {smallest:,} parameters or more, the smallest network that an operation makes of "
            f"this one with {model.count_params():,}, received {settings.max_parameters:,}: surgery only grows; "
            "start from a smaller one"
        )


def _check_recipe(recipe: Recipe, dataset: Path) -> None:
    """See that a candidate can be trained, whose errors would come much later."""
    from ggcnn_net2net.datasets.hdf5 import GraspDataset
    from ggcnn_net2net.training.data import batches_of_epoch

    recipe.new_optimizer(1)
    batches_of_epoch(
        len(GraspDataset(dataset, "train")),
        recipe.batch_size,
        epoch=0,
        seed=recipe.seed,
        shuffled_rows=recipe.protocol.shuffled_rows,
        budget=recipe.images_per_epoch,
    )


def _check_size(model: keras.Model, dataset: Path) -> None:
    from ggcnn_net2net.datasets.hdf5 import GraspDataset

    taken, found = tuple(model.input_shape[1:3]), GraspDataset(dataset, "train").shape
    if None not in taken and taken != found:
        raise DatasetError(
            f"expected images of {taken} px, which the network takes, received {found} in {dataset}: build a dataset "
            "for this network"
        )


def _check_data(begun: Event) -> None:
    from ggcnn_net2net.datasets.hdf5 import fingerprints_of

    path = Path(begun["data"]["path"])
    found = fingerprints_of(path)
    if any(found[split] != begun["data"][split] for split in found):
        raise SearchError(f"expected the dataset that the search began with in {path}, received another: put it back")


def _search(
    directory: Path, events: Sequence[Event], workers: Workers, journal: Journal, on_event: OnEvent
) -> SearchHistory:
    for event in events:
        on_event(event)
    elsewhere = TrainedElsewhere(events[0], map(Path, events[0].get("reuse", ())))
    tree = CandidateTree(directory, events, workers, journal, on_event, elsewhere)
    if tree.settings.heuristic == SIM:
        with LocalWorkers.of(workers) as own:
            prepare_simulation(tree.settings, directory, own)
    found = search(tree, tree.root, tree.settings.beam, tree.note_lookahead)
    best, _ = min(found.path, key=lambda place: tree.settings.beam.rank(place[1]))
    with replacing(directory / BEST_FILE) as temporary:
        shutil.copyfile(model_file(directory, best.key), temporary)
    tree.write({"event": "finished", "path": [node.key for node, _ in found.path], "best": best.key})
    return load_history(directory)
