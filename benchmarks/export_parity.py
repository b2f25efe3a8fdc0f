"""How far every exported format is from the Keras model, on Cornell depth images.

    GGCNN_NET2NET_DATA=FOLDER python benchmarks/export_parity.py

The published network, those of the zoo, and the PyTorch weights, each in every format that can hold it. Largest
difference of any pixel of any of the four maps; images on which file and model see the same best grasp (IoU above 0.25,
closing directions within 30°, or none both). The images that int8 is calibrated with are other ones.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from ggcnn_net2net import zoo
from ggcnn_net2net.architecture import INPUT_SIZE
from ggcnn_net2net.errors import DataNotFoundError, ExportError
from ggcnn_net2net.model_files.export import export, read_metadata
from ggcnn_net2net.model_files.export.formats import FORMATS, Format
from ggcnn_net2net.model_files.export.runtime import INT8
from ggcnn_net2net.model_files.export.samples import Depth, scene_images
from ggcnn_net2net.reference_data import DATA_VARIABLE, data_root

PYTORCH = "original_ggcnn_weights/pytorch/ggcnn_epoch_23_cornell_statedict.pt"


def networks(root: Path) -> dict[str, str]:
    """Name in the table -> what `load_ggcnn` takes."""
    found = {"published": "published", **{name: f"{zoo.PREFIX}{name}" for name in zoo.names()}}
    return found | ({"PyTorch weights": str(root / PYTORCH)} if (root / PYTORCH).is_file() else {})


def measure(
    source: str, made: Format, quantization: str | None, samples: Depth, representative: Depth
) -> dict[str, Any]:
    """One export: its parity and its size, or why there is none."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"network{''.join(made.suffixes[:1])}"
        calibration = representative if quantization == INT8 else None
        try:
            export(source, path, quantization=quantization, representative=calibration, samples=samples)
        except ExportError as error:
            return {"refused": str(error)}
        content = read_metadata(path)
        size = sum((Path(folder) / name).stat().st_size for name in content["files"])
        return {**content["parity"], "bytes": size, "versions": content["versions"]}


@click.command()
@click.option("--images", default=50, show_default=True, help="Cornell depth images.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
def main(images: int, as_json: bool) -> None:
    """Compare every format of every network with Keras."""
    root = data_root()
    if root is None or not (root / "cornell").is_dir():
        raise DataNotFoundError(f"expected cornell/ in the folder that {DATA_VARIABLE} names")
    depth = scene_images(root / "cornell", 2 * images, (INPUT_SIZE, INPUT_SIZE))
    samples, representative = depth[::2], depth[1::2]
    rows = [
        {
            "network": name,
            "format": made.name,
            "quantization": quantization,
            **measure(source, made, quantization, samples, representative),
        }
        for name, source in networks(root).items()
        for made in FORMATS.values()
        for quantization in (None, *made.quantizations)
    ]
    if as_json:
        print(json.dumps(rows, indent=2))
        return
    table = Table(
        "network", "format", "max difference", "same grasp", "bytes", title=f"Parity on {len(samples)} Cornell images"
    )
    for row in rows:
        kind = " ".join(filter(None, (row["format"], row["quantization"])))
        if "refused" in row:
            table.add_row(row["network"], kind, "refused", "", "")
        else:
            difference = max(row["max_abs_difference"].values())
            same = f"{row['same_grasp']}/{row['images']}"
            table.add_row(row["network"], kind, f"{difference:.1e}", same, f"{row['bytes']:,}")
    Console().print(table)


if __name__ == "__main__":
    main()
