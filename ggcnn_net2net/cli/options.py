"""Options that several commands share."""

from __future__ import annotations

import os
import shlex
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

if TYPE_CHECKING:
    from ggcnn_net2net.protocol import Protocol
    from ggcnn_net2net.simulation import GripperSpec

PICTURE_SUFFIXES = (".png", ".pdf", ".svg", ".jpg")


class _Output(click.Path):
    """What is written, with its name and folder checked before the work begins and not when it is written."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Check the folder; those that are missing are made later."""
        path = Path(str(super().convert(value, param, ctx)))
        if not path.name and not self.dir_okay:
            self.fail(f"expected a file to write, received {str(value)!r}", param, ctx)
        try:
            folder = next(parent for parent in path.absolute().parents if parent.exists())
        except PermissionError as error:
            self.fail(f"expected a folder to write {path.name} to: {error}", param, ctx)
        if not folder.is_dir():
            self.fail(f"expected a folder to write {path.name} to, {folder} is a file", param, ctx)
        if not os.access(folder, os.W_OK):
            self.fail(f"expected a folder to write {path.name} to, {folder} may not be written to", param, ctx)
        return path


class OutputFile(_Output):
    """A file to write."""

    def __init__(self) -> None:
        super().__init__(path_type=Path, dir_okay=False, writable=True)


class OutputFolder(_Output):
    """A folder to write to, which need not exist."""

    def __init__(self) -> None:
        super().__init__(path_type=Path, file_okay=False, writable=True)


class Picture(OutputFile):
    """A picture to write."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Check the suffix, too."""
        path = super().convert(value, param, ctx)
        if path.suffix.lower() not in PICTURE_SUFFIXES:
            self.fail(f"expected a picture, {', '.join(PICTURE_SUFFIXES)}; received {path.name}", param, ctx)
        return path


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
GRIPPER = click.option(
    "--gripper",
    "gripper_file",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Your gripper's dimensions, a TOML file. [default: the paper's gripper]",
)
WORKERS = click.option(
    "--workers",
    default=os.cpu_count() or 1,
    show_default="number of cores",
    type=click.IntRange(min=1),
    help="Processes. Results do not depend on their number.",
)


def _with_a_teacher(context: click.Context, parameter: click.Parameter, value: float) -> float:
    """Refuse --distil-weight without --distil, where it would have no effect."""
    given = parameter.name is not None and context.get_parameter_source(parameter.name) is ParameterSource.COMMANDLINE
    if given and context.params.get("distil") is None:
        raise click.UsageError("expected --distil TEACHER with --distil-weight, received the weight alone")
    return value


DISTIL_WEIGHT = click.option(
    "--distil-weight",
    callback=_with_a_teacher,
    default=0.5,
    show_default=True,
    type=click.FloatRange(0, 1, min_open=True),
    help="Weight of the teacher's maps in the targets.",
)


def taught(protocol: Protocol) -> Protocol:
    """The protocol for training with a teacher: without `masked_loss`, because a teacher labels every pixel."""
    if not protocol.masked_loss:
        return protocol
    click.echo("A teacher labels every pixel: the loss counts all of them (masked_loss is off).", err=True)
    return replace(protocol, masked_loss=False)


def command_line() -> str:
    """How the user started this process, for the record: a line that a shell runs again."""
    program = Path(sys.argv[0])
    modules = {"ggcnn_net2net": "ggcnn_net2net", "reproduce": "ggcnn_net2net.reproduce"}
    module = modules.get(program.parent.name) if program.name == "__main__.py" else None
    start = ["ggcnn-net2net"] if module is None else ["python", "-m", module]
    return shlex.join([*start, *sys.argv[1:]])


def gripper_of(file: Path | None) -> GripperSpec:
    """The gripper described by the file that --gripper names; without one, the paper's."""
    from ggcnn_net2net.simulation import PAPER_GRIPPER, load_gripper

    return PAPER_GRIPPER if file is None else load_gripper(file)
