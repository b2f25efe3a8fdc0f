"""`ggcnn-net2net objects`: what an object set holds."""

from __future__ import annotations

from pathlib import Path

import click

from ggcnn_net2net.cli.options import PROTOCOL, Picture


@click.command()
@click.argument("objects_spec", metavar="SET", default="procedural40")
@click.option("--sheet", type=Picture(), help="Write a contact sheet.")
@PROTOCOL
def objects(objects_spec: str, sheet: Path | None, protocol_name: str) -> None:
    """List the objects of SET.

    SET is procedural40, pybullet, ycb40, shapenetsem:FOLDER, training:NUMBER, or a folder of meshes.

    \b
    Example: ggcnn-net2net objects procedural40 --sheet objects.png
    """
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from ggcnn_net2net.protocol import protocol_named
    from ggcnn_net2net.simulation.meshes import read_parts
    from ggcnn_net2net.simulation.object_sets import load_object_set

    found = load_object_set(objects_spec, protocol_named(protocol_name))
    table = Table(
        title=f"{escape(found.name)}: {len(found.objects)} objects", caption=f"fingerprint {found.fingerprint}"
    )
    for heading in ("object", "category", "longest side, m", "mass, kg", "convex parts"):
        table.add_column(heading, justify="right" if heading[-1] in "mgs" else "left")
    for model in found.objects:
        parts = len(read_parts(model.mesh))
        table.add_row(
            escape(model.name), escape(model.category), f"{model.longest_side:.3f}", f"{model.mass:.3f}", str(parts)
        )
    console = Console()
    console.print(table)
    if sheet is not None:
        from ggcnn_net2net.simulation.pictures import contact_sheet

        contact_sheet(sheet, found)
        console.print(f"Written to {sheet}", markup=False, soft_wrap=True)
