"""The `ycb40` set: 40 objects of the YCB set as convex decompositions, found locally or downloaded and verified."""

from __future__ import annotations

import csv
from importlib import resources
from pathlib import Path

import numpy as np

from ggcnn_net2net import reference_data
from ggcnn_net2net.atomic import write_text
from ggcnn_net2net.errors import DataNotFoundError, ObjectSetError, VerificationError
from ggcnn_net2net.simulation.meshes import extents, read_parts

# YCB models (CC BY 4.0) with V-HACD decompositions, github.com/kwonathan/ycb_urdfs at a fixed commit.
YCB_URL = (
    "https://raw.githubusercontent.com/kwonathan/ycb_urdfs/8439cc67e8d8fb580ed9d25bf3a54dab8e9f92ea/"
    "ycb_assets/{name}/google_16k/textured_vhacd.obj"
)
_TOLERANCE = 1e-4  # metres; the meshes are rounded to micrometres, our table to hundredths of a millimetre


def ycb40_folder() -> Path:
    """Folder with NAME_vhacd.obj of the 40 objects and an objects.csv.

    Looked for in `$GGCNN_NET2NET_DATA/objects/ycb40` and the user's cache, then downloaded into the cache. Every
    downloaded mesh is compared with the number of convex parts and the side lengths that are on record here.

    Raises:
        DataNotFoundError: nowhere to be found and not to be downloaded.
        VerificationError: a download is not the expected mesh.
    """
    root = reference_data.data_root()
    cached = reference_data.cache_root() / "objects" / "ycb40"
    places = [*([root / "objects" / "ycb40"] if root else []), cached]
    for place in places:
        if (place / "objects.csv").is_file():
            return place
    try:
        _download_all(cached)
    except DataNotFoundError as error:
        searched = "\n".join(f"  {place}/objects.csv" for place in places)
        raise DataNotFoundError(
            f"the object set ycb40 was not found. Looked for:\n{searched}\n  {YCB_URL.format(name='NAME')}\n"
            f"    ({error})\nOn a machine with network access, this command fetches it into the cache:\n"
            "  ggcnn-net2net objects ycb40"
        ) from error
    return cached


def _download_all(folder: Path) -> None:
    rows = _records()
    for row in rows:
        mesh = folder / f"{row['name']}_vhacd.obj"
        with reference_data.one_at_a_time(mesh):
            if not mesh.is_file():
                _download(mesh, row)
    # Written last: its presence says that the folder is complete.
    write_text(folder / "objects.csv", "name\n" + "".join(f"{row['name']}\n" for row in rows))


def _download(mesh: Path, row: dict[str, str]) -> None:
    downloaded = reference_data.download(YCB_URL.format(name=row["name"]), mesh.with_suffix(".download"))
    try:
        _verify(downloaded, row)
    except (ObjectSetError, VerificationError):
        downloaded.unlink()
        raise
    downloaded.replace(mesh)


def _records() -> list[dict[str, str]]:
    with resources.files(__package__).joinpath("data/ycb40.csv").open(encoding="utf-8") as lines:
        return list(csv.DictReader(line for line in lines if not line.startswith("#")))


def _verify(mesh: Path, record: dict[str, str]) -> None:
    parts = read_parts(mesh)
    sides = [float(record[axis]) for axis in "xyz"]
    if len(parts) != int(record["parts"]) or not np.allclose(extents(parts), sides, atol=_TOLERANCE):
        raise VerificationError(
            f"expected {record['name']} with {record['parts']} convex parts and sides {sides} m, received "
            f"{len(parts)} parts and {extents(parts).round(5).tolist()} m: the download is damaged or another mesh"
        )
