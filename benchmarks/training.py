"""Time of a training step: stock Keras, this package and PyTorch, in turns.

    python benchmarks/training.py
    python benchmarks/training.py --architecture narrow --json

Every round gives each contender some steps on the same images; medians over the rounds count, and ratios more than
milliseconds. Stock Keras is `train_on_batch` of the four-headed model, which is quicker than `fit`. PyTorch takes part
where it is installed (extra "benchmarks"), with its usual tensors and with channels-last ones. The masked loss of the
protocol CORRECTED is beside one that takes the heads' errors apart, as one writes it first. The peak is the product of
two large matrices, measured in the same rounds.
"""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import statistics
import time
from collections.abc import Callable
from functools import partial
from multiprocessing.connection import Connection
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table

import ggcnn_net2net as gn
from ggcnn_net2net.architecture import HEAD_KERNEL_SIZE, HEADS, INPUT_SIZE, Architecture
from ggcnn_net2net.quiet import import_tensorflow
from ggcnn_net2net.training import set_threads

PEAK_SIZE = 2048
STOCK, FAST = "stock Keras", "ggcnn_net2net"
MASKED, MASKED_APART = "ggcnn_net2net, masked loss", "masked loss, heads apart"
Contender = Callable[[], object]
"""Takes one step, or does one product."""


def keras_contenders(architecture: Architecture, inputs: np.ndarray, targets: np.ndarray) -> dict[str, Contender]:
    import keras

    from ggcnn_net2net.training.losses import masked_losses, paper_losses

    stock = gn.build_ggcnn(architecture, seed=0)
    stock.compile(keras.optimizers.RMSprop(1e-3), "mse")
    heads = {name: targets[..., number : number + 1] for number, name in enumerate(HEADS)}
    losses = {FAST: paper_losses, MASKED: masked_losses, MASKED_APART: masked_losses_apart}
    ours = {name: contender_with(loss, architecture, inputs, targets) for name, loss in losses.items()}
    return {STOCK: lambda: stock.train_on_batch(inputs, heads), **ours}


def contender_with(loss: Any, architecture: Architecture, inputs: np.ndarray, targets: np.ndarray) -> Contender:
    from ggcnn_net2net.training.rmsprop import Keras2RMSprop
    from ggcnn_net2net.training.step import step_and_loss

    model = gn.build_ggcnn(architecture, seed=0)
    model.compile(Keras2RMSprop(1e-3), jit_compile=False)
    model.optimizer.build(model.trainable_variables)
    step, _ = step_and_loss(model, loss)
    return lambda: [value.numpy() for value in step(inputs, targets)]


def masked_losses_apart(maps: Any, targets: Any) -> Any:
    """The masked loss, head by head."""
    import tensorflow as tf

    from ggcnn_net2net.training.losses import MASKED_WEIGHT

    errors = tf.square(maps - targets)
    labelled = tf.cast(targets[..., :1] > 0, errors.dtype)
    quality = tf.reduce_mean(errors[..., 0])
    others = tf.reduce_sum(errors[..., 1:] * labelled, axis=(0, 1, 2)) / tf.maximum(tf.reduce_sum(labelled), 1.0)
    return tf.concat([[quality], MASKED_WEIGHT * others], axis=0)


def torch_contenders(
    architecture: Architecture, inputs: np.ndarray, targets: np.ndarray, threads: int
) -> dict[str, Contender]:
    try:
        import torch
        from torch import nn
    except ImportError:
        return {}
    torch.set_num_threads(threads)

    class GGCNN(nn.Module):
        """The same layers with the padding of PyTorch."""

        def __init__(self) -> None:
            super().__init__()
            layers: list[nn.Module] = []
            channels = 1
            for layer in architecture.layers:
                kernel, stride = layer.kernel_size[0], layer.stride
                padding = -(-(kernel - stride) // 2)
                if layer.kind == "C":
                    layers.append(nn.Conv2d(channels, layer.filters, kernel, stride, padding))
                else:
                    cut = stride - kernel + 2 * padding
                    layers.append(nn.ConvTranspose2d(channels, layer.filters, kernel, stride, padding, cut))
                layers.append(nn.ReLU())
                channels = layer.filters
            self.body = nn.Sequential(*layers, nn.ZeroPad2d((0, 1, 0, 1)))
            self.heads = nn.ModuleList(nn.Conv2d(channels, 1, HEAD_KERNEL_SIZE) for _ in HEADS)

        def forward(self, images: torch.Tensor) -> list[torch.Tensor]:
            features = self.body(images)
            return [head(features) for head in self.heads]

    def contender(memory_format: torch.memory_format) -> Contender:
        model = GGCNN().to(memory_format=memory_format)
        optimizer = torch.optim.RMSprop(model.parameters(), 1e-3, alpha=0.9, eps=1e-7)
        images = torch.from_numpy(inputs.transpose(0, 3, 1, 2).copy()).to(memory_format=memory_format)
        truth = [torch.from_numpy(targets[:, None, ..., number].copy()) for number in range(len(HEADS))]

        def step() -> float:
            optimizer.zero_grad()
            loss = sum(nn.functional.mse_loss(one, other) for one, other in zip(model(images), truth, strict=True))
            loss.backward()
            optimizer.step()
            return loss.item()

        return step

    return {
        f"PyTorch {torch.__version__.split('+')[0]}": contender(torch.contiguous_format),
        "PyTorch, channels last": contender(torch.channels_last),
    }


def torch_worker(connection: Connection, *arguments: Any) -> None:
    """Take one step of a contender for each of its names that comes through `connection`."""
    contenders = torch_contenders(*arguments)
    connection.send(list(contenders))
    with contextlib.suppress(EOFError):  # the other end is done
        while True:
            connection.send(contenders[connection.recv()]())


def torch_process(*arguments: Any) -> dict[str, Contender]:
    """The contenders of PyTorch, in a process of their own: with TensorFlow in one it crashes."""
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    spawn.Process(target=torch_worker, args=(there, *arguments), daemon=True).start()

    def step(name: str) -> object:
        here.send(name)
        return here.recv()

    return {name: partial(step, name) for name in here.recv()}


def peak_contender() -> Contender:
    import tensorflow as tf

    matrix = tf.random.normal((PEAK_SIZE, PEAK_SIZE))
    product = tf.function(lambda one: tf.reduce_sum(tf.matmul(one, one)))
    return lambda: product(matrix).numpy()


def measure(contenders: dict[str, Contender], rounds: int, steps: int) -> dict[str, list[float]]:
    """Seconds a step of each contender in each round."""
    for step in contenders.values():
        for _ in range(2):  # compile, and fill the caches
            step()
    seconds: dict[str, list[float]] = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, step in contenders.items():
            started = time.perf_counter()
            for _ in range(steps):
                step()
            seconds[name].append((time.perf_counter() - started) / steps)
    return seconds


@click.command()
@click.option("--architecture", default="original", show_default=True)
@click.option("--batch-size", default=4, show_default=True)
@click.option("--rounds", default=15, show_default=True)
@click.option("--steps", default=4, show_default=True, help="Steps of each contender in a round.")
@click.option("--threads", default=os.cpu_count() or 1, show_default="number of cores")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
def main(architecture: str, batch_size: int, rounds: int, steps: int, threads: int, as_json: bool) -> None:
    """Measure and print."""
    import_tensorflow()
    set_threads(threads)
    network = Architecture.parse(architecture)
    random = np.random.default_rng(0)
    inputs = random.normal(0, 0.1, (batch_size, INPUT_SIZE, INPUT_SIZE, 1)).astype(np.float32)
    targets = random.random((batch_size, INPUT_SIZE, INPUT_SIZE, 4)).astype(np.float32)
    contenders = keras_contenders(network, inputs, targets) | torch_process(network, inputs, targets, threads)
    seconds = measure({**contenders, "peak": peak_contender()}, rounds, steps)
    peak = 2 * PEAK_SIZE**3 / statistics.median(seconds.pop("peak")) / 1e9
    flops = 3 * 2 * network.multiplications()  # a step takes three times the forward pass; a sum for each product
    rows = [
        {
            "contender": name,
            "ms_per_image": 1e3 * statistics.median(times) / batch_size,
            "fastest_ms_per_image": 1e3 * min(times) / batch_size,
            # Within a round, so that what slows the machine down slows both.
            "times_as_fast_as_stock": statistics.median(
                stock / time for stock, time in zip(seconds[STOCK], times, strict=True)
            ),
            "gflops": flops * batch_size / statistics.median(times) / 1e9,
        }
        for name, times in seconds.items()
    ]
    if as_json:
        facts = {"architecture": str(network), "batch_size": batch_size, "threads": threads, "rounds": rounds}
        print(json.dumps({**facts, "gflop_per_image": flops / 1e9, "peak_gflops": peak, "rows": rows}, indent=2))
        return
    title = f"{network}, batch {batch_size}, {threads} threads, median of {rounds} rounds of {steps} steps"
    table = Table("", "ms an image", "fastest", "times as fast as stock", "GFLOP/s", "of peak", title=title)
    for row in rows:
        table.add_row(
            row["contender"],
            f"{row['ms_per_image']:.1f}",
            f"{row['fastest_ms_per_image']:.1f}",
            f"{row['times_as_fast_as_stock']:.2f}",
            f"{row['gflops']:.0f}",
            f"{row['gflops'] / peak:.0%}",
        )
    Console().print(table)
    print(f"{flops / 1e9:.2f} GFLOP an image; peak {peak:.0f} GFLOP/s ({PEAK_SIZE}x{PEAK_SIZE} matrices, float32)")


if __name__ == "__main__":
    main()
