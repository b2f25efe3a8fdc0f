"""Time of training and prediction with oneDNN's kernels and with TensorFlow's own, in turns.

    python benchmarks/onednn.py
    python benchmarks/onednn.py --network zoo:narrow --ops "deeper(6)" --threads 1

TensorFlow takes oneDNN's kernels by itself only on processors with AVX512-VNNI or AMX; `TF_ENABLE_ONEDNN_OPTS` set to 1
or 0 decides for any. It is read when TensorFlow is loaded, so each choice has a process of its own. In each round each
process, while the other is idle, takes a training step and predicts single images; medians over the rounds count.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import statistics
import time
from multiprocessing.connection import Connection

import click
import numpy as np

TRAINING, PREDICTION = "training, ms an image", "prediction of one image, ms"
KERNELS = {"TensorFlow": "0", "oneDNN": "1"}
BATCH = 4


def worker(connection: Connection, choice: str, network: str, operations: str, threads: int) -> None:
    """Send the milliseconds of both tasks whenever something comes through `connection`."""
    os.environ["TF_ENABLE_ONEDNN_OPTS"] = choice
    from ggcnn_net2net.quiet import import_tensorflow

    import_tensorflow()
    import ggcnn_net2net as gn
    from ggcnn_net2net.inference.network import compiled_network
    from ggcnn_net2net.training import Recipe, set_threads
    from ggcnn_net2net.training.losses import paper_losses
    from ggcnn_net2net.training.step import step_and_loss

    set_threads(threads)
    model = gn.load_ggcnn(network)
    if operations:
        model = gn.apply_operations(model, operations, seed=0)
    predict = compiled_network(model)
    model.compile(Recipe().new_optimizer(steps_per_epoch=1), jit_compile=False)
    model.optimizer.build(model.trainable_variables)
    step, _ = step_and_loss(model, paper_losses)
    random = np.random.default_rng(0)
    images = random.normal(0, 0.1, (BATCH, 300, 300, 1)).astype(np.float32)
    targets = random.random((BATCH, 300, 300, 4)).astype(np.float32)

    def milliseconds() -> tuple[float, float]:
        started = time.perf_counter()
        [value.numpy() for value in step(images, targets)]
        trained = time.perf_counter()
        predict(images[:1, ..., 0])
        return 1e3 * (trained - started) / BATCH, 1e3 * (time.perf_counter() - trained)

    milliseconds()  # compile
    with contextlib.suppress(EOFError):  # the other end is done
        while True:
            connection.send(milliseconds())
            connection.recv()


@click.command()
@click.option("--network", default="published", show_default=True, help="A model file, published or zoo:NAME.")
@click.option("--ops", "operations", default="", help="Surgery before, such as deeper(1).")
@click.option("--rounds", default=9, show_default=True)
@click.option("--threads", default=os.cpu_count() or 1, show_default="number of cores")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
def main(network: str, operations: str, rounds: int, threads: int, as_json: bool) -> None:
    """Measure and print."""
    spawn = multiprocessing.get_context("spawn")
    connections = {}
    for name, choice in KERNELS.items():
        connections[name], there = spawn.Pipe()
        arguments = (there, choice, network, operations, threads)
        spawn.Process(target=worker, args=arguments, daemon=True).start()
        connections[name].recv()  # one warms up at a time
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in KERNELS}
    for _ in range(rounds):
        for name, connection in connections.items():
            connection.send(None)
            found[name].append(connection.recv())
    rows = {
        task: {name: statistics.median(times[number] for times in found[name]) for name in KERNELS}
        for number, task in enumerate((TRAINING, PREDICTION))
    }
    if as_json:
        facts = {"network": network, "operations": operations, "threads": threads, "rounds": rounds}
        print(json.dumps({**facts, **rows}, indent=2))
        return
    print(f"{' '.join([network, operations]).strip()}, {threads} threads, median of {rounds} rounds")
    for task, times in rows.items():
        shown = ", ".join(f"{name} {value:,.1f}" for name, value in times.items())
        print(f"{task}: {shown} ({times['TensorFlow'] / times['oneDNN']:.2f} times as fast)")


if __name__ == "__main__":
    main()
