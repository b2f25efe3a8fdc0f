"""Where files that the package does not ship are looked for, and how they are fetched.

Order: the folder named by the environment variable `GGCNN_NET2NET_DATA`, the source checkout, the user's cache, a
download into that cache. A file is used only after its SHA-256 was checked.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import platformdirs
import requests
from filelock import FileLock
from rich.console import Console
from rich.progress import (
    BarColumn,
    DownloadColumn,
    Progress,
    TextColumn,
    TimeRemainingColumn,
    TransferSpeedColumn,
)

from ggcnn_net2net.errors import DataNotFoundError, VerificationError

DATA_VARIABLE = "GGCNN_NET2NET_DATA"
_TIMEOUT = (5, 30)  # seconds to connect, seconds without a byte


def data_root() -> Path | None:
    """The folder that `GGCNN_NET2NET_DATA` names, or None.

    Raises:
        DataNotFoundError: the variable names a folder that does not exist.
    """
    value = os.environ.get(DATA_VARIABLE)
    if not value:
        return None
    root = Path(value).expanduser()
    if not root.is_dir():
        raise DataNotFoundError(
            f"expected {DATA_VARIABLE} to name a folder, received {value!r}, which is none: correct or unset it"
        )
    return root


def checkout_root() -> Path:
    """The folder that holds the package: the source checkout when it runs from one."""
    return Path(__file__).resolve().parent.parent


def cache_root() -> Path:
    """The user's cache folder of this package (on Linux `$XDG_CACHE_HOME/ggcnn_net2net`). Not created."""
    return Path(platformdirs.user_cache_dir("ggcnn_net2net"))


def sha256_of(path: Path) -> str:
    """SHA-256 of a file's content, in hex."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def verify(path: Path, sha256: str) -> Path:
    """Return `path` if its content has the expected SHA-256.

    Raises:
        VerificationError: it has another one.
    """
    received = sha256_of(path)
    if received != sha256:
        raise VerificationError(
            f"expected {path} with SHA-256 {sha256}, received {received} ({path.stat().st_size} bytes): the file is "
            "damaged or another one; remove it, and it is looked for elsewhere or downloaded again"
        )
    return path


def download(url: str, target: Path, sha256: str | None = None) -> Path:
    """Fetch `url` into `target` with a progress bar; an interrupted transfer continues where it stopped.

    Only one process downloads a file; others that want the same one wait for it.

    Args:
        url: address of the file.
        target: where it goes, once it is complete and verified. Until then the bytes are in `target` + ".part".
        sha256: its expected SHA-256 in hex; None for files that the caller verifies in another way.

    Raises:
        DataNotFoundError: no network, the server does not have it, or it cannot be written to `target`.
        VerificationError: the content is not the expected one; nothing is left behind.
    """
    replaces = target.exists()
    try:
        with one_at_a_time(target):
            if replaces or not target.exists():  # else another process has fetched it meanwhile
                _fetch(url, target, sha256)
    except OSError as error:  # requests' errors are of this kind, too
        raise DataNotFoundError(f"cannot download {url}: {error}") from error
    return target


@contextmanager
def one_at_a_time(target: Path) -> Iterator[None]:
    """Let only one process at a time make `target`; others wait until it is done.

    Args:
        target: a file; its folder is created if it is missing, and keeps a lock file.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(target.with_name(f".{target.name}.lock")):
        yield


def _fetch(url: str, target: Path, sha256: str | None) -> None:
    part = target.with_name(target.name + ".part")
    _transfer(url, part)
    try:
        if sha256 is not None:
            verify(part, sha256)
    except VerificationError as error:
        part.unlink()
        raise VerificationError(
            f"expected {url} with SHA-256 {sha256}, received another file (a login page of the network?): try again, "
            f"or put the file at {target} by hand"
        ) from error
    part.replace(target)


def _transfer(url: str, part: Path) -> None:
    """Append to `part` what is missing of `url`, or start over where the server cannot continue."""
    offset = part.stat().st_size if part.exists() else 0
    headers = {"Accept-Encoding": "identity"}  # the bytes of the file, of which a part can be asked for
    if offset:
        headers["Range"] = f"bytes={offset}-"
    with requests.get(url, headers=headers, stream=True, timeout=_TIMEOUT) as response:
        if response.status_code == requests.codes.requested_range_not_satisfiable:
            return  # every byte is there already
        response.raise_for_status()
        resumed = response.status_code == requests.codes.partial_content
        offset = offset if resumed else 0
        total = offset + int(response.headers.get("Content-Length", 0)) or None
        columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TransferSpeedColumn())
        with (
            Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True)) as progress,
            part.open("ab" if resumed else "wb") as stream,
        ):
            task = progress.add_task(f"download {url.rsplit('/', 1)[-1]}", total=total, completed=offset)
            for block in response.iter_content(chunk_size=1 << 16):
                stream.write(block)
                progress.advance(task, len(block))
            stream.flush()
            os.fsync(stream.fileno())
