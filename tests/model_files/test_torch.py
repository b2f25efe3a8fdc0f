"""The PyTorch GG-CNN: read without PyTorch and without running anything, equal to a slow reference."""

from __future__ import annotations

import builtins
import io
import os
import pickle
import sys
import types
import zipfile
from collections import OrderedDict

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from ggcnn_net2net.architecture import HEADS, ORIGINAL, architecture_of
from ggcnn_net2net.errors import ModelFileError
from ggcnn_net2net.model_files import load_ggcnn, save_ggcnn
from ggcnn_net2net.model_files.torch_tensors import read_state_dict

REAL_FILE = "original_ggcnn_weights/pytorch/ggcnn_epoch_23_cornell_statedict.pt"
CONTAINERS = pytest.mark.parametrize("container", ["archive", "legacy"])

# Shapes of the tensors in a state_dict of GG-CNN; (out, in, h, w), transposed ones (in, out, h, w).
SHAPES = {
    "conv1": (32, 1, 9, 9), "conv2": (16, 32, 5, 5), "conv3": (8, 16, 3, 3), "convt1": (8, 8, 3, 3),
    "convt2": (8, 16, 5, 5), "convt3": (16, 32, 9, 9), "pos_output": (1, 32, 2, 2), "cos_output": (1, 32, 2, 2),
    "sin_output": (1, 32, 2, 2), "width_output": (1, 32, 2, 2),
}  # fmt: skip


class Storage:
    """Numbers that a checkpoint stores once, for any number of tensors."""

    def __init__(self, numbers: np.ndarray) -> None:
        self.numbers = np.ascontiguousarray(numbers).ravel()


class Tensor:
    """Pickles as PyTorch's tensors do."""

    def __init__(self, storage: Storage, offset: int, shape: tuple, strides: tuple) -> None:
        self.state = (storage, offset, shape, strides, False, OrderedDict())

    @classmethod
    def of(cls, array: np.ndarray) -> Tensor:
        return cls(Storage(array), 0, array.shape, tuple(step // array.itemsize for step in array.strides))

    def __reduce__(self):
        return sys.modules["torch._utils"]._rebuild_tensor_v2, self.state


class Pickler(pickle.Pickler):
    def __init__(self, stream) -> None:
        super().__init__(stream, protocol=2)
        self.storages: dict[str, Storage] = {}

    def persistent_id(self, value):
        if not isinstance(value, Storage):
            return None
        self.storages[str(id(value))] = value
        kind = {"f4": "FloatStorage", "f8": "DoubleStorage", "i8": "LongStorage"}[value.numbers.dtype.str[1:]]
        return ("storage", getattr(sys.modules["torch"], kind), str(id(value)), "cuda:0", len(value.numbers))


@pytest.fixture
def write_checkpoint(tmp_path, monkeypatch):
    """Function (object, container): write it as torch.save does; PyTorch's own names are stand-ins."""
    torch, utils = types.ModuleType("torch"), types.ModuleType("torch._utils")
    for kind in ("FloatStorage", "DoubleStorage", "LongStorage"):
        setattr(torch, kind, type(kind, (), {"__module__": "torch"}))

    def _rebuild_tensor_v2() -> None: ...

    _rebuild_tensor_v2.__module__, _rebuild_tensor_v2.__qualname__ = "torch._utils", "_rebuild_tensor_v2"
    utils._rebuild_tensor_v2 = _rebuild_tensor_v2

    def write(content, container="archive"):
        monkeypatch.setitem(sys.modules, "torch", torch)
        monkeypatch.setitem(sys.modules, "torch._utils", utils)
        path = tmp_path / f"{container}.pt"
        stream = io.BytesIO()
        pickler = Pickler(stream)
        pickler.dump(content)
        monkeypatch.delitem(sys.modules, "torch")
        monkeypatch.delitem(sys.modules, "torch._utils")
        if container == "archive":
            with zipfile.ZipFile(path, "w") as archive:
                archive.writestr("net/data.pkl", stream.getvalue())
                for key, storage in pickler.storages.items():
                    archive.writestr(f"net/data/{key}", storage.numbers.tobytes())
                archive.writestr("net/version", "3\n")
        else:
            head = b"".join(pickle.dumps(item, 2) for item in (0x1950A86A20F9469CFC6C, 1001, {"little_endian": True}))
            keys = pickle.dumps(list(pickler.storages), 2)
            numbers = b"".join(
                len(storage.numbers).to_bytes(8, "little") + storage.numbers.tobytes()
                for storage in pickler.storages.values()
            )
            path.write_bytes(head + stream.getvalue() + keys + numbers)
        return path

    return write


def random_state() -> OrderedDict:
    rng = np.random.default_rng(3)
    state = OrderedDict()
    for name, shape in SHAPES.items():
        n_out = shape[1] if name.startswith("convt") else shape[0]
        state[f"{name}.weight"] = rng.normal(0, np.sqrt(2 / np.prod(shape[1:])), shape).astype("float32")
        state[f"{name}.bias"] = rng.normal(0, 0.1, n_out).astype("float32")
    return state


def convolve(image, weight, bias, stride, padding):
    """What torch.nn.Conv2d computes for one image (channels, h, w)."""
    image = np.pad(image, ((0, 0), (padding, padding), (padding, padding)))
    size = weight.shape[-1]
    height, width = ((side - size) // stride + 1 for side in image.shape[1:])
    out = np.zeros((weight.shape[0], height, width))
    for i in range(size):
        for j in range(size):
            window = image[:, i : i + stride * height : stride, j : j + stride * width : stride]
            out += np.einsum("oc,chw->ohw", weight[:, :, i, j], window[:, :height, :width])
    return out + bias[:, None, None]


def convolve_transposed(image, weight, bias, stride, padding, output_padding):
    """What torch.nn.ConvTranspose2d computes for one image: every pixel spreads the kernel, then the rim is cut."""
    size = weight.shape[-1]
    height, width = image.shape[1:]
    full = [(side - 1) * stride + size + output_padding for side in (height, width)]
    out = np.zeros((weight.shape[1], *full))
    for i in range(size):
        for j in range(size):
            target = out[:, i : i + stride * height : stride, j : j + stride * width : stride]
            target[:, :height, :width] += np.einsum("co,chw->ohw", weight[:, :, i, j], image)
    rows, cols = (slice(padding, side - padding) for side in full)
    return out[:, rows, cols] + bias[:, None, None]


def reference_maps(state, image):
    """The forward pass of class GGCNN in models/ggcnn.py of github.com/dougsm/ggcnn, in float64."""

    def of(name):
        return state[f"{name}.weight"].astype("float64"), state[f"{name}.bias"].astype("float64")

    out = image[None].astype("float64")
    for name, stride, padding in (("conv1", 3, 3), ("conv2", 2, 2), ("conv3", 2, 1)):
        out = np.maximum(convolve(out, *of(name), stride, padding), 0)
    for name, stride, padding in (("convt1", 2, 1), ("convt2", 2, 2), ("convt3", 3, 3)):
        out = np.maximum(convolve_transposed(out, *of(name), stride, padding, 1), 0)
    return [convolve(out, *of(name.replace("_out", "_output")), 1, 0)[0] for name in HEADS]


def assert_equals_reference(path) -> None:
    model = load_ggcnn(path)
    assert model.count_params() == 62_420
    assert architecture_of(model) == ORIGINAL
    image = np.random.default_rng(0).normal(0, 0.1, (300, 300))
    image[80:150, 100:210] -= 0.2
    expected = reference_maps(read_state_dict(path), image)
    received = model(image[None, :, :, None].astype("float32"))
    for ours, theirs in zip(received, expected, strict=True):
        assert_allclose(np.asarray(ours)[0, :, :, 0], theirs, atol=1e-5 * np.abs(theirs).max())


def test_the_published_pytorch_weights_equal_the_reference(data_root):
    assert_equals_reference(data_root / REAL_FILE)


@CONTAINERS
def test_random_weights_equal_the_reference(container, write_checkpoint):
    state = OrderedDict((name, Tensor.of(array)) for name, array in random_state().items())
    assert_equals_reference(write_checkpoint(state, container))


def test_the_converted_network_survives_saving(data_root, maps, tmp_path):
    model = load_ggcnn(data_root / REAL_FILE)
    for suffix in (".hdf5", ".keras"):
        again = load_ggcnn(save_ggcnn(model, tmp_path / f"converted{suffix}"))
        assert architecture_of(again) == ORIGINAL
        for ours, theirs in zip(maps(again), maps(model), strict=True):
            assert_array_equal(ours, theirs)


@CONTAINERS
def test_views_of_a_shared_storage(container, write_checkpoint):
    storage = Storage(np.arange(12, dtype="float32"))
    state = {"rows": Tensor(storage, 2, (2, 3), (3, 1)), "turned": Tensor(storage, 0, (3, 4), (1, 3)),
             "long": Tensor.of(np.array([5, -7])), "double": Tensor.of(np.array([[0.1]]))}  # fmt: skip
    read = read_state_dict(write_checkpoint(state, container))
    assert_array_equal(read["rows"], [[2, 3, 4], [5, 6, 7]])
    assert_array_equal(read["turned"], np.arange(12).reshape(4, 3).T)
    assert_array_equal(read["long"], [5, -7])
    assert read["double"].dtype == "float64"


@pytest.mark.parametrize(
    ("offset", "shape", "strides"),
    [(0, (5,), (1,)), (3, (2,), (1,)), (-1, (2,), (1,)), (0, (2,), (-1,)), (0, (2, 2), (3, 1)), (9, (1,), (1,))],
)
def test_tensors_that_reach_outside_their_storage(offset, shape, strides, write_checkpoint):
    path = write_checkpoint({"x": Tensor(Storage(np.zeros(4, "float32")), offset, shape, strides)})
    with pytest.raises(ModelFileError, match="outside its storage"):
        read_state_dict(path)


class Attack:
    """Unpickles by calling a function."""

    def __init__(self, function, *arguments) -> None:
        self.call = function, arguments

    def __reduce__(self):
        return self.call


@CONTAINERS
@pytest.mark.parametrize("function", [os.system, builtins.eval, builtins.exec, builtins.__import__, getattr])
def test_pickles_that_call_anything_are_refused_unrun(container, function, write_checkpoint, tmp_path):
    proof = tmp_path / "proof"
    script = f"touch {proof}" if function is os.system else f"open({str(proof)!r}, 'w').close()"
    for content in (Attack(function, script), {"conv1.weight": Attack(function, script)}):
        path = write_checkpoint(content, container)
        with pytest.raises(ModelFileError, match="refused, because its pickle asks for"):
            load_ggcnn(path)
        assert not proof.exists()


def test_whole_networks_are_refused_with_advice(write_checkpoint):
    """torch.save(net) pickles the class of the network, whose import could run anything."""
    with pytest.raises(ModelFileError, match=r"state_dict\(\)"):
        load_ggcnn(write_checkpoint(OrderedDict(net=Storage)))


@CONTAINERS
@pytest.mark.parametrize("kept", [0.0, 0.002, 0.5, 0.99])
def test_truncated_checkpoints(container, kept, write_checkpoint):
    state = {name: Tensor.of(array) for name, array in random_state().items()}
    path = write_checkpoint(state, container)
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(ModelFileError, match="damaged"):
        load_ggcnn(path)


def test_a_storage_cut_to_one_number_is_not_spread_over_the_tensor(write_checkpoint, tmp_path):
    path = write_checkpoint({"x": Tensor.of(np.arange(4, dtype="float32"))})
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(tmp_path / "cut.pt", "w") as target:
        for name in source.namelist():
            target.writestr(name, source.read(name)[:4] if "/data/" in name else source.read(name))
    with pytest.raises(ModelFileError, match="a storage of 16 bytes has 4"):
        read_state_dict(tmp_path / "cut.pt")


@CONTAINERS
@pytest.mark.parametrize("content", [[1, 2], "text", {"epoch": 3}, {"net": {"conv1.weight": 1}}, None])
def test_checkpoints_without_tensors(container, content, write_checkpoint):
    with pytest.raises(ModelFileError, match="state_dict"):
        load_ggcnn(write_checkpoint(content, container))


def test_state_dicts_of_other_networks(write_checkpoint):
    state = random_state()
    state["conv1.weight"] = np.repeat(state["conv1.weight"], 4, axis=1)  # colour and depth
    del state["conv2.bias"]
    state["features.0.weight"] = np.zeros((3, 3), "float32")
    path = write_checkpoint({name: Tensor.of(array) for name, array in state.items()})
    with pytest.raises(ModelFileError) as caught:
        load_ggcnn(path)
    for part in ("conv1.weight (32, 4, 9, 9) instead of (32, 1, 9, 9)", "conv2.bias missing", "features.0.weight"):
        assert part in str(caught.value)


def test_weights_that_are_not_finite(write_checkpoint):
    state = random_state()
    state["convt2.weight"][0, 0, 0, 0] = np.nan
    with pytest.raises(ModelFileError, match="NaN or infinity in conv2d_transpose_2"):
        load_ggcnn(write_checkpoint({name: Tensor.of(array) for name, array in state.items()}))


def test_hostile_sizes_do_not_exhaust_memory(write_checkpoint, monkeypatch):
    huge = Storage(np.zeros(4, "float32"))
    monkeypatch.setattr(Pickler, "persistent_id", lambda self, value: (
        ("storage", sys.modules["torch"].FloatStorage, "0", "cpu", 1 << 60) if value is huge else None
    ))  # fmt: skip
    with pytest.raises(ModelFileError, match="not a storage"):
        read_state_dict(write_checkpoint({"x": Tensor(huge, 0, (4,), (1,))}))
