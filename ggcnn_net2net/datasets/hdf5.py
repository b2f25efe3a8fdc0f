"""Datasets in the HDF5 layout of the public GG-CNN code (RSS 2018), written and read an image at a time.

A file has a group for each split, "train" and "test", and in it a row for each image in

    img_id            name of the scene (whole numbers in the files of the public code)
    depth_inpainted   (n, H, W) metres minus the image's mean, clipped to ±1
    rgb               (n, H, W, 3) uint8; may be missing
    bounding_boxes    (n, k, 4, 2) corners (row, col) of k or fewer rectangles, the rest zeros
    grasp_points_img  (n, H, W) quality label
    angle_img         (n, H, W) radians
    grasp_width       (n, H, W) pixels
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from functools import lru_cache
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from ggcnn_net2net._version import __version__
from ggcnn_net2net.atomic import new_hdf5, replacing
from ggcnn_net2net.datasets.augmentation import Sample
from ggcnn_net2net.datasets.label_maps import LabelMaps, targets_of
from ggcnn_net2net.errors import DatasetError

FORMAT = "ggcnn_net2net dataset 1"
SPLITS = ("train", "test")
MAPS = ("grasp_points_img", "angle_img", "grasp_width")
"""Datasets of the label maps, in the order of `LabelMaps`."""
_IMAGES = ("depth_inpainted", *MAPS)
_PADDING = 25
"""Rectangles an image has room for at least, as in the public code."""
_COMPRESSION = {"compression": "gzip", "compression_opts": 1}  # any h5py opens it; higher levels gain 2%


class DatasetWriter:
    """Write samples to a file of the layout as they come; the file appears, whole, when the `with` block ends well.

    Example:
        with DatasetWriter(Path("scenes.h5"), {"source": "my scenes"}) as writer:
            writer.add("train", sample)
    """

    def __init__(self, path: Path, attributes: Mapping[str, Any], *, compressed: bool = True) -> None:
        """Prepare to write.

        Args:
            path: file to write; an older one stays until the new one is complete.
            attributes: provenance, anything that JSON can hold: source, seed, split, augmentation. Written last.
            compressed: False makes a file that is several times as large, and quicker to read.
        """
        self._path = Path(path)
        self._attributes = {**attributes, "versions": _versions()}
        self._filters = _COMPRESSION if compressed else {}
        self._digests: dict[str, Any] = {}
        self._split_of: dict[str, str] = {}
        self._shape: tuple[int, ...] = ()

    def __enter__(self) -> DatasetWriter:
        with ExitStack() as stack:
            temporary = stack.enter_context(replacing(self._path))
            self._file = stack.enter_context(new_hdf5(temporary))
            self._seal()  # what JSON cannot hold shows now, not after hours
            stack.callback(self._seal)  # before the file is closed, which is before it is renamed
            self._stack = stack.pop_all()
        return self

    def add(self, split: str, sample: Sample, img_id: str | None = None) -> None:
        """Append a sample to the split "train" or "test".

        Args:
            split: where it goes.
            sample: image and labels, of the same size as those before.
            img_id: what the row is called; None: the name of the sample's scene.

        Raises:
            DatasetError: another split or size, depth that is not finite, or an img_id that the other split has too.
        """
        name = sample.name if img_id is None else img_id
        self._check(split, name, sample)
        group = self._file[split] if split in self._file else self._start(split, sample.depth.shape)
        row = len(group["img_id"])
        for dataset in group.values():
            dataset.resize(row + 1, axis=0)
        boxes = group["bounding_boxes"]
        if len(sample.rectangles) > boxes.shape[1]:
            boxes.resize(len(sample.rectangles), axis=1)
        boxes[row, : len(sample.rectangles)] = sample.rectangles
        group["img_id"][row] = name
        group["rgb"][row] = sample.rgb
        group["depth_inpainted"][row] = sample.depth
        for key, values in zip(MAPS, sample.maps, strict=True):
            group[key][row] = values
        _hash_row(self._digests[split], sample)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def _seal(self) -> None:
        self._file.attrs["format"] = FORMAT
        self._file.attrs["provenance"] = json.dumps(self._attributes)
        for split, digest in self._digests.items():
            self._file[split].attrs["fingerprint"] = digest.hexdigest()

    def _check(self, split: str, name: str, sample: Sample) -> None:
        if split not in SPLITS:
            raise DatasetError(f"expected a split of {' or '.join(SPLITS)}, received {split!r}")
        if self._split_of.setdefault(name, split) != split:
            raise DatasetError(
                f"expected images of {name} in one split, received some for {split} and some for "
                f"{self._split_of[name]}: what is tested on must not be trained on"
            )
        self._shape = self._shape or sample.depth.shape
        shapes = {sample.depth.shape, sample.rgb.shape[:2], *(values.shape for values in sample.maps)}
        if shapes != {self._shape} or len(self._shape) != 2:
            raise DatasetError(f"expected images and maps of size {self._shape}, received {sorted(shapes)} for {name}")
        if not np.isfinite(sample.depth).all():
            raise DatasetError(f"expected finite depth, received NaN or infinity for {name}")

    def _start(self, split: str, shape: tuple[int, ...]) -> Any:
        import h5py

        group = self._file.create_group(split)
        group.create_dataset("img_id", (0,), h5py.string_dtype(), maxshape=(None,), chunks=(1024,))
        boxes = (_PADDING, 4, 2)
        group.create_dataset(
            "bounding_boxes", (0, *boxes), "f8", chunks=(1, *boxes), maxshape=(None, None, 4, 2), **self._filters
        )
        for key, dtype, cell in (("rgb", "u1", (*shape, 3)), *((key, "f4", shape) for key in _IMAGES)):
            # Halves the size of depth; slows the reading of the maps.
            shuffle = bool(self._filters) and key == "depth_inpainted"
            group.create_dataset(
                key, (0, *cell), dtype, chunks=(1, *cell), maxshape=(None, *cell), shuffle=shuffle, **self._filters
            )
        self._digests[split] = hashlib.sha256()
        return group


class GraspDataset:
    """One split of a file in the layout, of this package or of the public GG-CNN code: training data.

    Images are read when they are asked for, and never kept. Pickled, it carries only the path; use one object a thread.
    """

    def __init__(self, path: Path, split: str) -> None:
        """Open a split.

        Args:
            path: the file.
            split: "train" or "test".

        Raises:
            DatasetError: no such file or split, or datasets that are missing or have other shapes.
        """
        self.path = Path(path)
        self.split = split
        self._open()

    def __len__(self) -> int:
        return len(self._group["img_id"])

    def __getstate__(self) -> tuple[Path, str]:
        return self.path, self.split

    def __setstate__(self, state: tuple[Path, str]) -> None:
        self.path, self.split = state
        self._open()

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the images."""
        return tuple(self._group["depth_inpainted"].shape[1:])

    @property
    def attributes(self) -> dict[str, Any]:
        """Provenance: what the writer was given, and the versions it ran with. Empty for files of others."""
        return dict(json.loads(self._file.attrs.get("provenance", "{}")))

    @property
    def image_ids(self) -> list[str]:
        """Name of each row's scene; several rows may show one scene."""
        return [_text(value) for value in self._group["img_id"][:]]

    @property
    def fingerprint(self) -> str:
        """SHA-256 of depth, maps and rectangles of all rows, in hex; kept in the file by `DatasetWriter`.

        For files of others, everything is read to compute it, once a process as long as the file stays as it is.
        """
        kept = self._group.attrs.get("fingerprint")
        if kept:
            return str(kept)
        state = self.path.stat()
        return _computed_fingerprint(self.path.resolve(), self.split, state.st_size, state.st_mtime_ns)

    @property
    def has_fingerprint(self) -> bool:
        """Whether the file itself keeps the fingerprint."""
        return bool(self._group.attrs.get("fingerprint"))

    def content_hash(self) -> str:
        """`fingerprint`, computed from what the file holds now."""
        digest = hashlib.sha256()
        for row in range(len(self)):
            _hash_row(digest, self.sample(row))
        return digest.hexdigest()

    def batch(self, rows: Sequence[int], epoch: int = 0) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:  # noqa: ARG002
        """Inputs and targets of some rows.

        Args:
            rows: indices, in any order.
            epoch: makes no difference, a file holds the same images in every epoch.

        Returns:
            (n, H, W, 1) depth and (n, H, W, 4) targets (see `targets_of`), float32.

        Raises:
            DatasetError: a row that does not exist, values that are not finite, a damaged file.
        """
        depth, *maps = (self._read(key, rows) for key in _IMAGES)
        return depth[..., None], targets_of(*maps)

    def depth(self, row: int) -> npt.NDArray[np.float32]:
        """(H, W) depth of a row, as in `batch`; the labels stay unread."""
        return self._read("depth_inpainted", [row])[0]

    def rectangles(self, row: int) -> npt.NDArray[np.float64]:
        """(n, 4, 2) corners (row, col) of a row's rectangles, without the padding."""
        corners = np.asarray(self._read("bounding_boxes", [row])[0], dtype=np.float64)
        return corners[corners.any(axis=(1, 2))]

    def sample(self, row: int) -> Sample:
        """One row with everything it holds; a missing colour image is black."""
        depth, *maps = (self._read(key, [row])[0] for key in _IMAGES)
        rgb = self._read("rgb", [row])[0] if "rgb" in self._group else np.zeros((*self.shape, 3), np.uint8)
        name = _text(self._group["img_id"][row])
        return Sample(name, depth, rgb, self.rectangles(row), LabelMaps(*maps))

    def _read(self, key: str, rows: Sequence[int]) -> npt.NDArray[Any]:
        dataset = self._group[key]
        dtype = {"rgb": np.uint8, "bounding_boxes": np.float64}.get(key, np.float32)
        n_rows = len(self)
        values = np.empty((len(rows), *dataset.shape[1:]), dtype)
        # One by one: h5py takes lists of increasing rows only, and is no quicker with them (a chunk is an image).
        for index, row in enumerate(rows):
            if not 0 <= row < n_rows:
                raise DatasetError(f"expected rows of 0 to {n_rows - 1} in {self._label}, received {row}")
            try:
                dataset.read_direct(values, np.s_[int(row)], np.s_[index])
            except OSError as error:
                raise DatasetError(
                    f"cannot read row {row} of {self._label}/{key}: {error}; make the file anew"
                ) from error
            if key != "rgb" and not np.isfinite(values[index]).all():
                raise DatasetError(f"expected finite {key} in {self._label}, received NaN or infinity in row {row}")
        return values

    @property
    def _label(self) -> str:
        return f"{self.path}:{self.split}"

    def _open(self) -> None:
        import h5py

        if not self.path.is_file():
            raise DatasetError(
                f"expected a dataset file, {self.path} is none: make one with ggcnn-net2net dataset build"
            )
        try:
            self._file = h5py.File(self.path, "r")
        except OSError as error:
            raise DatasetError(f"expected {self.path} to be an HDF5 file: {error}") from error
        group = self._file.get(self.split)
        if not isinstance(group, h5py.Group):
            raise DatasetError(f"expected a split {self.split!r} in {self.path}, received {sorted(self._file)}")
        missing = [key for key in ("img_id", "bounding_boxes", *_IMAGES) if key not in group]
        if missing:
            raise DatasetError(f"expected {', '.join(missing)} in {self._label}, received {', '.join(sorted(group))}")
        size = group["depth_inpainted"].shape[1:]
        rows = len(group["img_id"])
        cells = dict.fromkeys(_IMAGES, size) | {"img_id": (), "rgb": (*size, 3)}
        cells["bounding_boxes"] = (*group["bounding_boxes"].shape[1:2], 4, 2)
        for key in cells.keys() & group.keys():
            expected = (rows, *cells[key])
            if group[key].shape != expected or len(size) != 2:
                raise DatasetError(
                    f"expected {rows} rows of one image size in {self._label}, {key} of shape {expected}, "
                    f"received {group[key].shape}"
                )
        self._group = group


def fingerprints_of(path: Path) -> dict[str, str]:
    """What the images are known by that a search trains and scores on.

    Args:
        path: HDF5 file with the splits "train" and "test".

    Returns:
        `GraspDataset.fingerprint` by split.

    Raises:
        DatasetError: as `GraspDataset`.
    """
    return {split: GraspDataset(path, split).fingerprint for split in ("train", "test")}


@lru_cache
def _computed_fingerprint(path: Path, split: str, size: int, changed: int) -> str:  # noqa: ARG001
    """A search asks for it with every candidate; size and time of the change tell another file of the same name."""
    return GraspDataset(path, split).content_hash()


def _hash_row(digest: Any, sample: Sample) -> None:
    for values in (sample.depth, *sample.maps):
        digest.update(np.asarray(values, dtype="<f4").tobytes())
    digest.update(np.asarray(sample.rectangles, dtype="<f8").tobytes())


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _versions() -> dict[str, str]:
    import cv2
    import h5py

    return {"ggcnn_net2net": __version__, "numpy": np.__version__, "opencv": cv2.__version__, "h5py": h5py.__version__}
