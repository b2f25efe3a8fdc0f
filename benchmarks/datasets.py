"""Speed, size and memory of grasp data: reading clouds, drawing samples, writing and reading a large file.

    python benchmarks/datasets.py FOLDER --images 10000

FOLDER holds raw scenes (Cornell or Jacquard). Compression filters are timed in turns, image after image.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import click
import h5py
import numpy as np
from rich.console import Console
from rich.table import Table

from ggcnn_net2net.datasets.augmentation import Augmentation
from ggcnn_net2net.datasets.build import build_dataset, draw_sample
from ggcnn_net2net.datasets.cornell import SHAPE, read_cloud
from ggcnn_net2net.datasets.hdf5 import GraspDataset
from ggcnn_net2net.datasets.label_maps import draw_label_maps
from ggcnn_net2net.datasets.raw import SceneFolder, open_scenes
from ggcnn_net2net.datasets.splits import make_split
from ggcnn_net2net.grasping import Grasp, grasp_to_rectangle
from ggcnn_net2net.parallel import run_parallel

FILTERS = {
    "none": {},
    "lzf, shuffle": {"compression": "lzf", "shuffle": True},
    "gzip 1": {"compression": "gzip", "compression_opts": 1},
    "gzip 1, shuffle": {"compression": "gzip", "compression_opts": 1, "shuffle": True},
    "gzip 4, shuffle": {"compression": "gzip", "compression_opts": 4, "shuffle": True},
}
KINDS = ("compressed", "uncompressed")
BATCH = 4


def milliseconds(function: Callable[[], object], rounds: int = 15) -> float:
    """Median time of a call."""
    times = []
    for _ in range(rounds):
        started = time.perf_counter()
        function()
        times.append(time.perf_counter() - started)
    return statistics.median(times) * 1000


def write_cloud(path: Path) -> None:
    """A cloud with a point for every pixel of a tilted plane."""
    index = np.arange(SHAPE[0] * SHAPE[1])
    points = np.column_stack([index % 640 - 320.5, index // 640 - 240.5, 1000 + index / 1000, index * 0 + 2e-38, index])
    np.savetxt(path, points, fmt="%.6g %.6g %.6g %.8g %d", header="DATA ascii", comments="")


def filter_table(scenes: SceneFolder, folder: Path, images: int = 30) -> Table:
    """Sizes and decoding times of one image's depth, and of its width map, under each filter."""
    samples = [draw_sample(scenes[index % len(scenes)], index, Augmentation(), 0) for index in range(images)]
    with h5py.File(folder / "filters.h5", "w") as file:
        for name, options in FILTERS.items():
            for kind in ("depth", "width"):
                stored = file.create_dataset(
                    f"{name}/{kind}", (images, 300, 300), "f4", chunks=(1, 300, 300), **options
                )
                for row, sample in enumerate(samples):
                    stored[row] = sample.depth if kind == "depth" else sample.maps.width
    times: dict[tuple[str, str], list[float]] = {}
    with h5py.File(folder / "filters.h5") as file:
        for row in range(images):
            for name in FILTERS:
                for kind in ("depth", "width"):
                    times.setdefault((name, kind), []).append(milliseconds(lambda r=row, d=file[name][kind]: d[r], 1))
        table = Table("filter", "depth, KiB", "depth, ms", "width map, KiB", "width map, ms")
        for name in FILTERS:
            cells = []
            for kind in ("depth", "width"):
                size = file[name][kind].id.get_storage_size() / images / 1024
                cells += [f"{size:.0f}", f"{statistics.median(times[name, kind]):.2f}"]
            table.add_row(name, *cells)
    return table


def peak_memory() -> float:
    """Peak memory of this process in MiB (Linux). `resource.getrusage` would count that of its parent."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


def read_epoch(path: Path) -> tuple[float, float]:
    """Read the training split once in random order; milliseconds an image and the process's peak memory in MiB."""
    dataset = GraspDataset(path, "train")
    rows = np.random.default_rng(0).permutation(len(dataset))
    started = time.perf_counter()
    for first in range(0, len(rows), BATCH):
        dataset.batch(rows[first : first + BATCH].tolist())
    elapsed = time.perf_counter() - started
    return elapsed / len(rows) * 1000, peak_memory()


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, exists=True))
@click.option("--images", default=10000, show_default=True, help="About how many to write.")
@click.option("--workers", default=2, show_default=True)
def main(folder: Path, images: int, workers: int) -> None:
    """Measure on the scenes of FOLDER."""
    console = Console()
    scenes = open_scenes(folder)
    scene = scenes[0]
    rng = np.random.default_rng(0)
    many = [
        grasp_to_rectangle(Grasp(*rng.uniform(60, 240, 2), rng.uniform(-1.5, 1.5), rng.uniform(30, 110)))
        for _ in range(320)
    ]
    with tempfile.TemporaryDirectory() as name:
        temporary = Path(name)
        write_cloud(temporary / "cloud.txt")
        print(f"{milliseconds(lambda: read_cloud(temporary / 'cloud.txt')):.0f} ms a cloud of 307,200 points")
        print(f"{milliseconds(lambda: scenes[0]):.0f} ms a raw scene")
        print(f"{milliseconds(lambda: draw_sample(scene, 0, Augmentation(), 0)):.1f} ms a sample drawn from it")
        print(f"{milliseconds(lambda: draw_label_maps(many)):.1f} ms for the label maps of 320 rectangles")
        console.print(filter_table(scenes, temporary))
        settings = Augmentation(per_scene=-(-images // len(scenes)))
        split = make_split(scenes.objects, "image", 0.01, 0)
        for kind in KINDS:
            started = time.perf_counter()
            data, compressed = temporary / f"{kind}.h5", kind == "compressed"
            result = build_dataset(scenes, split, data, settings, workers=workers, compressed=compressed)
            rows, seconds, size = sum(result.rows.values()), time.perf_counter() - started, data.stat().st_size / 2**20
            print(
                f"{kind}: {rows} images in {seconds:.0f} s with {workers} workers, {seconds / rows * 1000:.1f} ms an "
                f"image; {size / rows * 1000:.0f} MiB for 1,000; peak memory of this process {peak_memory():.0f} MiB"
            )
        for kind in KINDS:
            ((_, (read, peak)),) = run_parallel(read_epoch, [(temporary / f"{kind}.h5",)], workers=1)
            print(f"{kind}: {read:.1f} ms an image to read in batches of {BATCH} at random; peak memory {peak:.0f} MiB")


if __name__ == "__main__":
    main()
