"""Time of one depth image, network alone and from depth to grasp: every way to run a GG-CNN, in turns.

    python benchmarks/inference.py
    python benchmarks/inference.py --network published --network zoo:narrow --json

Every way has a process of its own with the same number of threads. In each round each process, while the others are
idle, takes a few images, one after the other; medians (p50) and 95th percentiles (p95) are of single images. Ratios are
to `tf.function` of the Keras model in the same round. ONNX Runtime and LiteRT run what `gn.export` writes (extra
"export").

From depth to grasp there are two images: a complete one of 300x300 px, as the simulator makes them, and a camera's of
640x480 px with 5% of its pixels missing, which are filled in. The naive way there is the same but for its network,
`tf.function`, and for a decoding that smooths whole maps.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table

REFERENCE = "tf.function"
SIMULATOR, CAMERA = "depth to grasp, 300x300", "depth to grasp, 640x480"
Run = Callable[[], Any]


def depth_image(height: int, width: int, missing: float) -> np.ndarray:
    """A box on a table 1.5 m below the camera, with noise, and pixels missing in patches."""
    random = np.random.default_rng(0)
    rows, cols = np.mgrid[:height, :width]
    depth = 1.5 + 1e-4 * rows + random.normal(0, 5e-4, (height, width))
    depth[(abs(rows - height / 2) < 0.07 * height) & (abs(cols - width / 2) < 0.2 * height)] -= 0.08
    for _ in range(round(missing * height * width / 64)):
        row, col = random.integers(height - 8), random.integers(width - 8)
        depth[row : row + 8, col : col + 8] = 0
    return depth.astype(np.float32)


def keras_networks(network: str) -> dict[str, Callable[[np.ndarray], Any]]:
    import tensorflow as tf

    import ggcnn_net2net as gn

    model = gn.load_ggcnn(network)
    compiled = tf.function(lambda images: model(images, training=False), autograph=False)
    return {
        "Keras predict": lambda images: model.predict(images, verbose=0),
        "Keras eager": lambda images: [head.numpy() for head in model(images, training=False)],
        REFERENCE: lambda images: [head.numpy() for head in compiled(tf.constant(images))],
    }


def our_network(network: str, backend: str) -> Callable[[np.ndarray], Any]:
    import ggcnn_net2net as gn
    from ggcnn_net2net.inference.network import compiled_network

    run = compiled_network(gn.load_ggcnn(network), backend)
    return lambda images: run(images[..., 0])


def onnx_network(path: Path, threads: int) -> Callable[[np.ndarray], Any]:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    (depth,) = session.get_inputs()
    return lambda images: session.run(None, {depth.name: images})


def litert_network(path: Path, threads: int) -> Callable[[np.ndarray], Any]:
    from ai_edge_litert.interpreter import Interpreter

    interpreter = Interpreter(model_path=str(path), num_threads=threads)
    runner = interpreter.get_signature_runner()
    (depth,) = runner.get_input_details()
    return lambda images: runner(**{depth: images})


def whole_way(network: str, backend: str, image: np.ndarray) -> Run:
    import ggcnn_net2net as gn

    predictor = gn.GraspPredictor(network, backend=backend)
    return lambda: predictor.predict(image, depth_unit="m")


def naive_whole_way(network: str, image: np.ndarray) -> Run:
    """The steps of the public code on the four heads' full maps."""
    from skimage.feature import peak_local_max
    from skimage.filters import gaussian

    from ggcnn_net2net.inference.presets import RSS_2018_PRESET
    from ggcnn_net2net.inference.window import crop_window, network_input

    run = keras_networks(network)[REFERENCE]
    window = crop_window(image.shape, RSS_2018_PRESET, 300)

    def predict() -> Any:
        depth, _ = network_input(np.where(image > 0, image, np.nan), window, RSS_2018_PRESET)
        quality, cos, sin, width = (head.squeeze() for head in run(depth[None, ..., None]))
        quality = gaussian(quality, 5.0, preserve_range=True)
        width = gaussian(width * 150, 1.0, preserve_range=True)
        angle = np.arctan2(sin, cos) / 2
        peaks = peak_local_max(quality, min_distance=20, threshold_abs=0.2, num_peaks=1)
        return [(row, col, angle[row, col], width[row, col]) for row, col in peaks]

    return predict


def ways(network: str, folder: Path, threads: int) -> dict[str, dict[str, Callable[[], Run]]]:
    """Group -> name -> what makes the function to be timed, in the process where it is to run."""
    image = np.random.default_rng(0).normal(0, 0.1, (1, 300, 300, 1)).astype(np.float32)
    simulator, camera = depth_image(300, 300, 0), depth_image(480, 640, 0.05)

    def on_image(make: Callable[[], Callable[[np.ndarray], Any]]) -> Callable[[], Run]:
        def made() -> Run:
            run = make()
            return lambda: run(image)

        return made

    alone = {name: on_image(lambda name=name: keras_networks(network)[name]) for name in KERAS}
    alone["ours, TensorFlow"] = on_image(lambda: our_network(network, "tensorflow"))
    alone["ours, OpenVINO"] = on_image(lambda: our_network(network, "openvino"))
    alone["ONNX Runtime"] = on_image(lambda: onnx_network(folder / "network.onnx", threads))
    alone["LiteRT"] = on_image(lambda: litert_network(folder / "network.tflite", threads))
    groups = {"network alone": alone}
    for group, depth in ((SIMULATOR, simulator), (CAMERA, camera)):
        groups[group] = {
            REFERENCE: lambda depth=depth: naive_whole_way(network, depth),
            "ours, TensorFlow": lambda depth=depth: whole_way(network, "tensorflow", depth),
            "ours, OpenVINO": lambda depth=depth: whole_way(network, "openvino", depth),
        }
    return groups


KERAS = ("Keras predict", "Keras eager", REFERENCE)


def serve(connection: Any, network: str, folder: Path, threads: int, group: str, name: str) -> None:
    """Make one contender, and time as many runs of it as each message asks for."""
    os.environ["OMP_NUM_THREADS"] = str(threads)
    from ggcnn_net2net.quiet import import_tensorflow
    from ggcnn_net2net.training import set_threads

    import_tensorflow()
    set_threads(threads)
    run = ways(network, folder, threads)[group][name]()
    for _ in range(3):  # compile, and fill the caches
        run()
    connection.send("ready")
    while runs := connection.recv():
        seconds = []
        for _ in range(runs):
            started = time.perf_counter()
            run()
            seconds.append(time.perf_counter() - started)
        connection.send(seconds)


@contextmanager
def contender(*arguments: Any) -> Iterator[Any]:
    """A connection to a process that serves."""
    spawn = multiprocessing.get_context("spawn")
    here, there = spawn.Pipe()
    process = spawn.Process(target=serve, args=(there, *arguments), daemon=True)
    process.start()
    there.close()  # so that a process that died is noticed
    here.recv()
    yield here
    here.send(0)
    process.join()


def measure(networks: dict[str, Path], threads: int, rounds: int, images: int) -> Iterator[dict[str, Any]]:
    """One row for each way to run each network; `networks` are folders of exported files by network."""
    first = next(iter(networks))
    for group in ways(first, networks[first], threads):
        with ExitStack() as stack:
            connections = {
                (network, name): stack.enter_context(contender(network, folder, threads, group, name))
                for network, folder in networks.items()
                for name in ways(network, folder, threads)[group]
            }
            seconds: dict[tuple[str, str], list[list[float]]] = {key: [] for key in connections}
            for _ in range(rounds):
                for key, connection in connections.items():
                    time.sleep(0.02)  # threads of the one before spin a little while
                    connection.send(images)
                    seconds[key].append(connection.recv())
        for (network, name), taken in seconds.items():
            single = [second for turn in taken for second in turn]
            yield {
                "network": network,
                "what": group,
                "way": name,
                "p50_ms": 1e3 * float(np.percentile(single, 50)),
                "p95_ms": 1e3 * float(np.percentile(single, 95)),
                "times_tf_function": ratio(taken, seconds[network, REFERENCE]),
                "times_first_network": ratio(taken, seconds[first, name]),
            }


def ratio(ours: list[list[float]], theirs: list[list[float]]) -> float:
    """Median over the rounds of how many times as long ours took."""
    return statistics.median(
        statistics.median(one) / statistics.median(other) for one, other in zip(ours, theirs, strict=True)
    )


def export_for_runtimes(folders: dict[str, Path]) -> None:
    import ggcnn_net2net as gn

    for network, folder in folders.items():
        folder.mkdir()
        for suffix in (".onnx", ".tflite"):
            gn.export(gn.load_ggcnn(network), folder / f"network{suffix}")


@click.command()
@click.option(
    "--network", "networks", multiple=True, default=("published",), show_default=True, help="May be repeated."
)
@click.option("--rounds", default=20, show_default=True)
@click.option("--images", default=5, show_default=True, help="Images of each way in a round.")
@click.option("--threads", default=os.cpu_count() or 1, show_default="number of cores")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")
def main(networks: tuple[str, ...], rounds: int, images: int, threads: int, as_json: bool) -> None:
    """Measure and print."""
    with tempfile.TemporaryDirectory() as temporary:
        folders = {network: Path(temporary) / str(number) for number, network in enumerate(networks)}
        # In a process of its own, so that its TensorFlow is gone when the others are timed.
        export = multiprocessing.get_context("spawn").Process(target=export_for_runtimes, args=(folders,))
        export.start()
        export.join()
        rows = list(measure(folders, threads, rounds, images))
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    table = Table(title=f"one image, {threads} thread(s)")
    for heading in ("network", "what", "way", "p50 ms", "p95 ms", "x tf.function", "x first network"):
        table.add_column(heading, justify="left" if heading in ("network", "what", "way") else "right")
    for row in rows:
        table.add_row(
            Path(row["network"]).name,
            row["what"],
            row["way"],
            f"{row['p50_ms']:.1f}",
            f"{row['p95_ms']:.1f}",
            f"{row['times_tf_function']:.2f}",
            f"{row['times_first_network']:.2f}",
        )
    Console().print(table)


if __name__ == "__main__":
    main()
