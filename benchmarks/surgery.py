"""Time, memory and exactness of each operation on the published network, or on one of its shape if that is not there.

    python benchmarks/surgery.py
    TF_ENABLE_ONEDNN_OPTS=0 python benchmarks/surgery.py

The difference is the largest of any output on the Cornell scenes of the reference data (300x300 from the middle, minus
their mean, clipped to a metre), where they are there, and on ten images of uniform noise in [-1, 1].
"""

from __future__ import annotations

import json
import resource
import statistics
import time

import click
import keras
import numpy as np
import tifffile
from rich.console import Console
from rich.table import Table

import ggcnn_net2net as gn
from ggcnn_net2net.inference import predict_maps
from ggcnn_net2net.net2net import EXTENDED_OPERATIONS, apply_operations
from ggcnn_net2net.reference_data import data_root

TARGET_SECONDS = 0.3
OPERATIONS = [f"{name}({layer})" for name in ("deeper", "wider") for layer in range(1, 7)]


def peak_mib() -> float:
    """Largest resident size of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def network() -> tuple[str, keras.Model]:
    try:
        return "published", gn.load_ggcnn("published")
    except gn.GGCNNError:
        return "untrained original", gn.build_ggcnn("original", seed=0)


def test_images() -> np.ndarray:
    """Network inputs (n, 300, 300)."""
    root = data_root()
    paths = sorted(root.glob("cornell/**/pcd*d.tiff")) if root else []
    scenes = [tifffile.imread(path)[90:390, 170:470].astype("float32") for path in paths]
    noise = np.random.default_rng(0).uniform(-1, 1, (10, 300, 300)).astype("float32")
    return np.concatenate([*(np.clip(scene - scene.mean(), -1, 1)[None] for scene in scenes), noise])


@click.command()
@click.option("--repeats", default=5, show_default=True, help="Repeats of each operation; the median counts.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
def main(repeats: int, as_json: bool) -> None:
    """Measure each operation on each of the six layers, and the paper's four in sequence."""
    name, model = network()
    apply_operations(model, "deeper(1)")  # the first call also loads parts of TensorFlow
    before = peak_mib()
    children = {}
    seconds: dict[str, float] = {}
    for operations in [*OPERATIONS, EXTENDED_OPERATIONS]:
        times = []
        for _ in range(repeats):
            start = time.perf_counter()
            children[operations] = apply_operations(model, operations)
            times.append(time.perf_counter() - start)
        seconds[operations] = statistics.median(times)
    memory = {"peak_mib": peak_mib(), "added_mib": peak_mib() - before}
    images = test_images()
    maps = list(predict_maps(model, images))
    rows = [
        {
            "operations": operations,
            "seconds": seconds[operations],
            "parameters": child.count_params(),
            "difference": max(
                float(np.abs(new - old).max()) for new, old in zip(predict_maps(child, images), maps, strict=True)
            ),
        }
        for operations, child in children.items()
    ]
    if as_json:
        print(json.dumps({"network": name, "repeats": repeats, "rows": rows, **memory}, indent=2))
        return
    table = Table(
        "operations",
        "seconds",
        "parameters",
        "max difference",
        title=f"Surgery on the {name} network, median of {repeats}; {len(images)} images",
    )
    for row in rows:
        slow = row["operations"] in OPERATIONS and row["seconds"] > TARGET_SECONDS
        table.add_row(
            row["operations"],
            f"{row['seconds']:.3f}{' !' if slow else ''}",
            f"{row['parameters']:,}",
            f"{row['difference']:.1e}",
        )
    Console().print(table)
    print(f"peak memory {memory['peak_mib']:.0f} MiB, of which {memory['added_mib']:.0f} MiB came with the operations")
    print(f"target: each operation below {TARGET_SECONDS} s")


if __name__ == "__main__":
    main()
