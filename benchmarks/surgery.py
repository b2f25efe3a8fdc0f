"""Time and memory of each operation on the published network, or on a network of its shape if that is not there.

python benchmarks/surgery.py [--repeats N] [--json]
"""

from __future__ import annotations

import json
import resource
import statistics
import time

import click
import keras
from rich.console import Console
from rich.table import Table

import ggcnn_net2net as gn
from ggcnn_net2net.net2net import EXTENDED_OPERATIONS, apply_operations

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


@click.command()
@click.option("--repeats", default=5, show_default=True, help="Repeats of each operation; the median counts.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
def main(repeats: int, as_json: bool) -> None:
    """Measure each operation on each of the six layers, and the paper's four in sequence."""
    name, model = network()
    apply_operations(model, "deeper(1)")  # the first call also loads parts of TensorFlow
    before = peak_mib()
    rows = []
    for operations in [*OPERATIONS, EXTENDED_OPERATIONS]:
        seconds = []
        for _ in range(repeats):
            start = time.perf_counter()
            child = apply_operations(model, operations)
            seconds.append(time.perf_counter() - start)
        rows.append(
            {"operations": operations, "seconds": statistics.median(seconds), "parameters": child.count_params()}
        )
    memory = {"peak_mib": peak_mib(), "added_mib": peak_mib() - before}
    if as_json:
        print(json.dumps({"network": name, "repeats": repeats, "rows": rows, **memory}, indent=2))
        return
    table = Table("operations", "seconds", "parameters", title=f"Surgery on the {name} network, median of {repeats}")
    for row in rows:
        slow = row["operations"] in OPERATIONS and row["seconds"] > TARGET_SECONDS
        table.add_row(row["operations"], f"{row['seconds']:.3f}{' !' if slow else ''}", f"{row['parameters']:,}")
    Console().print(table)
    print(f"peak memory {memory['peak_mib']:.0f} MiB, of which {memory['added_mib']:.0f} MiB came with the operations")
    print(f"target: each operation below {TARGET_SECONDS} s")


if __name__ == "__main__":
    main()
