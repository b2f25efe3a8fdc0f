"""`ggcnn-net2net`, the command that leads to all others."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from importlib import import_module
from typing import Any

import click

from ggcnn_net2net._version import __version__
from ggcnn_net2net.errors import GGCNNError

# name -> (module, attribute, help); a module is imported only when its command runs, so --help is quick.
COMMANDS = {
    "reproduce": ("reproduce", "reproduce", "Make the paper's tables and figures again."),
    "evaluate": ("evaluate", "evaluate", "Try single grasps, look at failures, score a network on a dataset."),
    "predict": ("predict", "predict_command", "Predict grasps from depth images of any camera."),
    "objects": ("objects", "objects", "Show an object set: a table and a contact sheet."),
    "dataset": ("dataset", "dataset", "Read, convert, join and look at grasp data."),
    "zoo": ("zoo", "zoo_command", "The networks that this project trained."),
    "inspect": ("inspect", "inspect_command", "Tell what a model file holds."),
    "train": ("train", "train_command", "Train a network on grasp data."),
    "search": ("search", "search_command", "Search for a better network by surgery and training."),
    "grow": ("grow", "grow_command", "Apply Net2Net operations to a model file."),
    "export": ("export", "export_command", "Write networks in the formats that grasp stacks load."),
}
INTERRUPTED = 130
GREETING = """ggcnn_net2net grows GG-CNN grasp networks, also small ones up to a parameter budget, and judges them.

First, see it work (about ten minutes on 2 cores, nothing to prepare):

  ggcnn-net2net reproduce table1                      the published GG-CNN and five others grasp 40 objects each

Then, what you came for:

  ggcnn-net2net predict depth.png -o grasps           where to grasp in a depth image of yours
  ggcnn-net2net dataset simulate -o simulated         grasp data to train on; `dataset build` also takes Cornell's
  ggcnn-net2net search published data.h5 -o search --budget quick --protocol corrected
                                                      a better network by surgery and training
  ggcnn-net2net export my_network.hdf5 --to onnx      a file for your grasp stack

All commands: ggcnn-net2net --help. A tutorial: docs/tutorial.md."""


class LazyGroup(click.Group):
    """A group that imports a subcommand's module when the subcommand is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Names of all subcommands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import and return a subcommand."""
        if cmd_name not in COMMANDS:
            return None
        module, attribute, _ = COMMANDS[cmd_name]
        command: click.Command = getattr(import_module(f"ggcnn_net2net.cli.{module}"), attribute)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the subcommands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, _, text) in COMMANDS.items()])


@click.command(cls=LazyGroup, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="ggcnn-net2net")
@click.pass_context
def cli(context: click.Context) -> None:
    """Grow GG-CNN grasp networks, also small ones up to a parameter budget, and judge them.

    \b
    Example, and the place to start: ggcnn-net2net reproduce table1
    """
    if context.invoked_subcommand is None:
        click.echo(GREETING)


def main() -> None:
    """Entry point of the console script."""
    run(cli, "ggcnn-net2net")


def run(command: click.Command, name: str) -> None:
    """Run a command; end the process with 0 (done), 1 (an error that is explained), 2 (wrong usage) or 130 (Ctrl-C)."""
    warnings.showwarning = _without_source(warnings.showwarning)
    try:
        sys.exit(command.main(prog_name=name, standalone_mode=False) or 0)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        click.echo("Interrupted.", err=True)
        sys.exit(INTERRUPTED)
    except GGCNNError as error:
        click.echo(f"Error: {error}", err=True)
        if error.page:
            click.echo(f"More about this: {error.page}", err=True)
        sys.exit(1)
    except OSError as error:  # a full disk, a folder that may not be written to
        if error.errno is None:
            raise
        where = "" if error.filename is None else f": {error.filename}"
        click.echo(f"Error: {error.strerror}{where}", err=True)
        sys.exit(1)


def _without_source(show: Callable[..., None]) -> Callable[..., None]:
    """Print this package's warnings without the line of code that gave them, which tells a user nothing."""

    def show_warning(message: Warning | str, category: type[Warning], *where: Any) -> None:
        if category.__module__.startswith("ggcnn_net2net."):
            click.echo(f"Warning: {message}", err=True)
        else:
            show(message, category, *where)

    return show_warning
