"""Are a network's openings too narrow? Its grasps executed as they are, and with wider openings.

    python benchmarks/openings.py --network zoo:extended --objects procedural40

The scenes and grasps are those of `reproduce table1`; only the opening differs. Where a wider one helps much, labels or
loss make openings too narrow; where it does not, failures have other reasons.
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from ggcnn_net2net.cli.options import OBJECTS, PROTOCOL, SEED, WORKERS
from ggcnn_net2net.grasping import Grasp
from ggcnn_net2net.inference.predict import predict_grasps
from ggcnn_net2net.model_files import load_ggcnn
from ggcnn_net2net.parallel import LocalWorkers
from ggcnn_net2net.protocol import protocol_named
from ggcnn_net2net.reproduce.statistics import Rate
from ggcnn_net2net.simulation.benchmark import prepare_scenes, run_trials
from ggcnn_net2net.simulation.object_sets import load_object_set
from ggcnn_net2net.simulation.scenes import SceneSettings, depth_images
from ggcnn_net2net.simulation.trial import decoding_of


def widened(grasp: Grasp | None, by: float, least: float) -> Grasp | None:
    """A grasp with an opening that is `by` pixels wider and at least `least` pixels wide."""
    return grasp and replace(grasp, width_px=max(grasp.width_px + by, least))


@click.command()
@click.option("--network", "network_spec", default="published", show_default=True, help="A file, published, zoo:NAME.")
@OBJECTS
@click.option("--poses", default=5, show_default=True, type=click.IntRange(min=1), help="Of each object.")
@click.option("--wider", default=12.0, show_default=True, type=click.FloatRange(min=0), help="Pixels added.")
@click.option("--least", default=200.0, show_default=True, type=click.FloatRange(min=0), help="Pixels at least.")
@SEED
@PROTOCOL
@WORKERS
def main(
    network_spec: str,
    objects_spec: str,
    poses: int,
    wider: float,
    least: float,
    seed: int,
    protocol_name: str,
    workers: int,
) -> None:
    """Count the successes of a network with its own and with wider openings."""
    protocol = protocol_named(protocol_name)
    objects = load_object_set(objects_spec, protocol)
    network = load_ggcnn(network_spec)
    table = Table(
        "openings", "success", "rate (95% interval)", title=f"{network_spec}, {objects_spec}, {protocol.name}"
    )
    with LocalWorkers(workers) as pool, tempfile.TemporaryDirectory() as folder:
        scenes = prepare_scenes(Path(folder) / "scenes.h5", objects, SceneSettings.of(objects, poses, seed), pool)
        grasps = predict_grasps(network, depth_images(scenes), decoding_of(protocol))
        for name, by, at_least in (
            ("the network's", 0.0, 0.0),
            (f"{wider:g} px wider", wider, 0.0),
            (f"{least:g} px or more", 0.0, least),
        ):
            changed = [widened(grasp, by, at_least) for grasp in grasps]
            results = [result for _, result in run_trials(scenes, changed, protocol, pool)]
            rate = Rate(sum(result.success for result in results), len(results))
            low, high = rate.interval
            table.add_row(name, f"{rate.successes}/{rate.trials}", f"{rate.value:.3f} ({low:.3f}-{high:.3f})")
    Console().print(table)


if __name__ == "__main__":
    main()
