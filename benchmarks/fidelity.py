"""Effect of each choice of `Protocol` on the simulated benchmark: PAPER with one field at a time as in CORRECTED.

    python benchmarks/fidelity.py --objects procedural40 --output results/fidelity

Prints a row a variant: success of the published network, and McNemar's exact test against PAPER on the same grasps.
Variants that move an object's centre have scenes of their own and are compared by their rates alone.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from ggcnn_net2net.cli.options import OBJECTS, SEED, WORKERS
from ggcnn_net2net.parallel import LocalWorkers
from ggcnn_net2net.protocol import CORRECTED, PAPER, Protocol
from ggcnn_net2net.quiet import import_tensorflow
from ggcnn_net2net.reproduce.networks import load_networks
from ggcnn_net2net.reproduce.records import RecordFile
from ggcnn_net2net.reproduce.statistics import PairedComparison
from ggcnn_net2net.reproduce.table1 import run_table1
from ggcnn_net2net.simulation.object_sets import load_object_set

SIMULATED = (
    "sim_angle_window",
    "object_centre",
    "coupled_jaws",
    "solver_iterations",
    "palm_clearance",
    "fingertip_clearance",
)
"""Fields that act in the simulator."""


def variants() -> list[Protocol]:
    """PAPER, PAPER with one simulated field of CORRECTED, CORRECTED."""
    corrected = asdict(CORRECTED)
    single = [
        replace(PAPER, name=f"PAPER, {field}={corrected[field]}", **{field: corrected[field]}) for field in SIMULATED
    ]
    return [PAPER, *single, CORRECTED]


@click.command()
@OBJECTS
@SEED
@WORKERS
@click.option("--poses", default=5, show_default=True, type=click.IntRange(min=1))
@click.option(
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Folder for the results.",
)
def main(objects_spec: str, seed: int, workers: int, poses: int, output: Path) -> None:
    """Measure what each published choice costs."""
    import_tensorflow()
    networks = load_networks(["original"])
    table = Table(title=f"Published network on {objects_spec}, {poses} poses, seed {seed}")
    for heading in ("protocol", "success", "rate (95% interval)", "p against PAPER"):
        table.add_column(heading)
    reference: list[bool] = []
    for index, protocol in enumerate(variants()):
        folder = output / f"{objects_spec}-{index}"
        objects = load_object_set(objects_spec, protocol)
        with LocalWorkers(workers) as pool:
            result = run_table1(networks, objects, folder, poses=poses, seed=seed, protocol=protocol, workers=pool)
        rate = result.rows[0].success
        success = [record.success for record in RecordFile(folder / "grasps.csv").read()]
        reference = reference or success
        same_scenes = protocol.object_centre == PAPER.object_centre
        p_value = f"{PairedComparison.of(reference, success).p_value:.3f}" if same_scenes and index else "-"
        low, high = rate.interval
        table.add_row(
            protocol.name,
            f"{rate.successes}/{rate.trials}",
            f"{rate.value:.3f} ({low:.3f}-{high:.3f})",
            p_value,
        )
    Console().print(table)


if __name__ == "__main__":
    main()
