"""`ggcnn-net2net reproduce ...`: the paper's tables and figures."""

from __future__ import annotations

from pathlib import Path

import click

from ggcnn_net2net.cli.figures import epochs, everything, fig1, fig2, fig3
from ggcnn_net2net.cli.options import GRIPPER, OBJECTS, PROTOCOL, SEED, WORKERS, command_line, gripper_of

CRASHED = 3
"""Exit code of a run that ended, but lost grasps to worker processes that died."""


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def reproduce() -> None:
    """Make the paper's tables and figures again.

    Example: python -m ggcnn_net2net.reproduce table1
    """


@reproduce.command(short_help="Table I: success of networks that grasp 40 objects.")
@OBJECTS
@click.option("--poses", default=5, show_default=True, type=click.IntRange(min=1), help="Poses of each object.")
@SEED
@WORKERS
@click.option(
    "--models",
    metavar="NAMES",
    help="Networks of the table, separated by commas: original (the published one), control, extended, optimized, "
    "searched_extended, searched_small, others of the zoo as zoo:NAME, or paths of your own model files. [default: "
    "these six, but control and the searched ones only if the zoo has them]",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder of the results. A second run with the same folder does only what is missing. "
    "[default: results/table1-SET-POSESposes-seedSEED-PROTOCOL, with -FILE for a gripper of its own]",
)
@PROTOCOL
@GRIPPER
def table1(
    objects_spec: str,
    poses: int,
    seed: int,
    workers: int,
    models: str | None,
    output: Path | None,
    protocol_name: str,
    gripper_file: Path | None,
) -> int:
    """Table I: success of networks that grasp 40 objects in 5 poses each, in simulation.

    \b
    Examples:
      python -m ggcnn_net2net.reproduce table1
      python -m ggcnn_net2net.reproduce table1 --poses 25   (1,000 grasps per network: what 200 cannot tell apart)
      python -m ggcnn_net2net.reproduce table1 --objects ycb40 --models original,my_network.hdf5
      python -m ggcnn_net2net.reproduce table1 --objects ycb40 --gripper my_gripper.toml

    Exit codes: 0 done, 1 an error that is explained, 2 wrong usage, 3 done but grasps were lost to worker processes
    that died (run it again), 130 interrupted (run it again).
    """
    from rich.console import Console  # --help must not wait for any of these

    from ggcnn_net2net.cli.progress import stages
    from ggcnn_net2net.parallel import LocalWorkers
    from ggcnn_net2net.protocol import protocol_named
    from ggcnn_net2net.quiet import import_tensorflow
    from ggcnn_net2net.reproduce.networks import default_rows, load_networks
    from ggcnn_net2net.reproduce.report import print_table
    from ggcnn_net2net.reproduce.table1 import run_table1
    from ggcnn_net2net.simulation.object_sets import load_object_set

    gripper = gripper_of(gripper_file)
    import_tensorflow()
    protocol = protocol_named(protocol_name)
    networks = load_networks(default_rows() if models is None else (name.strip() for name in models.split(",")))
    objects = load_object_set(objects_spec, protocol)
    if output is None:
        name = f"table1-{objects.name.replace(':', '-')}-{poses}poses-seed{seed}-{protocol.name.lower()}"
        output = Path("results") / (f"{name}-{gripper_file.stem}" if gripper_file else name)
    console = Console()
    with LocalWorkers(workers) as pool, stages(console) as progress:
        table = run_table1(
            networks,
            objects,
            output,
            poses=poses,
            seed=seed,
            protocol=protocol,
            gripper=gripper,
            workers=pool,
            command=command_line(),
            on_progress=progress,
        )
    print_table(console, table)
    console.print(
        f"Written to {output}: results.json, grasps.csv, table1.md, table1.png, scenes.h5", markup=False, soft_wrap=True
    )
    return CRASHED if table.crashed else 0


for command in (fig1, fig2, fig3, epochs, everything):
    reproduce.add_command(command)
