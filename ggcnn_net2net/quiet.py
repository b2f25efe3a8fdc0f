"""Keep what the C code of pybullet and TensorFlow prints out of the terminal and of piped output."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def silence_output() -> Iterator[None]:
    """Drop everything that reaches file descriptors 1 and 2 within the block, C buffers included."""
    sys.stdout.flush()
    sys.stderr.flush()
    libc = ctypes.CDLL(None) if os.name == "posix" else None
    saved = {descriptor: os.dup(descriptor) for descriptor in (1, 2)}
    try:
        with Path(os.devnull).open("wb") as sink:
            for descriptor in saved:
                os.dup2(sink.fileno(), descriptor)
        yield
    finally:
        if libc is not None:
            libc.fflush(None)
        for descriptor, copy in saved.items():
            os.dup2(copy, descriptor)
            os.close(copy)


def import_tensorflow() -> None:
    """Import TensorFlow and Keras without the log lines that they write before logging can be configured."""
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    with silence_output():
        import keras  # noqa: F401
        import tensorflow  # noqa: F401
