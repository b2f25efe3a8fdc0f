"""Table I: success of GG-CNNs in the simulated benchmark, beside the paper's figures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path

from ggcnn_net2net.atomic import alone
from ggcnn_net2net.errors import ResultsError
from ggcnn_net2net.grasping import Grasp
from ggcnn_net2net.inference.predict import each_grasp
from ggcnn_net2net.parallel import LocalWorkers, Workers
from ggcnn_net2net.protocol import PAPER, Protocol
from ggcnn_net2net.reproduce.networks import Network
from ggcnn_net2net.reproduce.records import GraspRecord, RecordFile
from ggcnn_net2net.reproduce.report import write_chart, write_markdown
from ggcnn_net2net.reproduce.results import Table1, check_settings, settings_of, summarise, write_results
from ggcnn_net2net.simulation import PAPER_GRIPPER, GripperSpec
from ggcnn_net2net.simulation.benchmark import prepare_scenes, run_trials
from ggcnn_net2net.simulation.object_sets import ObjectSet
from ggcnn_net2net.simulation.scenes import Scene, SceneSettings, depth_images
from ggcnn_net2net.simulation.trial import Outcome, decoding_of

Progress = Callable[[str, int, int], None]
"""Called with the name of a stage, the number of items done and their total."""


def run_table1(
    networks: Sequence[Network],
    objects: ObjectSet,
    output: Path,
    *,
    poses: int = 5,
    seed: int = 0,
    protocol: Protocol = PAPER,
    gripper: GripperSpec = PAPER_GRIPPER,
    workers: Workers | None = None,
    command: str = "",
    on_progress: Progress = lambda *_: None,
) -> Table1:
    """Judge networks on the same scenes and write the results.

    Grasps that `output` already holds are not run again, so an interrupted run goes on where it stopped, and a network
    can be added to a finished table.

    Args:
        networks: rows of the table; those without weights stay empty.
        objects: what is grasped.
        output: folder for results.json, grasps.csv (one row per grasp), table1.md, table1.png and scenes.h5.
        poses: random poses of each object.
        seed: of the scenes.
        protocol: see `Protocol`.
        gripper: what grasps; the paper's by default. Scenes do not depend on it.
        workers: run the simulation; a single process by default.
        command: how the user started it, for the record.
        on_progress: told about every scene and grasp.

    Returns:
        The table. Where worker processes died, `Table1.crashed` trials are missing; running again repeats them.

    Raises:
        ResultsError: `output` holds results of another experiment, or another process writes to it.
        SceneError: `output` holds other scenes.
    """
    refusal = ResultsError(
        f"expected {output} to be free, another process writes results there: wait for it, or choose another --output"
    )
    with (
        alone(output / "grasps.lock", refusal),
        nullcontext(workers) if workers is not None else LocalWorkers(1) as pool,
    ):
        scene_settings = SceneSettings.of(objects, poses, seed)
        settings = settings_of(scene_settings, protocol, gripper)
        results_file, records_file = output / "results.json", RecordFile(output / "grasps.csv")
        check_settings(results_file, settings)
        records = {record.key: record for record in records_file.read() if record.outcome != Outcome.CRASHED}
        table = summarise(networks, records.values(), scene_settings, protocol, gripper)
        write_results(results_file, table, settings, command, finished=False)
        records_file.rewrite(records.values())

        places = [(model, pose) for model in objects.objects for pose in range(poses)]
        scenes = prepare_scenes(
            output / "scenes.h5",
            objects,
            scene_settings,
            pool,
            lambda done: on_progress("scenes", done, len(places)),
        )
        judged = [network for network in networks if network.model is not None]
        taken = set(records)
        missing: list[tuple[Network, list[Scene]]] = []
        for network in judged:
            keys = {(network.weights, scene.model.name, scene.pose): scene for scene in scenes}
            missing.append((network, [scene for key, scene in keys.items() if key not in taken]))
            taken |= keys.keys()
        done = {network.name: len(scenes) - len(own) for network, own in missing}

        def show(name: str) -> None:
            on_progress(name, done[name], len(places))

        for record in _judge(missing, protocol, pool, gripper, show):
            records[record.key] = record
            records_file.append(record)
            done[record.model] += 1
            show(record.model)
        # What is missing still has no scene, because workers died making it.
        for network in judged:
            for model, pose in places:
                lost = GraspRecord.lost(network.name, network.weights, model, pose)
                records.setdefault(lost.key, lost)

        place_of = {(model.name, pose): place for place, (model, pose) in enumerate(places)}
        ordered = sorted(records.values(), key=lambda record: (record.model, place_of[record.object, record.pose]))
        table = summarise(networks, ordered, scene_settings, protocol, gripper)
        records_file.rewrite(ordered)
        write_results(results_file, table, settings, command, finished=table.crashed == 0)
        write_markdown(output / "table1.md", table, command, settings["versions"])
        write_chart(output / "table1.png", table)
        return table


def _judge(
    missing: Sequence[tuple[Network, Sequence[Scene]]],
    protocol: Protocol,
    workers: Workers,
    gripper: GripperSpec,
    on_begin: Callable[[str], None],
) -> Iterator[GraspRecord]:
    """Predict a grasp for every scene of every network and execute it.

    While the workers of this machine execute some, the next are predicted, also those of the next network.

    Args:
        missing: networks and their scenes.
        protocol: see `Protocol`.
        workers: run the simulation.
        gripper: what grasps.
        on_begin: called with the name of each network.

    Yields:
        A record of each trial, as they come.
    """
    trials = [(network, scene) for network, scenes in missing for scene in scenes]
    grasps: list[Grasp | None] = []

    def predicted() -> Iterator[Grasp | None]:
        for network, scenes in missing:
            on_begin(network.name)
            if not scenes:
                continue  # nothing to compile it for
            for grasp in each_grasp(network.model, depth_images(scenes), decoding_of(protocol)):
                grasps.append(grasp)
                yield grasp

    for index, result in run_trials([scene for _, scene in trials], predicted(), protocol, workers, gripper):
        network, scene = trials[index]
        yield GraspRecord.of(network.name, network.weights, scene.model, scene.pose, grasps[index], result)
