"""Scenes: an object at rest in a random pose and what the camera sees of it. The same scenes judge every network."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pybullet

from ggcnn_net2net.atomic import new_hdf5, replacing
from ggcnn_net2net.errors import SceneError
from ggcnn_net2net.simulation.camera import Camera
from ggcnn_net2net.simulation.object_sets import ObjectModel, ObjectSet
from ggcnn_net2net.simulation.world import Quaternion, Vector, World

MAX_DROPS = 20
"""Drops after which an object that never comes to rest is given up."""

FORMAT = "ggcnn_net2net scenes 1"


@dataclass(frozen=True)
class Scene:
    """One object in one resting pose, seen by the camera that looks at it."""

    model: ObjectModel
    pose: int
    """Index of the pose, 0 to poses - 1."""
    position: Vector
    orientation: Quaternion
    stable: bool
    """Whether the object came to rest; a trial on a scene that did not fails."""
    drops: int
    """Drops it took."""
    depth: npt.NDArray[np.float32]
    """(300, 300) metres."""
    rgb: npt.NDArray[np.uint8]
    """(300, 300, 3)."""
    camera: Camera
    """The camera that took the image."""

    @property
    def key(self) -> str:
        """Name of the scene within its set: OBJECT/POSE."""
        return scene_key(self.model.name, self.pose)


def scene_key(object_name: str, pose: int) -> str:
    """Name of a scene within its set: OBJECT/POSE."""
    return f"{object_name}/{pose}"


def make_scene(world: World, model: ObjectModel, pose: int, seed: int) -> Scene:
    """Drop an object and look at it once it lies still.

    The randomness depends on `seed`, the object's name and `pose` alone.

    Args:
        world: is reset first.
        model: the object.
        pose: index of the pose.
        seed: of the whole set of scenes.

    Returns:
        The scene: pose, depth and colour; marked where the object never came to rest.
    """
    rng = np.random.default_rng([seed, zlib.crc32(model.name.encode()), pose])
    body, stable, drops = drop_object(world, model, rng)
    position, orientation = world.pose_of(body)
    camera = Camera(target=position)
    depth, rgb = camera.render(world.client)
    return Scene(model, pose, position, orientation, stable, drops, depth, rgb, camera)


def drop_object(world: World, model: ObjectModel, rng: np.random.Generator) -> tuple[int, bool, int]:
    """Drop an object from the height of its longest side at a random orientation, and wait until it lies still.

    Drops that do not come to rest within 10 simulated seconds are drawn again (paper's public code).

    Args:
        world: is reset first.
        model: the object.
        rng: draws the orientations.

    Returns:
        The body's id, whether it came to rest, and the drops that it took.
    """
    stable, drops = False, 0
    while not stable and drops < MAX_DROPS:
        drops += 1
        angles = rng.uniform(0, 2 * np.pi, 3)
        world.reset()
        body = world.add_object(model, (0, 0, model.longest_side), pybullet.getQuaternionFromEuler(angles.tolist()))
        stable = world.settle(body)
    return body, stable, drops


@dataclass(frozen=True)
class SceneSettings:
    """What determines a set of scenes."""

    object_set: str = field(compare=False)
    """As it was named; of one set there may be several names."""
    fingerprint: str
    """`ObjectSet.fingerprint`."""
    poses: int
    seed: int

    @classmethod
    def of(cls, objects: ObjectSet, poses: int, seed: int) -> SceneSettings:
        """Settings of `poses` scenes of every object of a set."""
        if poses < 1 or seed < 0:
            raise SceneError(f"expected poses of 1 or more and a seed of 0 or more, received {poses} and {seed}")
        return cls(objects.name, objects.fingerprint, poses, seed)


def save_scenes(path: Path, scenes: Iterable[Scene], settings: SceneSettings) -> None:
    """Write scenes to an HDF5 file, whole or not at all.

    Layout: one group OBJECT/POSE a scene with datasets depth (float32, metres) and rgb (uint8), and attributes
    position, orientation (x, y, z, w), stable, drops, camera (JSON) and object (JSON). The file's attributes hold the
    settings.

    Args:
        path: file to write.
        scenes: any number.
        settings: what determines them.
    """
    with replacing(path) as temporary, new_hdf5(temporary) as file:
        file.attrs["format"] = FORMAT
        file.attrs["settings"] = json.dumps(asdict(settings))
        for scene in scenes:
            group = file.create_group(scene.key)
            group.create_dataset("depth", data=scene.depth, compression="gzip", compression_opts=4, shuffle=True)
            group.create_dataset("rgb", data=scene.rgb, compression="gzip", compression_opts=4)
            group.attrs["position"] = scene.position
            group.attrs["orientation"] = scene.orientation
            group.attrs["stable"] = scene.stable
            group.attrs["drops"] = scene.drops
            group.attrs["camera"] = json.dumps(asdict(scene.camera))
            group.attrs["object"] = json.dumps({**asdict(scene.model), "mesh": scene.model.mesh.name})


def load_scenes(path: Path, objects: ObjectSet, settings: SceneSettings | None = None) -> list[Scene]:
    """Read scenes back, in the order of the object set and of the poses.

    Args:
        path: file written by `save_scenes`.
        objects: the set that the scenes were made of.
        settings: what the scenes are expected to be; None accepts any scenes of these objects.

    Returns:
        The scenes.

    Raises:
        SceneError: the file is damaged, or holds scenes of other objects or with other settings.
    """
    import h5py

    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != FORMAT:
                raise SceneError(f"expected {path} in the format {FORMAT!r}, received {file.attrs.get('format')!r}")
            found = SceneSettings(**json.loads(file.attrs["settings"]))
            if settings is not None and found != settings:
                raise SceneError(
                    f"expected scenes of {settings} in {path}, found {found}: choose another folder, or the settings "
                    "with which it was begun"
                )
            if found.fingerprint != objects.fingerprint:
                raise SceneError(f"expected scenes of the object set {objects.name} in {path}, its meshes differ")
            return [
                _read_scene(file[scene_key(model.name, int(pose))], model, int(pose))
                for model in objects.objects
                if model.name in file
                for pose in sorted(file[model.name], key=int)
            ]
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise SceneError(f"cannot read scenes from {path}: {error!r}; remove it and they are made again") from error


def _read_scene(group: Any, model: ObjectModel, pose: int) -> Scene:
    return Scene(
        model,
        pose,
        tuple(group.attrs["position"].tolist()),
        tuple(group.attrs["orientation"].tolist()),
        bool(group.attrs["stable"]),
        int(group.attrs["drops"]),
        group["depth"][()],
        group["rgb"][()],
        _camera(json.loads(group.attrs["camera"])),
    )


def _camera(settings: dict[str, Any]) -> Camera:
    values: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in settings.items()
    }
    return Camera(**values)


def depth_images(scenes: Sequence[Scene]) -> npt.NDArray[np.float32]:
    """Depth of all scenes, (n, 300, 300) metres."""
    return np.stack([scene.depth for scene in scenes])
