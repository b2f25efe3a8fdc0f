"""`ggcnn-net2net zoo ...`: the networks that this project trained."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

FILE = click.Path(path_type=Path, exists=True, dir_okay=False)
FOLDER = click.Path(path_type=Path, exists=True, file_okay=False)


@click.group("zoo")
def zoo_command() -> None:
    """Networks that this project trained, with what made them. Commands open them as zoo:NAME.

    \b
    Example: ggcnn-net2net zoo list
    """


@zoo_command.command("list")
def list_command() -> None:
    """All networks: size, success in simulation (SIM) on object sets, IoU rate on datasets.

    \b
    Example: ggcnn-net2net zoo list
    """
    from itertools import zip_longest

    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    from ggcnn_net2net import zoo

    table = Table(
        "network",
        "measured on",
        "protocol",
        "rate (95% interval)",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
        show_edge=False,
    )
    for name in zoo.names():
        facts = zoo.provenance(name)
        rows = [
            (f"SIM {one['objects']}", one["protocol"], _rate(one["success"], "trials")) for one in facts.get("sim", [])
        ]
        rows += [
            (f"IoU {one['dataset']['file']}", one["protocol"], _rate(one, "images")) for one in facts.get("iou", [])
        ]
        about = (name, f"{facts['parameters']:,} parameters")
        for left, row in zip_longest(about, rows):
            table.add_row(left, *(row or ()))
    Console().print(table)


@zoo_command.command()
@click.argument("name")
def show(name: str) -> None:
    """What made the network NAME, and what was measured of it, as JSON.

    \b
    Example: ggcnn-net2net zoo show extended
    """
    import json

    from ggcnn_net2net import zoo

    click.echo(json.dumps(zoo.provenance(name), indent=2))


@zoo_command.command()
@click.argument("model_file", type=FILE)
@click.argument("name")
@click.option("--provenance", type=FILE, help="What made it. [default: the .json beside the model file]")
@click.option("--results", multiple=True, type=FOLDER, help="Folder of `reproduce table1`; may be repeated.")
@click.option("--iou", multiple=True, type=FILE, help="File of `evaluate iou -o`; may be repeated.")
@click.option("--search", type=FOLDER, help="Folder of the search that found it.")
def add(
    model_file: Path,
    name: str,
    provenance: Path | None,
    results: tuple[Path, ...],
    iou: tuple[Path, ...],
    search: Path | None,
) -> None:
    """Put MODEL_FILE into the zoo of this installation as NAME, with what was measured of it.

    \b
    Example: ggcnn-net2net zoo add extended.hdf5 extended --results results/pybullet --iou iou.json
    """
    from ggcnn_net2net import zoo
    from ggcnn_net2net.architecture import architecture_of
    from ggcnn_net2net.model_files import load_ggcnn
    from ggcnn_net2net.quiet import import_tensorflow
    from ggcnn_net2net.reference_data import sha256_of

    facts = zoo.read_provenance(provenance or model_file.with_suffix(".json"))
    facts |= zoo.measured(sha256_of(model_file), results, iou)
    import_tensorflow()
    if search is not None:
        facts["search"] = zoo.searched(search, str(architecture_of(load_ggcnn(model_file))))
    click.echo(f"written to {zoo.add(model_file, facts, name)}")


def _rate(rate: dict[str, Any], total: str) -> str:
    low, high = rate["wilson_95"]
    return f"{rate['successes']}/{rate[total]} = {rate['rate']:.3f} ({low:.3f}-{high:.3f})"
