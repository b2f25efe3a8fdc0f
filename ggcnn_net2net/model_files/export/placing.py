"""Several files and folders that go into place together, once all of them are whole."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def placing(folder: Path, last: str) -> Iterator[Path]:
    """Give an empty temporary folder within `folder`; when the block ends well, its content moves into `folder`.

    Everything is synced to disk first. What stands there under the same names is replaced: a file by one rename, a
    folder by two, since no rename replaces a folder that is not empty. When the block raises, or a move fails, whatever
    stood in `folder` stands there again.

    Args:
        folder: where to; made if it is missing.
        last: name of the file that moves last, so that it vouches for the others.

    Yields:
        The temporary folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    temporary = folder / f".{last}.{secrets.token_hex(4)}.tmp"
    new, old = temporary / "new", temporary / "old"
    try:
        old.mkdir(parents=True)
        new.mkdir()
        yield new
        for file in new.rglob("*"):
            _sync(file)
        _move(sorted(new.iterdir(), key=lambda path: (path.name == last, path.name)), folder, old)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _move(paths: list[Path], folder: Path, old: Path) -> None:
    """Move everything to `folder`; what stood there goes to `old`, and back again if a move fails."""
    try:
        for path in paths:
            target = folder / path.name
            if target.is_dir():
                target.rename(old / path.name)
            elif target.exists():
                shutil.copy2(target, old / path.name)
            path.replace(target)
        _sync(folder)
    except BaseException:
        for path in paths:
            _restore(path, folder / path.name, old / path.name)
        raise


def _restore(path: Path, target: Path, before: Path) -> None:
    """Bring `target` back to what it was before `path` was to be moved there; `before` is what was kept of that."""
    has_moved = not path.exists()
    if has_moved and target.is_dir():
        shutil.rmtree(target)
    elif has_moved:
        target.unlink(missing_ok=True)
    if before.is_dir() or (has_moved and before.exists()):  # the copy of a file may be half a copy if it has not moved
        before.replace(target)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
