"""Pictures and films of objects and trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import imageio.v3 as imageio
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from ggcnn_net2net.atomic import replacing
from ggcnn_net2net.errors import GGCNNError, SimulationError
from ggcnn_net2net.grasping import Grasp, grasp_to_rectangle
from ggcnn_net2net.parallel import Crash, run_parallel
from ggcnn_net2net.protocol import Protocol
from ggcnn_net2net.quiet import silence_output
from ggcnn_net2net.simulation.camera import Camera
from ggcnn_net2net.simulation.gripper_spec import GripperSpec
from ggcnn_net2net.simulation.object_sets import ObjectSet
from ggcnn_net2net.simulation.scenes import Scene
from ggcnn_net2net.simulation.trial import TrialResult, run_trial
from ggcnn_net2net.simulation.world import World

Image = npt.NDArray[np.uint8]

FILM_RATE = 25  # frames per simulated second
FILM_CAMERA = Camera(target=(0.75, 0.7, 0.3), position=(0.0, -1.15, 1.25), up=(0, 0, 1), fov=56, width=480, height=360)


@dataclass
class Film:
    """Frames of a trial, for a .gif or .mp4 file; call `watch` once before the trial and `save` after it.

    A trial without a grasp, or of an object that does not lie still, has no frames, and nothing can be saved.

    Raises:
        GGCNNError: `path` has another suffix.
    """

    path: Path
    frames: list[Image] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.path.suffix.lower() not in (".gif", ".mp4"):
            raise GGCNNError(f"expected a film's name to end in .gif or .mp4, received {self.path}")

    def watch(self, world: World) -> None:
        """Take a frame of `world` every 1 / `FILM_RATE` simulated seconds from now on."""

        def take() -> None:
            if world.steps % world.steps_in(1 / FILM_RATE) == 0:
                self.frames.append(FILM_CAMERA.render(world.client)[1])

        world.on_step = take

    def save(self) -> None:
        """Write the frames."""
        with replacing(self.path) as temporary:
            if self.path.suffix.lower() == ".gif":
                imageio.imwrite(temporary, self.frames[::2], plugin="pillow", duration=2000 // FILM_RATE, loop=0)
            else:
                _write_mp4(temporary, self.frames)


def _write_mp4(path: Path, frames: Sequence[Image]) -> None:
    height, width = frames[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), FILM_RATE, (width, height))
    for frame in frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    writer.release()


@dataclass(frozen=True)
class Strip:
    """A trial in a few pictures: what the camera saw with the grasp drawn in, then one picture a phase."""

    title: str
    pictures: list[Image]
    captions: list[str]
    """Of all pictures but the first."""


_CAPTIONS = {"close": "before closing", "carry": "closed", "release": "over the bin", "end": "end"}


def trial_strip(
    world: World, scene: Scene, grasp: Grasp | None, protocol: Protocol, gripper: GripperSpec | None = None
) -> tuple[Strip, TrialResult]:
    """Run a trial and keep a picture at the beginning of each phase but the first, from near the object at first."""
    near = Camera(
        target=(scene.position[0], scene.position[1], 0.08),
        position=(scene.position[0] - 0.45, scene.position[1] - 0.5, 0.55),
        up=(0, 0, 1),
        fov=45,
    )
    pictures, phases = [draw_grasp(scene.rgb, grasp)], []

    def take(phase: str) -> None:
        if phase not in _CAPTIONS:
            return
        phases.append(phase)
        camera = FILM_CAMERA if "release" in phases else near
        pictures.append(camera.render(world.client)[1])

    result = run_trial(world, scene, grasp, protocol, gripper, on_phase=take)
    return Strip(f"{scene.key}: {result.outcome}", pictures, [_CAPTIONS[phase] for phase in phases]), result


def show_trial(scene: Scene, grasp: Grasp | None, protocol: Protocol, gripper: GripperSpec | None = None) -> None:
    """Run a trial in a window, in a process of its own: OpenGL and TensorFlow in one process can crash it.

    Args:
        scene: what to grasp.
        grasp: in pixels of the scene's image; None: nothing is grasped.
        protocol: how.
        gripper: what grasps; the paper's by default.

    Raises:
        SimulationError: there is no display, or the window could not be opened.
    """
    ((_, outcome),) = run_parallel(_run_in_window, [(scene, grasp, protocol, gripper)], workers=1)
    if isinstance(outcome, Crash):
        raise SimulationError(f"expected pybullet to open a window, its process died (exit code {outcome.exit_code})")


def _run_in_window(scene: Scene, grasp: Grasp | None, protocol: Protocol, gripper: GripperSpec | None) -> None:
    with silence_output(), World(gui=True) as world:
        run_trial(world, scene, grasp, protocol, gripper)


def draw_grasp(rgb: Image, grasp: Grasp | None) -> Image:
    """A copy of an image with a grasp rectangle; its jaws, where the fingers go down, are drawn bold."""
    image = np.ascontiguousarray(rgb.copy())
    if grasp is not None:
        corners = [(round(col), round(row)) for row, col in grasp_to_rectangle(grasp)]
        for start, end in ((0, 1), (2, 3)):  # the opening
            cv2.line(image, corners[start], corners[end], (40, 40, 40), 1, cv2.LINE_AA)
        for start, end in ((1, 2), (3, 0)):  # the jaws
            cv2.line(image, corners[start], corners[end], (0, 60, 255), 3, cv2.LINE_AA)
    return image


def save_strips(path: Path, strips: Sequence[Strip]) -> None:
    """Write strips below each other into one PNG.

    Args:
        path: PNG to write.
        strips: titles and pictures, one strip a row.

    Raises:
        GGCNNError: there is nothing to draw.
    """
    if not strips:
        raise GGCNNError("expected one or more trials to draw, received none")
    columns = max(len(strip.pictures) for strip in strips)
    figure = Figure(figsize=(2.4 * columns, 2.5 * len(strips)), layout="constrained")
    grid = figure.subplots(len(strips), columns, squeeze=False)
    for strip, axes in zip(strips, grid, strict=True):
        for axis in axes:
            axis.set_axis_off()
        titles = [strip.title, *strip.captions]
        for axis, picture, title in zip(axes, strip.pictures, titles, strict=False):  # a trial may have ended early
            axis.imshow(picture)
            axis.set_title(title, fontsize=8, parse_math=False)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=100)


def contact_sheet(path: Path, objects: ObjectSet, columns: int = 8) -> None:
    """Write one PNG with an oblique view of every object as modelled, with name and longest side."""
    rows = -(-len(objects.objects) // columns)
    figure = Figure(figsize=(1.9 * columns, 2.1 * rows), layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in grid:
        axis.set_axis_off()
    with World() as world:
        for model, axis in zip(objects.objects, grid, strict=False):
            world.reset()
            body = world.add_object(model, (0, 0, 2 * model.longest_side), (0, 0, 0, 1))  # clear of the plane
            low, high = np.array(world.box_of(body))
            middle, radius = (low + high) / 2, np.linalg.norm(high - low) / 2
            eye = middle + 3.2 * radius * np.array([-0.45, -0.6, 0.66])
            camera = Camera(tuple(middle), tuple(eye), (0, 0, 1), fov=36, near=0.01, width=260, height=260)
            axis.imshow(camera.render(world.client)[1])
            axis.set_title(f"{model.name}\n{model.longest_side:.2f} m", fontsize=8, parse_math=False)
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=100)
