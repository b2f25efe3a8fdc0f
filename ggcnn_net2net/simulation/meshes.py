"""Meshes of convex parts: reading them, measuring them, and decomposing other meshes into them.

In the simulation an object is an OBJ file in which every `o` group is one convex part. pybullet makes a convex hull
of each group, and the same file is drawn, so that the camera sees exactly what the gripper touches (as in the public
code of the paper, which draws the convex decomposition).
"""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.atomic import replacing
from ggcnn_net2net.errors import ObjectSetError
from ggcnn_net2net.quiet import silence_output

Vertices = npt.NDArray[np.float64]


def read_parts(path: Path) -> list[Vertices]:
    """Vertices (n, 3) of every `o` group of an OBJ file, in the file's units.

    Raises:
        ObjectSetError: no such file, no vertices, or coordinates that are no finite numbers.
    """
    parts: list[list[list[float]]] = [[]]
    try:
        with path.open(encoding="utf-8", errors="replace") as lines:
            for line in lines:
                if line.startswith("o "):
                    parts.append([])
                elif line.startswith("v "):
                    parts[-1].append([float(value) for value in line.split()[1:4]])
        arrays = [np.array(part, dtype=np.float64).reshape(-1, 3) for part in parts if part]
    except (OSError, ValueError) as error:
        raise ObjectSetError(f"expected {path} to be an OBJ mesh, cannot read it: {error}") from error
    if not arrays or not all(np.isfinite(part).all() for part in arrays):
        raise ObjectSetError(f"expected {path} to hold finite vertices, received none or NaN: export the mesh again")
    return arrays


def vertex_mean(parts: list[Vertices]) -> Vertices:
    """Mean of all vertices: the centre that the paper's public code uses."""
    return np.concatenate(parts).mean(axis=0)


def centre_of_mass(parts: list[Vertices]) -> Vertices:
    """Centre of mass of convex parts of equal density; where parts overlap, the overlap counts twice.

    Raises:
        ObjectSetError: a part that is flat, or has fewer than four corners.
    """
    from scipy.spatial import ConvexHull, QhullError  # workers of the benchmark never need it

    moment, total = np.zeros(3), 0.0
    for number, part in enumerate(parts, start=1):
        try:
            hull = ConvexHull(part)
        except (QhullError, ValueError) as error:
            raise ObjectSetError(
                f"expected convex parts with a volume, received part {number} of {len(parts)} with {len(part)} corners "
                "that have none: decompose the mesh again"
            ) from error
        inside = part[hull.vertices].mean(axis=0)
        corners = part[hull.simplices] - inside  # tetrahedra from an inner point to each triangle
        volumes = np.abs(np.linalg.det(corners)) / 6
        moment += volumes @ (corners.sum(axis=1) / 4 + inside)
        total += volumes.sum()
    return moment / total


def extents(parts: list[Vertices]) -> Vertices:
    """Side lengths of the axis-aligned bounding box."""
    vertices = np.concatenate(parts)
    return np.ptp(vertices, axis=0)


def convex_decomposition(mesh: Path, cache: Path) -> Path:
    """Decompose any mesh into convex parts with pybullet's V-HACD; made once and kept by content in `cache`.

    Args:
        mesh: .obj, .stl, .ply, .glb or whatever else trimesh reads.
        cache: folder for the result.

    Returns:
        Path of an OBJ of convex parts, in the units of `mesh`.

    Raises:
        ObjectSetError: the mesh cannot be read or decomposed.
    """
    import pybullet
    import trimesh

    try:
        content = mesh.read_bytes()
        result = cache / f"{mesh.stem}-{hashlib.sha256(content).hexdigest()[:16]}_vhacd.obj"
        if result.is_file():
            return result
        loaded = trimesh.load_mesh(mesh)
        with tempfile.TemporaryDirectory() as folder, replacing(result) as temporary:
            source = Path(folder) / "mesh.obj"
            source.write_text(trimesh.exchange.obj.export_obj(loaded, include_texture=False))
            with silence_output():
                pybullet.vhacd(str(source), str(temporary), str(Path(folder) / "log.txt"))
            if not temporary.is_file():
                raise ObjectSetError(
                    f"pybullet's V-HACD made nothing of {mesh}: repair the mesh or decompose it by hand"
                )
            read_parts(temporary)
    except ObjectSetError:
        raise
    except Exception as error:  # trimesh raises whatever its format readers raise
        raise ObjectSetError(f"expected {mesh} to be a mesh that trimesh reads, received: {error!r}") from error
    return result
