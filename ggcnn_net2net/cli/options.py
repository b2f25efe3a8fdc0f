"""Options that several commands share."""

from __future__ import annotations

import os

import click

OBJECTS = click.option(
    "--objects",
    "objects_spec",
    default="procedural40",
    show_default=True,
    metavar="SET",
    help="procedural40, pybullet, ycb40, shapenetsem:FOLDER, training:NUMBER, or a folder with meshes and objects.csv.",
)
SEED = click.option("--seed", default=0, show_default=True, type=click.IntRange(min=0), help="Seed of the scenes.")
PROTOCOL = click.option(
    "--protocol",
    "protocol_name",
    default="paper",
    show_default=True,
    type=click.Choice(["paper", "corrected"], case_sensitive=False),
    help="What to do where the published code has defects: the same, or what the paper means.",
)
WORKERS = click.option(
    "--workers",
    default=os.cpu_count() or 1,
    show_default="number of cores",
    type=click.IntRange(min=1),
    help="Processes. Results do not depend on their number.",
)
