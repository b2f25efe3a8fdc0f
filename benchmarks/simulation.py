"""Speed and memory of the simulated benchmark with 1 and 2 workers, interleaved in one run.

    python benchmarks/simulation.py --grasps 40 --rounds 3

Every round runs the same trials with each number of workers; scenes are made before. Prints the seconds of each round,
the ratio of the medians, and the peak memory of a worker.
"""

from __future__ import annotations

import resource
import statistics
import tempfile
import time
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from ggcnn_net2net.grasping import Grasp
from ggcnn_net2net.parallel import LocalWorkers
from ggcnn_net2net.protocol import PAPER
from ggcnn_net2net.simulation.benchmark import prepare_scenes, run_trials
from ggcnn_net2net.simulation.object_sets import load_object_set
from ggcnn_net2net.simulation.scenes import Scene, SceneSettings


def middle_grasp(scene: Scene) -> Grasp:
    """A grasp at the object's centre: no network is needed to time the simulation."""
    row, col, _ = scene.camera.pixel_from_world(scene.position)
    return Grasp(round(row), round(col), 0.3, 50)


@click.command()
@click.option("--objects", default="procedural40", show_default=True)
@click.option("--grasps", default=40, show_default=True, help="Trials a round.")
@click.option("--rounds", default=3, show_default=True)
def main(objects: str, grasps: int, rounds: int) -> None:
    """Time trials with 1 and 2 workers."""
    object_set = load_object_set(objects)
    settings = SceneSettings.of(object_set, -(-grasps // len(object_set.objects)), seed=0)
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        with LocalWorkers(2) as pool:
            scenes = prepare_scenes(Path(folder) / "scenes.h5", object_set, settings, pool)[:grasps]
        scene_seconds = time.perf_counter() - started
    chosen = [middle_grasp(scene) for scene in scenes]
    seconds: dict[int, list[float]] = {1: [], 2: []}
    steps = 0
    for _ in range(rounds):
        for workers, times in seconds.items():
            started = time.perf_counter()
            with LocalWorkers(workers) as pool:
                results = dict(run_trials(scenes, chosen, PAPER, pool))
            times.append(time.perf_counter() - started)
            steps = sum(result.steps for result in results.values())
    table = Table("workers", "seconds a round", "median", "grasps a second", title=f"{grasps} grasps on {objects}")
    for workers, times in seconds.items():
        median = statistics.median(times)
        table.add_row(
            str(workers), " ".join(f"{value:.1f}" for value in times), f"{median:.1f}", f"{grasps / median:.2f}"
        )
    Console().print(table)
    ratio = statistics.median(seconds[1]) / statistics.median(seconds[2])
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(f"2 workers are {ratio:.2f}x faster than 1 (goal: 1.4x)")
    print(f"{steps / grasps:.0f} physics steps a grasp; peak memory of a worker {peak:.0f} MiB (goal: below 2048)")
    print(f"{len(scenes)} scenes made in {scene_seconds:.1f} s with 2 workers")


if __name__ == "__main__":
    main()
