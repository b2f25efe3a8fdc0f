"""Read the tensors of a PyTorch checkpoint without PyTorch, and without running anything it says.

A checkpoint is a pickle that calls functions to rebuild each tensor from a storage of raw numbers. Here only the few
names that a state_dict needs exist; a pickle that asks for any other is refused before it can act. Two containers are
in use: a zip archive (PyTorch 1.6 on), and before that several pickles in a row followed by the storages.

Reference: torch.save and torch.load, torch/serialization.py of the PyTorch project.
"""

from __future__ import annotations

import io
import pickle
import zipfile
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np

from ggcnn_net2net.errors import ModelFileError

_LEGACY_MAGIC = 0x1950A86A20F9469CFC6C
_MAX_BYTES = 1 << 30  # far above any GG-CNN; a hostile size fails here and not in the allocator

_STORAGES = {
    "DoubleStorage": np.dtype("<f8"),
    "FloatStorage": np.dtype("<f4"),
    "HalfStorage": np.dtype("<f2"),
    "IntStorage": np.dtype("<i4"),
    "LongStorage": np.dtype("<i8"),
}


def read_state_dict(path: Path) -> dict[str, np.ndarray]:
    """Read a PyTorch state_dict.

    Returns:
        Name -> array, in the file's order.

    Raises:
        ModelFileError: not a PyTorch checkpoint, damaged, not a plain state_dict, or a pickle that asks for anything
            but tensors.
    """
    try:
        content = path.read_bytes()
        tensors = _read_archive(content) if zipfile.is_zipfile(path) else _read_legacy(content)
    except ModelFileError:
        raise
    except Exception as error:  # a damaged pickle can raise anything
        raise ModelFileError(
            f"expected a PyTorch state_dict, received a damaged file or another kind ({path.stat().st_size} bytes): "
            f"{error!r}; fetch it again, or save it with torch.save(net.state_dict(), path)"
        ) from error
    if not isinstance(tensors, dict) or not all(isinstance(value, np.ndarray) for value in tensors.values()):
        raise ModelFileError(
            "expected a PyTorch state_dict (names and tensors), received another object: save it with "
            "torch.save(net.state_dict(), path)"
        )
    return dict(tensors)


def _read_archive(content: bytes) -> Any:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        pickled = next(name for name in archive.namelist() if name.rsplit("/", 1)[-1] == "data.pkl")
        folder = pickled.removesuffix("data.pkl")
        unpickler = _TensorUnpickler(archive.open(pickled))
        tensors = unpickler.load()
        for key, storage in unpickler.storages.items():
            _fill(storage, archive.read(f"{folder}data/{key}"))
    return tensors


def _read_legacy(content: bytes) -> Any:
    stream = io.BytesIO(content)
    if _TensorUnpickler(stream).load() != _LEGACY_MAGIC:
        raise ValueError("its magic number is missing")
    _TensorUnpickler(stream).load()  # protocol version
    _TensorUnpickler(stream).load()  # byte order and type sizes of the writing machine
    unpickler = _TensorUnpickler(stream)
    tensors = unpickler.load()
    for key in _TensorUnpickler(stream).load():
        storage = unpickler.storages[key]
        size = int.from_bytes(stream.read(8), "little")
        _fill(storage, stream.read(size * storage.itemsize))
    return tensors


def _fill(storage: np.ndarray, numbers: bytes) -> None:
    if len(numbers) != storage.nbytes:
        raise ValueError(f"a storage of {storage.nbytes} bytes has {len(numbers)}")
    storage[:] = np.frombuffer(numbers, storage.dtype)


class _TensorUnpickler(pickle.Unpickler):
    """Unpickler that knows tensors and nothing else. Storages are made empty and filled by the caller."""

    def __init__(self, stream: IO[bytes]) -> None:
        super().__init__(stream)
        self.storages: dict[str, np.ndarray] = {}

    def find_class(self, module: str, name: str) -> Any:
        if module in {"torch", "torch.storage"} and name in _STORAGES:
            return _STORAGES[name]
        if (module, name) in _ALLOWED:
            return _ALLOWED[module, name]
        raise ModelFileError(
            f"refused, because its pickle asks for {module}.{name}, and loading it could run code: save the weights "
            "alone with torch.save(net.state_dict(), path)"
        )

    def persistent_load(self, pid: Any) -> np.ndarray:
        kind, dtype, key, _device, size = pid[:5]
        if kind != "storage" or not isinstance(dtype, np.dtype) or not 0 <= size * dtype.itemsize <= _MAX_BYTES:
            raise ValueError(f"not a storage of numbers: {pid!r}")
        return self.storages.setdefault(key, np.zeros(size, dtype))


def _rebuild_tensor(storage: np.ndarray, offset: int, shape: tuple, strides: tuple, *_: Any) -> np.ndarray:
    """View of a storage; PyTorch counts offset and strides in numbers, NumPy in bytes."""
    last = offset + sum((n - 1) * step for n, step in zip(shape, strides, strict=True))
    if min(offset, *shape, *strides, 0) < 0 or (0 not in shape and last >= len(storage)):
        raise ValueError(f"a tensor of shape {shape} reaches outside its storage")
    byte_strides = [step * storage.itemsize for step in strides]
    return np.lib.stride_tricks.as_strided(storage[offset:], shape, byte_strides, writeable=False)


def _rebuild_parameter(tensor: np.ndarray, *_: Any) -> np.ndarray:
    return tensor


_ALLOWED: dict[tuple[str, str], Callable] = {
    ("collections", "OrderedDict"): OrderedDict,
    ("torch._utils", "_rebuild_tensor_v2"): _rebuild_tensor,
    ("torch._utils", "_rebuild_parameter"): _rebuild_parameter,
}
