"""`ggcnn-net2net grow`: apply Net2Net operations to a model file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from ggcnn_net2net.cli.options import OutputFile, Picture

if TYPE_CHECKING:
    import keras
    import numpy as np


@click.command("grow")
@click.argument("file")
@click.option("--ops", required=True, help='Operations in order, for example "deeper(3), wider(3)".')
@click.option("-o", "--output", required=True, type=OutputFile(), help="File to write.")
@click.option(
    "--seed",
    default=0,
    show_default=True,
    type=click.IntRange(min=0),
    help="Seed of the filters that wider replicates.",
)
@click.option("--noise", default=0.0, show_default=True, help="Noise that sets the copies of wider apart.")
@click.option("--draw", type=Picture(), help="Picture of the kernels before and after.")
def grow_command(file: str, ops: str, output: Path, seed: int, noise: float, draw: Path | None) -> None:
    """Grow the network in model FILE, a path, "published" or "zoo:NAME", so that it computes the same maps.

    Layers are counted from 1. The suffix of the output chooses its format: .hdf5 and .h5 open in every Keras from 2.0
    on, .keras in Keras 3. Prints how the number of parameters changed and how far the maps differ.

    \b
    Examples:
      ggcnn-net2net grow published --ops "deeper(3), wider(3)" -o grown.hdf5
      ggcnn-net2net grow zoo:narrow --ops "deeper(2), wider(3)" -o grown.hdf5 --draw grown.png
    """
    from ggcnn_net2net.model_files import load_ggcnn, save_ggcnn  # --help must not load what the work needs
    from ggcnn_net2net.model_files.load import source_path
    from ggcnn_net2net.model_files.save import check_writable
    from ggcnn_net2net.net2net import apply_operations
    from ggcnn_net2net.net2net.pictures import draw_surgery, kernel_panels
    from ggcnn_net2net.quiet import import_tensorflow

    import_tensorflow()
    path = source_path(file)
    check_writable(output, path)
    model = load_ggcnn(path)
    grown = apply_operations(model, ops, seed=seed, noise=noise)
    if draw is not None:
        kernel_panels(grown)  # what cannot be drawn is refused before anything is written
    save_ggcnn(grown, output)
    before, after = model.count_params(), grown.count_params()
    click.echo(f"{before:,} -> {after:,} parameters ({after - before:+,})")
    for name, image in _test_images(model).items():
        click.echo(f"largest output difference on {name}: {_difference(model, grown, image):.2g}")
    click.echo(f"written to {output}")
    if draw is not None:
        draw_surgery(draw, model, grown, ops)
        click.echo(f"picture: {draw}")


def _test_images(model: keras.Model) -> dict[str, np.ndarray]:
    """A random image, and the depth of a box and a ball on a tilted plane, each as the network expects it."""
    import numpy as np

    from ggcnn_net2net.architecture import INPUT_SIZE

    height, width = (size or INPUT_SIZE for size in model.inputs[0].shape[1:3])
    rng = np.random.default_rng(0)
    row, col = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    depth = 1.5 + 0.05 * row
    depth -= 0.2 * ((abs(row - 0.2) < 0.15) & (abs(col + 0.3) < 0.4))
    depth -= np.sqrt(np.clip(0.1 - (row + 0.4) ** 2 - (col - 0.4) ** 2, 0, None))
    images = {
        "random input": rng.normal(size=(height, width)),
        "a synthetic depth image": depth - depth.mean(),
    }
    return {name: image[None, :, :, None].astype("float32") for name, image in images.items()}


def _difference(model: keras.Model, grown: keras.Model, image: np.ndarray) -> float:
    import numpy as np

    pairs = zip(model(image, training=False), grown(image, training=False), strict=True)
    return max(float(np.abs(np.asarray(one) - np.asarray(other)).max()) for one, other in pairs)
