"""How good the labels of simulated scenes are: random labels, executed under the benchmark's full protocol.

Example: python benchmarks/label_quality.py --labels 200 --tried-labels
"""

from __future__ import annotations

import argparse
import os
import time
from collections import Counter

import numpy as np

from ggcnn_net2net.datasets.simulated import Simulation, simulate_scene
from ggcnn_net2net.grasping import rectangle_to_grasp
from ggcnn_net2net.parallel import run_parallel
from ggcnn_net2net.protocol import protocol_named
from ggcnn_net2net.reproduce.statistics import Rate
from ggcnn_net2net.simulation.trial import run_trial
from ggcnn_net2net.simulation.world import process_world


def try_label(index: int, settings: Simulation, protocols: list[str]) -> tuple[str, int, float, bool, list[str]]:
    """Make a scene and execute one random label: object, labels, seconds of making, tried, one outcome a protocol."""
    begin = time.perf_counter()
    made = simulate_scene(process_world(), index, settings)
    seconds = time.perf_counter() - begin
    chosen = np.random.default_rng([settings.seed, index, 1]).integers(len(made.rectangles))
    grasp, _ = rectangle_to_grasp(made.rectangles[chosen])
    outcomes = [str(run_trial(process_world(), made.scene, grasp, protocol_named(name)).outcome) for name in protocols]
    return made.scene.model.name, len(made.rectangles), seconds, made.tried, outcomes


def main() -> None:
    """Print success rates and outcomes by protocol, and by family of objects."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--labels", type=int, default=200, help="one of each scene")
    parser.add_argument("--seed", type=int, default=0, help="of the scenes")
    parser.add_argument("--tried-labels", action="store_true", help="as of `dataset simulate`")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--protocols", nargs="+", default=["paper", "corrected"])
    arguments = parser.parse_args()

    settings = Simulation(seed=arguments.seed, tried_labels=arguments.tried_labels)
    inputs = ((index, settings, arguments.protocols) for index in range(arguments.labels))
    rows = [row for _, row in run_parallel(try_label, inputs, arguments.workers)]
    labels, seconds = np.array([row[1] for row in rows]), np.array([row[2] for row in rows])
    print(f"{len(rows)} scenes, seed {arguments.seed}: {labels.mean():.0f} labels each, median {np.median(labels):.0f}")
    print(f"{seconds.mean():.2f} s to make a scene, with {arguments.workers} workers")
    for position, name in enumerate(arguments.protocols):
        outcomes = Counter(row[4][position] for row in rows)
        rate = Rate(outcomes["success"], len(rows))
        low, high = rate.interval
        print(f"{name}: {rate.successes}/{rate.trials} = {rate.value:.3f} ({low:.3f}-{high:.3f})")
        print(f"  {dict(outcomes.most_common())}")
        for tried, kind in ((False, "sure labels"), (True, "tried labels")):
            of_kind = [row[4][position] == "success" for row in rows if row[3] == tried]
            print(f"  {kind}: {sum(of_kind)}/{len(of_kind)}")
        failed = Counter(row[0].rsplit("_", 1)[0] for row in rows if row[4][position] != "success")
        of_each = Counter(row[0].rsplit("_", 1)[0] for row in rows)
        print(
            "  failures: " + ", ".join(f"{family} {count}/{of_each[family]}" for family, count in failed.most_common())
        )


if __name__ == "__main__":
    main()
