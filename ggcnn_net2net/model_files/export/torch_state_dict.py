"""A PyTorch state_dict for class GGCNN of github.com/dougsm/ggcnn, written without PyTorch.

The file is what torch.save makes of an OrderedDict of tensors: a zip archive with the raw numbers of each tensor and a
pickle that says how they become tensors. The pickle is put together here from its opcodes (protocol 2, described in
Python's pickletools), because the pickle module writes only names that it can import.
"""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.model_files.export.runtime import Job, Runtime
from ggcnn_net2net.model_files.torch_ggcnn import read_torch, torch_tensors_of

if TYPE_CHECKING:
    import keras

_EPOCH = (1980, 1, 1, 0, 0, 0)  # the same file every time
_ORDERED_DICT = b"ccollections\nOrderedDict\n)R"  # a new, empty one


def write_torch(job: Job, path: Path) -> None:
    """Write the file.

    Raises:
        ExportError: class GGCNN cannot compute what the network computes.
    """
    write_state_dict(torch_tensors_of(job.model), path)


def write_state_dict(tensors: Mapping[str, npt.NDArray[np.float32]], path: Path) -> None:
    """Write float32 tensors under their names, so that `torch.load` reads them, with `weights_only=True` too."""
    entries = b"".join(
        _text(name) + _tensor(str(key), tensor.shape) for key, (name, tensor) in enumerate(tensors.items())
    )
    members = {
        "data.pkl": b"\x80\x02" + _ORDERED_DICT + b"(" + entries + b"u.",
        "byteorder": b"little",
        **{f"data/{key}": tensor.astype("<f4").tobytes() for key, tensor in enumerate(tensors.values())},
        "version": b"3\n",
    }
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:  # PyTorch reads no compressed members
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(f"{path.stem}/{name}", _EPOCH), content)


def _tensor(key: str, shape: tuple[int, ...]) -> bytes:
    """_rebuild_tensor_v2(storage, offset, shape, strides, requires_grad, hooks) of a contiguous tensor."""
    strides = [int(np.prod(shape[axis + 1 :])) for axis in range(len(shape))]
    storage = [_text("storage"), b"ctorch\nFloatStorage\n", _text(key), _text("cpu"), _integer(int(np.prod(shape)))]
    arguments = [
        _tuple(storage) + b"Q",
        _integer(0),
        _tuple([_integer(side) for side in shape]),
        _tuple([_integer(stride) for stride in strides]),
        b"\x89",
        _ORDERED_DICT,
    ]
    return b"ctorch._utils\n_rebuild_tensor_v2\n" + _tuple(arguments) + b"R"


def _tuple(items: list[bytes]) -> bytes:
    return b"(" + b"".join(items) + b"t"


def _integer(value: int) -> bytes:
    return b"J" + struct.pack("<i", value)


def _text(value: str) -> bytes:
    encoded = value.encode()
    return b"X" + struct.pack("<I", len(encoded)) + encoded


def open_torch(path: Path) -> Runtime:
    """Read the file back as class GGCNN would and run that network, so that PyTorch need not be installed."""

    @cache
    def network(size: int) -> keras.Model:
        return read_torch(path, size).model

    return Runtime(HEADS, lambda image: [output.numpy() for output in network(image.shape[1])(image, training=False)])
