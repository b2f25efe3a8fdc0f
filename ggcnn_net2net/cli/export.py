"""`ggcnn-net2net export`: write networks in the formats that grasp stacks load."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from ggcnn_net2net.model_files.export.formats import Format

FORMATS = ("keras", "hdf5", "savedmodel", "tflite", "onnx", "openvino", "pytorch")


@click.command("export")
@click.argument("models", metavar="MODEL...", nargs=-1, required=True)
@click.option("--to", "formats", multiple=True, required=True, type=click.Choice(FORMATS), help="May be repeated.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="File to write; the folder for it where it is one; a folder for several models or formats.  [default: .]",
)
@click.option("--quantize", type=click.Choice(["float16", "int8"]), help="float16: tflite, openvino; int8: tflite.")
@click.option(
    "--representative",
    type=click.Path(path_type=Path, exists=True),
    help="For int8: a dataset file or a folder of raw scenes with depth images like those of use.",
)
def export_command(
    models: tuple[str, ...],
    formats: tuple[str, ...],
    output: Path | None,
    quantize: str | None,
    representative: Path | None,
) -> None:
    """Write each MODEL, a path, "published" or "zoo:NAME", in other formats; what differs from Keras is not kept.

    What a file takes and gives, and how far it is from Keras, is in the .export.json beside it. The formats need
    software that `pip install 'ggcnn_net2net[export]'` brings.

    \b
    Example: ggcnn-net2net export published --to onnx --to tflite -o exported
    """
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    from ggcnn_net2net.errors import ExportError
    from ggcnn_net2net.model_files import load_ggcnn
    from ggcnn_net2net.model_files.export import export, read_metadata
    from ggcnn_net2net.model_files.export import formats as known
    from ggcnn_net2net.model_files.export.exporting import check_target
    from ggcnn_net2net.model_files.export.runtime import input_size
    from ggcnn_net2net.model_files.export.samples import read_representative
    from ggcnn_net2net.model_files.load import source_path
    from ggcnn_net2net.quiet import import_tensorflow

    import_tensorflow()
    wanted = [known.FORMATS[name] for name in dict.fromkeys(formats)]
    for export_format in wanted:
        known.check_quantization(export_format, quantize)
    jobs = _targets(models, wanted, output, quantize)
    if len({target for _, target in jobs}) < len(jobs):
        raise ExportError("expected models with different names, received two whose files would have the same name")
    for model, target in jobs:  # what would be refused after other exports were written
        check_target(target, source_path(model))
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for heading in ("written", "bytes", "difference", "same grasp", "runtime"):
        table.add_column(heading, justify="right" if heading == "bytes" else "left", overflow="fold")
    images: dict[str, Any] = {}
    try:
        for model, target in jobs:
            if representative is not None and model not in images:
                images[model] = read_representative(representative, input_size(load_ggcnn(model)))
            export(model, target, quantization=quantize, representative=images.get(model))
            table.add_row(str(target), *_facts(target, read_metadata(target)))
    finally:
        if table.row_count:  # also what was written before an error
            Console().print(table, markup=False)


def _targets(
    models: tuple[str, ...], formats: list[Format], output: Path | None, quantize: str | None
) -> list[tuple[str, Path]]:
    """Model and path of each export: the output itself for a single one, if it is not a folder."""
    if output is not None and len(models) == len(formats) == 1 and not output.is_dir():
        _check_suffix(output, formats[0])
        return [(models[0], output)]
    folder = output or Path()
    return [
        (model, folder / _file_name(model, export_format, quantize)) for model in models for export_format in formats
    ]


def _check_suffix(path: Path, export_format: Format) -> None:
    from ggcnn_net2net.errors import ExportError

    if path.suffix not in (export_format.suffixes or ("",)):
        raise ExportError(
            f"expected an output that ends in {' or '.join(export_format.suffixes) or 'no suffix'} for "
            f"{export_format.name}, received {str(path)!r}"
        )


def _file_name(model: str, export_format: Format, quantize: str | None) -> str:
    """zoo:narrow -> narrow_int8.tflite; a SavedModel is a folder, narrow_savedmodel."""
    stem = Path(model.rpartition(":")[2]).stem
    parts = [
        stem.replace(".", "_"),
        *([quantize] if quantize else []),
        *([] if export_format.suffixes else [export_format.name]),
    ]
    return "_".join(parts) + "".join(export_format.suffixes[:1])


def _facts(path: Path, metadata: dict[str, Any]) -> tuple[str, str, str, str]:
    parity = metadata["parity"]
    size = sum((path.parent / name).stat().st_size for name in metadata["files"])
    difference = max(parity["max_abs_difference"].values())
    return f"{size:,}", f"{difference:.1e}", f"{parity['same_grasp']}/{parity['images']}", parity["runtime"]
