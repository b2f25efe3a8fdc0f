"""`ggcnn-net2net inspect`: what is in a model file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.table import Table

    from ggcnn_net2net.model_files import ModelSummary


@click.command("inspect")
@click.argument("file")
@click.option("--json", "as_json", is_flag=True, help="Print everything as one JSON object.")
def inspect_command(file: str, as_json: bool) -> None:
    """Show the architecture, layers, optimizer, lineage and health of model FILE, a path, "published" or "zoo:NAME".

    The column # is a layer's number in operations such as deeper(3). Reads .hdf5 and .h5 of every Keras from 2.0 on,
    .keras, and the PyTorch state_dict of the GG-CNN authors. Exit code 1 if the file cannot be read or does not hold a
    working GG-CNN.

    \b
    Example: ggcnn-net2net inspect published
    """
    from ggcnn_net2net.errors import ModelFileError  # --help must not load what the work needs
    from ggcnn_net2net.model_files import model_summary
    from ggcnn_net2net.quiet import import_tensorflow

    import_tensorflow()
    summary = model_summary(file)
    if as_json:
        import json

        click.echo(json.dumps(summary.as_dict(), indent=2))
    else:
        _print(summary)
    if summary.problems:
        raise ModelFileError(f"{file} does not hold a working GG-CNN: {summary.problems[0]}")


def _print(summary: ModelSummary) -> None:
    from rich.console import Console
    from rich.markup import escape

    console = Console()
    name = f" ({summary.architecture_name})" if summary.architecture_name else ""
    work = summary.multiplications
    published = "yes, the published GG-CNN" if summary.is_published else "no"
    facts = {
        "file": f"{summary.path} ({summary.size_bytes:,} bytes)",
        "SHA-256": summary.sha256,
        "published": published,
        "format": summary.format + (f", Keras {summary.keras_version}" if summary.keras_version else ""),
        "architecture": f"{summary.architecture or 'not a plain chain of C and T layers'}{name}",
        "input": _shape(summary.input_shape),
        "heads": ", ".join(summary.heads),
        "parameters": f"{summary.parameters:,}",
        "work": "not counted" if work is None else f"{work / 1e6:,.1f} million multiplications an image",
        "optimizer": _optimizer(summary),
    }
    for label, value in facts.items():
        console.print(f"[bold]{label:>12}[/]  {escape(value)}", highlight=False, soft_wrap=True)
    console.print(_layer_table(summary))
    console.print(_history_lines(summary), markup=False, soft_wrap=True)
    for check in summary.checks:
        mark = "[green]ok[/]  " if check.ok else "[red]look[/]"
        console.print(f"{mark} {check.name}: {escape(check.detail)}", highlight=False, soft_wrap=True)


def _layer_table(summary: ModelSummary) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, padding=0, pad_edge=False)  # fits a GG-CNN into 80 columns
    table.add_column("#", justify="right")
    for heading in ("layer", "class"):
        table.add_column(heading, overflow="fold")
    for heading in ("kernel", "filters", "stride", "weights", "max |w|"):
        table.add_column(heading, justify="right")
    for layer in summary.layers:
        table.add_row(
            str(layer.index or ""),
            layer.name,
            layer.class_name,
            _shape(layer.kernel_size),
            str(layer.filters or ""),
            _shape(layer.strides),
            f"{layer.parameters:,}",
            "" if layer.largest_weight is None else f"{layer.largest_weight:.3g}",
        )
    return table


def _history_lines(summary: ModelSummary) -> str:
    """The lineage, one operation a line."""
    if not summary.history:
        return "lineage: none stored"
    steps = [
        f"  {number}. " + ", ".join(f"{key}={value}" for key, value in step.items())
        for number, step in enumerate(summary.history, start=1)
    ]
    return "\n".join(["lineage:", *steps])


def _optimizer(summary: ModelSummary) -> str:
    if summary.optimizer is None:
        return "none stored"
    facts = summary.optimizer
    rate = facts["learning_rate"]
    rate = f"{rate:.4g}" if isinstance(rate, float) else rate
    return f"{facts['class_name']}, learning rate {rate}, {facts['n_weights']} arrays of state"


def _shape(sizes: tuple[int | None, ...] | None) -> str:
    return "" if sizes is None else "x".join("?" if size is None else str(size) for size in sizes)
