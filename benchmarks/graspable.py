"""What can be grasped at all: grasps by the objects' true geometry, executed until one succeeds.

    python benchmarks/graspable.py --objects procedural40

The scenes are those of `reproduce table1`. On each, grasps that the gripper's shape and the object's allow are executed
under the benchmark's full protocol, in random order, those of the strict rule first: up to `--tries`, or until one
succeeds. Scenes on which none does bound what a network could reach from above, though not strictly: another grasp, or
more tries, might. A network sees depth alone and has one try, so it will reach less.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from ggcnn_net2net.cli.options import OBJECTS, PROTOCOL, SEED, WORKERS
from ggcnn_net2net.datasets.simulated_labels import candidate_grasps, target_of
from ggcnn_net2net.parallel import Crash, LocalWorkers
from ggcnn_net2net.protocol import Protocol, protocol_named
from ggcnn_net2net.reproduce.statistics import Rate
from ggcnn_net2net.simulation import PAPER_GRIPPER
from ggcnn_net2net.simulation.antipodal import LOOSE_RULE, AntipodalRule
from ggcnn_net2net.simulation.object_sets import ObjectModel, load_object_set
from ggcnn_net2net.simulation.scenes import Scene, make_scene
from ggcnn_net2net.simulation.trial import WorldGrasp, run_world_grasp
from ggcnn_net2net.simulation.world import World, process_world


def grasps_by_geometry(world: World, scene: Scene, tries: int, rng: np.random.Generator) -> Iterator[WorldGrasp]:
    """Up to `tries` grasps, those of the strict rule before those of the loose one."""
    left = tries
    for rule in (AntipodalRule(), LOOSE_RULE):
        if not left:
            return
        world.reset()
        body = world.add_object(scene.model, scene.position, scene.orientation)
        found = candidate_grasps(world, body, scene, rule, PAPER_GRIPPER).grasps
        for index in rng.permutation(len(found))[:left]:
            yield target_of(found, int(index))
            left -= 1


def tries_until_success(
    model: ObjectModel, pose: int, seed: int, protocol: Protocol, tries: int
) -> tuple[str, int, int]:
    """In a worker: the object, how many grasps were executed, and which of them succeeded, from 1; 0 for none."""
    world = process_world()
    scene = make_scene(world, model, pose, seed)
    executed = 0
    if scene.stable:
        for executed, grasp in enumerate(grasps_by_geometry(world, scene, tries, np.random.default_rng(seed)), start=1):
            if run_world_grasp(world, scene, grasp, protocol).success:
                return model.name, executed, executed
    return model.name, executed, 0


@click.command()
@OBJECTS
@click.option("--poses", default=5, show_default=True, type=click.IntRange(min=1), help="Of each object.")
@click.option("--tries", default=20, show_default=True, type=click.IntRange(min=1), help="Most grasps of a scene.")
@SEED
@PROTOCOL
@WORKERS
def main(objects_spec: str, poses: int, tries: int, seed: int, protocol_name: str, workers: int) -> None:
    """Count the scenes of an object set on which any grasp succeeds, and those on which the first one does."""
    protocol = protocol_named(protocol_name)
    objects = load_object_set(objects_spec, protocol)
    inputs = [(model, pose, seed, protocol, tries) for model in objects.objects for pose in range(poses)]
    with LocalWorkers(workers) as pool:
        done = list(track(pool.run(tries_until_success, inputs), "scenes", total=len(inputs)))
    outcomes = [(inputs[index][0].name, 0, 0) if isinstance(outcome, Crash) else outcome for index, outcome in done]
    table = Table("within", "success", "rate (95% interval)", title=f"{objects_spec}, {protocol.name}, seed {seed}")
    for most in sorted({1, min(2, tries), min(5, tries), tries}):
        rate = Rate(sum(0 < succeeded <= most for _, _, succeeded in outcomes), len(outcomes))
        low, high = rate.interval
        name = f"{most} grasp{'s' if most > 1 else ''}"
        table.add_row(name, f"{rate.successes}/{rate.trials}", f"{rate.value:.3f} ({low:.3f}-{high:.3f})")
    console = Console()
    console.print(table)
    never = Counter(name for name, _, succeeded in outcomes if not succeeded)
    of_each = ", ".join(f"{name} {count}/{poses}" for name, count in never.most_common())
    console.print(f"none succeeded: {of_each or '-'}")
    console.print(f"{sum(executed for _, executed, _ in outcomes)} grasps executed")


if __name__ == "__main__":
    main()
