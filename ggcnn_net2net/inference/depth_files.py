"""Depth images on disk: which files of a folder are some, reading them, and noticing new ones."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.datasets.raw import read_image
from ggcnn_net2net.errors import DatasetError, DepthImageError

SUFFIXES = (".png", ".tif", ".tiff", ".npy", ".npz")
_PNG = (b"\x89PNG\r\n\x1a\n", 24, b"\x10\x00")  # signature; where 16 bits a sample, one grey sample a pixel, is written


def read_depth_file(path: Path) -> npt.NDArray[Any]:
    """The depth image of a file as it is stored, in whatever unit.

    Args:
        path: .png of 16 bits, .tif or .tiff, .npy, or .npz with one array or one that is named "depth".

    Raises:
        DepthImageError: no such file, or not a depth image.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise DepthImageError(f"expected a depth image, one of {', '.join(SUFFIXES)}, received {path}")
    try:
        image = _read_array(path) if suffix in (".npy", ".npz") else read_image(path)
    except DatasetError as error:
        raise DepthImageError(str(error)) from error
    except (OSError, ValueError, EOFError, BadZipFile, zlib.error) as error:
        # NumPy's own message would advise to trust the file, which is not for us to say.
        raise DepthImageError(f"expected a whole {suffix} file of numbers, cannot read {path}") from error
    if image.ndim != 2 or image.dtype.kind not in "iuf" or image.dtype.itemsize == 1:
        raise DepthImageError(
            f"expected a depth image (H, W) of 16 bits or more a pixel in {path}, received {image.dtype} "
            f"{image.shape}: pictures of depth in 8 bits or colours have lost it"
        )
    return image


def depth_files(folder: Path) -> list[Path]:
    """The depth images in a folder, ordered by name; its sub-folders are not looked into.

    All files with one of `SUFFIXES`, PNGs only if they have one channel of 16 bits: the others are colour images, which
    lie beside the depth in datasets.

    Raises:
        DepthImageError: no such folder.
    """
    try:
        paths = sorted(folder.iterdir())
    except OSError as error:
        raise DepthImageError(f"cannot look into the folder {folder}: {error.strerror}") from error
    files = (
        path for path in paths if path.suffix.lower() in SUFFIXES and not path.name.startswith(".") and path.is_file()
    )
    return [path for path in files if path.suffix.lower() != ".png" or _is_deep_png(path)]


class FolderWatch:
    """Notices depth images that are written to a folder after the watch began, new ones and old ones written again."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._handled = self._states()
        self._last = dict(self._handled)

    def ready(self) -> list[Path]:
        """Files that are to be processed; each is named once until it is written again.

        A file counts as completely written when it is the same, in size and time, as at the previous call.
        """
        states = self._states()
        ready = [
            path for path, state in states.items() if self._last.get(path) == state and self._handled.get(path) != state
        ]
        self._handled.update((path, states[path]) for path in ready)
        self._last = states
        return ready

    def _states(self) -> dict[Path, tuple[int, int]]:
        states = {}
        for path in depth_files(self._folder):
            try:
                status = path.stat()
            except FileNotFoundError:  # gone meanwhile
                continue
            states[path] = (status.st_size, status.st_mtime_ns)
        return states


def _read_array(path: Path) -> npt.NDArray[Any]:
    content = np.load(path, allow_pickle=False)
    if isinstance(content, np.ndarray):
        return content
    with content:
        names = content.files
        if len(names) != 1 and "depth" not in names:
            raise DepthImageError(f"expected one array, or one named depth, in {path}, received {', '.join(names)}")
        return content[names[0] if len(names) == 1 else "depth"]


def _is_deep_png(path: Path) -> bool:
    signature, offset, deep = _PNG
    try:
        with path.open("rb") as stream:
            header = stream.read(offset + len(deep))
    except OSError:
        return False
    return header.startswith(signature) and header[offset:] == deep
