"""Run the searches of an experiment again, and judge every network on their paths."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ggcnn_net2net.atomic import write_text
from ggcnn_net2net.errors import ResultsError, SearchError
from ggcnn_net2net.parallel import Crash, LocalWorkers
from ggcnn_net2net.protocol import Protocol
from ggcnn_net2net.reproduce.curves import IOU, SCORE, SIM, CurvePoint, read_points, write_points
from ggcnn_net2net.reproduce.experiments import LEARNING_RATE, Curve, Experiment
from ggcnn_net2net.reproduce.statistics import Rate
from ggcnn_net2net.versions import versions

if TYPE_CHECKING:
    import keras

    from ggcnn_net2net.parallel import Workers
    from ggcnn_net2net.reproduce.networks import Network
    from ggcnn_net2net.reproduce.table1 import Progress
    from ggcnn_net2net.search import SearchSettings
    from ggcnn_net2net.search.history import SearchHistory
    from ggcnn_net2net.search.run import OnEvent

RESULTS_FILE = "results.csv"
_IOU_FILE = "iou.json"


@dataclass(frozen=True)
class Conditions:
    """What all curves of a run have in common."""

    data: Path
    """HDF5 file of `dataset build`: the searches train on one split, and score on the other."""
    budget: str = "standard"
    """Of `search.BUDGETS`."""
    seed: int = 0
    """Of the searches and of the scenes in simulation."""
    objects: str = "procedural40"
    """Object set of the simulation."""
    poses: int = 5
    max_parameters: int | None = None
    """The searches consider no larger networks; None: no limit, as in the paper."""
    learning_rate: float = LEARNING_RATE
    """With which the searches train."""

    @property
    def effort(self) -> str:
        """The budget, and what is not the paper's, as they stand in the results."""
        limit = "" if self.max_parameters is None else f", at most {self.max_parameters:,} parameters"
        rate = "" if self.learning_rate == LEARNING_RATE else f", learning rate {self.learning_rate:g}"
        return f"{self.budget}{limit}{rate}"


@dataclass(frozen=True)
class Views:
    """Where progress is shown. Each function takes a title and returns a context manager that gives the callback."""

    search: Callable[[str], AbstractContextManager[OnEvent]] = lambda _: nullcontext(lambda _: None)
    judging: Callable[[str], AbstractContextManager[Progress]] = lambda _: nullcontext(lambda *_: None)


def run_experiment(
    experiment: Experiment,
    conditions: Conditions,
    output: Path,
    workers: Workers,
    *,
    work: Path | None = None,
    command: str = "",
    views: Views | None = None,
) -> list[CurvePoint]:
    """Search, and judge every network on the paths that the searches commit to.

    An interrupted run goes on where it stopped. Results are written after every curve, and those of other curves that
    `output` holds stay.

    Args:
        experiment: the curves, see `experiments.part_of`.
        conditions: data, budget, limit, learning rate, seed and objects.
        output: folder of results.csv.
        workers: train the candidates, compute their IoU rates, and grasp; the last on this machine alone.
        work: folder for searches/CURVE-PROTOCOL (each a folder of `search`, with its report), simulation-PROTOCOL (a
            folder of `table1`) and iou.json; experiments with the same one share what is equal. Default: `output`.
        command: how the user started it, for the record.
        views: where progress is shown.

    Returns:
        All points that `output` holds. IOU is over all test images, SCORE what the search saw on the images it selected
        on; SIM is on the same scenes for all curves of a protocol.

    Raises:
        ResultsError: `work` holds a search or a simulation with other settings, or grasps or rates were lost to workers
            that died.
        SearchError, DatasetError, ModelFileError: as `search.start_search` and `load_ggcnn`.
    """
    from ggcnn_net2net.reproduce.results import check_settings, settings_of
    from ggcnn_net2net.reproduce.table1 import run_table1
    from ggcnn_net2net.simulation import PAPER_GRIPPER
    from ggcnn_net2net.simulation.object_sets import load_object_set
    from ggcnn_net2net.simulation.scenes import SceneSettings

    work, views = work or output, views or Views()
    sets = {protocol: load_object_set(conditions.objects, protocol) for protocol in experiment.protocols}
    curves = {protocol: [curve.of_protocol(protocol) for curve in experiment.curves] for protocol in sets}
    simulations = {protocol: work / f"simulation-{protocol.name.lower()}" for protocol in experiment.protocols}
    for protocol, objects in sets.items():  # what would be refused after hours of searching
        scenes = SceneSettings.of(objects, conditions.poses, conditions.seed)
        check_settings(simulations[protocol] / "results.json", settings_of(scenes, protocol, PAPER_GRIPPER))
        for curve in curves[protocol]:
            _prepare(curve, conditions, protocol, _directory(work, curve, protocol), workers)
    if (output / RESULTS_FILE).is_file():
        read_points(output / RESULTS_FILE)
    for protocol, objects in sets.items():
        networks: list[Network] = []
        for curve in curves[protocol]:
            title = f"{experiment.name}: {curve.name}, protocol {protocol.name}"
            directory = _directory(work, curve, protocol)
            with views.search(title) as on_event:
                history = _search(curve, conditions, protocol, directory, workers, command, on_event)
            found = _networks_of(curve, history, directory)
            networks += found
            with views.judging(title) as on_progress, LocalWorkers.of(workers) as own:
                iou = _iou_rates(
                    found,
                    directory,
                    conditions.data,
                    protocol,
                    history.settings.threads,
                    workers,
                    work / _IOU_FILE,
                    on_progress,
                )
                table = run_table1(
                    networks,
                    objects,
                    simulations[protocol],
                    poses=conditions.poses,
                    seed=conditions.seed,
                    protocol=protocol,
                    workers=own,
                    command=command,
                    on_progress=on_progress,
                )
            if table.crashed:
                raise ResultsError(
                    f"{table.crashed} grasp(s) were lost because worker processes died: run the command again, it does "
                    "only what is missing"
                )
            sim = [row.success for row in table.rows[-len(found) :]]
            made = {"figure": experiment.name, "curve": curve.name, "protocol": protocol.name, "network": curve.start}
            _keep(output / RESULTS_FILE, _points(history, found, iou, sim, conditions, made))
    return read_points(output / RESULTS_FILE)


def _directory(work: Path, curve: Curve, protocol: Protocol) -> Path:
    return work / "searches" / f"{curve.slug}-{protocol.name.lower()}"


def _search(
    curve: Curve,
    conditions: Conditions,
    protocol: Protocol,
    directory: Path,
    workers: Workers,
    command: str,
    on_event: OnEvent,
) -> SearchHistory:
    """Start a search, or go on with it, and write its report."""
    from ggcnn_net2net.search import resume_search, start_search
    from ggcnn_net2net.search.report import write_report

    model, settings = _prepare(curve, conditions, protocol, directory, workers)
    if _is_begun(directory):
        history = resume_search(directory, workers, on_event=on_event)
    else:
        history = start_search(
            model,
            conditions.data,
            settings,
            directory,
            workers,
            name=curve.start,
            command=command,
            reuse=list(_searches_beside(directory)),
            on_event=on_event,
        )
    write_report(history, directory / "report")
    return history


def _prepare(
    curve: Curve, conditions: Conditions, protocol: Protocol, directory: Path, workers: Workers
) -> tuple[keras.Model, SearchSettings]:
    """Network and settings of a search that can begin, or go on as it was begun; everything else is refused."""
    from ggcnn_net2net.search import load_history
    from ggcnn_net2net.search.run import check_search

    model = _start_of(curve)
    # A process cannot change its number of threads, and may train candidates of several curves.
    usual = max(1, (os.cpu_count() or 1) // max(1, workers.count))  # a cluster may have none yet
    threads = next((other.settings.threads for other in _searches_beside(directory).values()), usual)
    settings = curve.settings(
        conditions.budget, protocol, conditions.seed, threads, conditions.max_parameters, conditions.learning_rate
    )
    if _is_begun(directory):
        _check_same(load_history(directory), settings, model, conditions.data, directory)
    else:
        check_search(model, conditions.data, settings)
    return model, settings


def _is_begun(directory: Path) -> bool:
    from ggcnn_net2net.search.journal import JOURNAL_FILE, read_events

    return bool(read_events(directory / JOURNAL_FILE))


def _searches_beside(directory: Path) -> dict[Path, SearchHistory]:
    """Other searches in the folder that holds `directory`, by their folders; what cannot be read is passed over."""
    from ggcnn_net2net.search import load_history
    from ggcnn_net2net.search.journal import JOURNAL_FILE

    found = {}
    for journal in sorted(directory.parent.glob(f"*/{JOURNAL_FILE}")):
        if journal.parent != directory:
            with suppress(SearchError):  # one that could not begin, or of another version
                found[journal.parent] = load_history(journal.parent)
    return found


def _start_of(curve: Curve) -> keras.Model:
    """The network that a search starts from."""
    from ggcnn_net2net.reproduce.networks import load_networks

    (network,) = load_networks([curve.network])
    if network.model is None or network.stand_in:
        raise ResultsError(
            f"expected the network {curve.network}, from which the curve {curve.name} starts: {network.note}; name the "
            "one that you mean, such as zoo:original_retrained"
        )
    return network.model


def _check_same(
    begun: SearchHistory, settings: SearchSettings, model: keras.Model, data: Path, directory: Path
) -> None:
    """Refuse to go on with a search of another kind. The number of threads may differ: it stays what it was."""
    from ggcnn_net2net.datasets.hdf5 import fingerprints_of
    from ggcnn_net2net.search.candidates import root_candidate
    from ggcnn_net2net.training.checkpoint import fingerprint_of

    images = fingerprints_of(data)
    same = {
        "settings": replace(begun.settings, threads=settings.threads) == settings,
        "network or train images": begun.root == root_candidate(fingerprint_of(model), images["train"]).key,
        "test images": begun.data["test"] == images["test"],
    }
    others = [name for name, is_same in same.items() if not is_same]
    if others:
        raise ResultsError(
            f"expected to go on with the search in {directory} as it was begun, received other {' and '.join(others)}: "
            "choose another --output"
        )


def _networks_of(curve: Curve, history: SearchHistory, directory: Path) -> list[Network]:
    """The networks that the search committed to, from the root on."""
    from ggcnn_net2net.model_files import load_ggcnn
    from ggcnn_net2net.reference_data import sha256_of
    from ggcnn_net2net.reproduce.networks import Network
    from ggcnn_net2net.search.trainer import model_file

    found = []
    for candidate, _ in history.path:
        path = model_file(directory, candidate.key)
        model = load_ggcnn(path)
        name = f"{curve.name}, {candidate.depth}"
        file = str(path.relative_to(directory))
        found.append(Network(name, candidate.architecture, model.count_params(), file, sha256_of(path), model))
    return found


def _iou_rates(
    networks: Sequence[Network],
    directory: Path,
    data: Path,
    protocol: Protocol,
    threads: int,
    workers: Workers,
    known_file: Path,
    on_progress: Progress,
) -> list[Rate]:
    """IoU rates over all test images, a network a worker; those that `known_file` holds are not computed again."""
    from ggcnn_net2net.datasets.hdf5 import GraspDataset

    images = GraspDataset(data, "test").fingerprint
    conditions = json.dumps([protocol.as_dict(), versions()], sort_keys=True)
    made_with = hashlib.sha256(conditions.encode()).hexdigest()[:16]
    known = _known_rates(known_file)
    keys = [f"{network.sha256} {images} {protocol.name} {made_with}" for network in networks]
    missing = {key: directory / network.file for key, network in zip(keys, networks, strict=True) if key not in known}
    inputs = [(path.absolute(), data.absolute(), protocol, threads) for path in missing.values()]
    on_progress("IoU rate", 0, len(missing))
    for done, (index, counts) in enumerate(workers.run(_iou_counts, inputs), start=1):
        if isinstance(counts, Crash):
            raise ResultsError(
                f"an IoU rate was lost because worker processes died {counts.attempts} times: is memory short? Run the "
                "command again, it does only what is missing"
            )
        known[list(missing)[index]] = counts
        write_text(known_file, json.dumps(known, indent=1) + "\n")
        on_progress("IoU rate", done, len(missing))
    return [Rate(*known[key]) for key in keys]


def _known_rates(file: Path) -> dict[str, list[int]]:
    """Successes and images by network and conditions, as far as they have been counted."""
    if not file.is_file():
        return {}
    try:
        return {str(key): [int(count) for count in counts] for key, counts in json.loads(file.read_bytes()).items()}
    except (ValueError, TypeError, AttributeError) as error:
        raise ResultsError(f"cannot read {file}: {error!r}; remove it, and its rates are counted again") from error


def _iou_counts(path: Path, data: Path, protocol: Protocol, threads: int) -> list[int]:
    """In a worker: successes and images of the test split."""
    from ggcnn_net2net.datasets.hdf5 import GraspDataset
    from ggcnn_net2net.inference.iou_rate import iou_rate_of
    from ggcnn_net2net.model_files import load_ggcnn
    from ggcnn_net2net.quiet import import_tensorflow
    from ggcnn_net2net.training import set_threads

    import_tensorflow()
    set_threads(threads)
    rate = iou_rate_of(load_ggcnn(path), GraspDataset(data, "test"), protocol)
    return [rate.successes, rate.total]


def _points(
    history: SearchHistory,
    networks: Sequence[Network],
    iou: Sequence[Rate],
    sim: Sequence[Rate],
    conditions: Conditions,
    made: dict[str, Any],
) -> Iterator[CurvePoint]:
    """Three points for each network of the path; `made` says of which curve they are."""
    images = f"{conditions.data.name} ({history.data['test'][:8]})"
    before = 0
    for (candidate, score), network, iou_rate, sim_rate in zip(history.path, networks, iou, sim, strict=True):
        facts = {
            **made,
            "seed": conditions.seed,
            "budget": conditions.effort,
            "depth": candidate.depth,
            "parameters": network.parameters,
            "architecture": network.architecture,
            "operation": ", ".join(candidate.operations[before:]) or candidate.operation,
        }
        before = len(candidate.operations)
        yield CurvePoint(**facts, metric=SCORE, value=score, successes=None, trials=None, objects=images)
        yield _counted(facts, IOU, iou_rate, images)
        yield _counted(facts, SIM, sim_rate, f"{conditions.objects}, {conditions.poses} pose(s) each")


def _counted(facts: dict[str, Any], metric: str, rate: Rate, objects: str) -> CurvePoint:
    return CurvePoint(
        **facts, metric=metric, value=rate.value, successes=rate.successes, trials=rate.trials, objects=objects
    )


def _keep(path: Path, points: Iterator[CurvePoint]) -> None:
    """Put the points of a curve into the results, instead of earlier ones of the same curve."""
    new = list(points)
    replaced = {(point.curve, point.protocol) for point in new}
    old = read_points(path) if path.is_file() else []
    write_points(path, [*(point for point in old if (point.curve, point.protocol) not in replaced), *new])
