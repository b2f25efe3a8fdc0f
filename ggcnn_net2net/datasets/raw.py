"""Folders of raw scenes: which scenes there are, what is wrong with some, and each of them read when asked for."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol, overload

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.datasets.scene import LabelledScene
from ggcnn_net2net.errors import DatasetError


class Problem(NamedTuple):
    """Something in a raw folder that is left out."""

    file: str
    """Relative to the folder."""
    problem: str


class SceneFile(Protocol):
    """A scene on disk. Small and picklable, so that a worker process can read it."""

    @property
    def name(self) -> str:
        """Name of the scene, unique in its folder."""

    @property
    def object_name(self) -> str:
        """What the scene shows."""

    def read(self) -> LabelledScene:
        """Read the images. Raises DatasetError where they are missing or damaged."""


@dataclass(frozen=True)
class SceneFolder(Sequence[LabelledScene]):
    """The scenes of a folder in a fixed order. Indexing reads a scene; none is kept."""

    path: Path
    form: str
    """"cornell" or "jacquard"."""
    files: tuple[SceneFile, ...]
    report: tuple[Problem, ...]
    """What was left out, and why."""
    depth: str | None = None
    """Of Jacquard, "perfect" or "stereo"."""

    def __len__(self) -> int:
        return len(self.files)

    @overload
    def __getitem__(self, index: int) -> LabelledScene: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[LabelledScene]: ...
    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return [file.read() for file in self.files[index]]
        return self.files[index].read()

    @property
    def objects(self) -> dict[str, str]:
        """Name of each scene -> what it shows."""
        return {file.name: file.object_name for file in self.files}

    def only(self, names: Iterable[str]) -> SceneFolder:
        """The scenes with these names, such as one side of a split, in the folder's order."""
        wanted = set(names)
        return replace(self, files=tuple(file for file in self.files if file.name in wanted))


def open_scenes(path: Path, form: str | None = None, depth: str = "perfect") -> SceneFolder:
    """The scenes of a raw folder.

    Args:
        path: the folder.
        form: "cornell" or "jacquard"; None: by the names of its files.
        depth: of Jacquard, "perfect" or "stereo".

    Returns:
        The scenes, and what was left out and why; images are read when they are asked for.

    Raises:
        DatasetError: no such folder, or no scenes in it.
    """
    from ggcnn_net2net.datasets.cornell import open_cornell
    from ggcnn_net2net.datasets.jacquard import open_jacquard

    path = Path(path)
    if not path.is_dir():
        raise DatasetError(f"expected a folder of raw scenes, {path} is none")
    if form is None:
        form = "jacquard" if next(path.rglob("*_grasps.txt"), None) else "cornell"
    if form not in ("cornell", "jacquard"):
        raise DatasetError(f"expected the form cornell or jacquard, received {form!r}")
    return open_cornell(path) if form == "cornell" else open_jacquard(path, depth)


def read_image(path: Path, colour: bool = False) -> npt.NDArray[Any]:
    """An image as stored, or as (H, W, 3) uint8 red, green, blue.

    Args:
        path: of the image.
        colour: whether to convert it to 8 bits of red, green and blue.

    Returns:
        (H, W) or (H, W, channels) of the stored type, or (H, W, 3) uint8.

    Raises:
        DatasetError: no such file, or one that cannot be decoded.
    """
    import cv2

    try:
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise DatasetError(f"cannot read {path}: {error.strerror}") from error
    try:
        image = cv2.imdecode(data, cv2.IMREAD_COLOR if colour else cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error:
        image = None
    if image is None:
        raise DatasetError(f"expected an image in {path}, received {data.size} bytes that are none: fetch it again")
    return image[..., ::-1].copy() if colour else image
