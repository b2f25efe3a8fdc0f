"""Files that are either there whole or not at all, and folders that one process at a time writes to."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ggcnn_net2net.errors import GGCNNError

if TYPE_CHECKING:
    import h5py


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; when the block succeeds, sync it to disk and rename it to `path`.

    When the block raises, the temporary file is removed and whatever was at `path` stays as it was.

    Args:
        path: file to create or replace; its folder is created if it is missing.

    Yields:
        The temporary path, with the suffix of `path`.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # The suffix stays last, for libraries that choose a format by it. Machines that share a disk may share process ids.
    temporary = path.with_name(f".{path.stem}.{secrets.token_hex(4)}.tmp{path.suffix}")
    try:
        yield temporary
        with temporary.open("rb") as stream:
            os.fsync(stream.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8 to `path`, whole or not at all."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def is_one_of(path: Path, inputs: Iterable[Path | None]) -> bool:
    """Whether writing `path` would overwrite a file that is read, under whatever name; None is passed over."""
    return path.exists() and any(read is not None and read.exists() and path.samefile(read) for read in inputs)


@contextmanager
def new_hdf5(path: Path) -> Iterator[h5py.File]:
    """Open a new HDF5 file for writing, through a file object of Python.

    HDF5's own driver is no quicker, and where the disk is full it ends with a RuntimeError or kills the process when it
    closes the file. A file object raises OSError.

    Args:
        path: the file, to be written whole: a temporary one of `replacing`.

    Yields:
        The open file.
    """
    import h5py  # slow to import

    with path.open("w+b") as stream, h5py.File(stream, "w") as file:
        yield file


@contextmanager
def alone(lock_file: Path, refusal: GGCNNError) -> Iterator[None]:
    """Run a block that only one process at a time may be in; a process that ends, however it ends, releases the lock.

    Args:
        lock_file: identifies the block; it is left behind, and its folder is created if it is missing.
        refusal: raised if another process is in the block.
    """
    from filelock import FileLock, Timeout

    lock_file.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(lock_file)
    try:
        lock.acquire(timeout=0)
    except Timeout as error:
        raise refusal from error
    try:
        yield
    finally:
        lock.release()
