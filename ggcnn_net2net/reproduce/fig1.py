"""Fig. 1 of the paper for any network and object: the simulator, what the network predicts, and the grasp it means."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from ggcnn_net2net.atomic import replacing
from ggcnn_net2net.grasping import RSS_2018, Grasp
from ggcnn_net2net.grasping.decoding import best_grasp
from ggcnn_net2net.inference import predict_maps
from ggcnn_net2net.inference.drawing import draw_grasp
from ggcnn_net2net.protocol import Protocol
from ggcnn_net2net.simulation.camera import Camera
from ggcnn_net2net.simulation.gripper import Gripper
from ggcnn_net2net.simulation.object_sets import ObjectModel
from ggcnn_net2net.simulation.scenes import Scene, make_scene
from ggcnn_net2net.simulation.trial import decoding_of, run_trial, world_grasp
from ggcnn_net2net.simulation.world import Bin, World

if TYPE_CHECKING:
    import keras

FloatMap = npt.NDArray[np.floating]

_RED = "#ff3b30"
_HOVER = 0.06  # metres between the fingertips and where they will go
_WAITING = 0.4  # metres above the plane, without a grasp
_STROKES_APART = 10  # pixels


@dataclass(frozen=True)
class Prediction:
    """What a network sees in a scene. Maps are (H, W)."""

    scene: Scene
    view: npt.NDArray[np.uint8]
    """(h, w, 3): gripper above its grasp, object, bin."""
    quality: FloatMap
    angle: FloatMap
    """Closing direction in radians, [-π/2, π/2]."""
    width: FloatMap
    """Opening in pixels."""
    grasp: Grasp | None
    """Of the absolute maximum of the smoothed quality; None if it is below the threshold."""
    outcome: str
    """Of the trial."""

    @property
    def normalised_quality(self) -> FloatMap:
        """The quality from 0, its least value, to 1, its largest; all 0 where it is the same everywhere."""
        low, high = float(self.quality.min()), float(self.quality.max())
        return (self.quality - low) / (high - low) if high > low else np.zeros_like(self.quality)


def predict(model: keras.Model, item: ObjectModel, pose: int, seed: int, protocol: Protocol) -> Prediction:
    """Let a network look at an object, and try its grasp.

    Args:
        model: a GG-CNN for images of 300x300 px.
        item: the object.
        pose: index of its pose; the scene is that of `table1`.
        seed: of the scenes.
        protocol: see `Protocol`.

    Returns:
        Maps, grasp and outcome.
    """
    with World() as world:
        scene = make_scene(world, item, pose, seed)
        (maps,) = predict_maps(model, [scene.depth - scene.depth.mean()])
        quality, cos, sin, width = maps
        decoding = decoding_of(protocol)
        grasp = best_grasp(maps, decoding)
        outcome = run_trial(world, scene, grasp, protocol).outcome.value
        view = _view(world, scene, grasp)
    return Prediction(scene, view, quality, np.arctan2(sin, cos) / 2, width * decoding.width_scale, grasp, outcome)


def _view(world: World, scene: Scene, grasp: Grasp | None) -> npt.NDArray[np.uint8]:
    """The world with the gripper above its grasp, or waiting if there is none."""
    world.reset()
    world.add_object(scene.model, scene.position, scene.orientation)
    world.add_bin(Bin())
    gripper = Gripper(world)
    x, y, _ = scene.position
    if grasp is None:
        gripper.move_to((x, y, _WAITING, 0, 0, 0))
    else:
        target = world_grasp(grasp, scene.depth, scene.camera)
        gripper.set_opening(target.opening)
        over_x, over_y, surface = target.point
        gripper.move_to((over_x, over_y, surface + _HOVER + gripper.spec.reach, 0, 0, target.yaw))
    camera = Camera(
        target=(x + 0.33, y + 0.28, 0), position=(x - 0.33, y - 0.7, 0.72), up=(0, 0, 1), fov=56, width=720, height=720
    )
    return camera.render(world.client)[1]


def draw(path: Path, prediction: Prediction, network: str, protocol: Protocol) -> None:
    """Write the figure.

    Args:
        path: picture to write; its suffix is the format.
        prediction: what to draw.
        network: what the network is called.
        protocol: that the prediction was made in.
    """
    figure = Figure(figsize=(13, 6.6), dpi=120, layout="constrained")
    halves: Any = figure.subfigures(1, 2, width_ratios=(1, 1.12))
    left, right = halves
    axes = left.subplots()
    axes.imshow(prediction.view)
    axes.set_axis_off()
    axes.set_title("simulation: gripper, object and bin", fontsize=10)
    panels = right.subplots(2, 2)
    quality, angle, width, depth = panels.ravel()
    low, high = prediction.quality.min(), prediction.quality.max()
    _map(quality, prediction.normalised_quality, f"quality, normalised from {low:.2g} to {high:.2g}", "viridis", (0, 1))
    bar = _map(angle, prediction.angle, "angle [rad]; strokes: closing direction", "twilight", (-np.pi / 2, np.pi / 2))
    _stroke_angles(angle, prediction)
    bar.set_ticks([-np.pi / 2, -np.pi / 4, 0, np.pi / 4, np.pi / 2], labels=["-π/2", "-π/4", "0", "π/4", "π/2"])
    _map(width, prediction.width, "gripper width [px]", "magma", (0, max(1.0, float(prediction.width.max()))))
    seen = prediction.scene.depth
    _map(depth, seen, "depth [m] and best grasp", "gray", (float(seen.min()), float(seen.max())))
    grasp, caption = prediction.grasp, "no grasp"
    if grasp is None:
        depth.set_title("depth [m]: no grasp", fontsize=10, color=_RED, weight="bold")
    else:
        quality.plot(grasp.col, grasp.row, "+", color=_RED, markersize=12, markeredgewidth=1.5)
        draw_grasp(depth, grasp)
        caption = (
            f"angle {np.degrees(grasp.angle):.0f}°, width {grasp.width_px:.0f} px, quality {grasp.quality:.2f}; "
            f"trial: {prediction.outcome}"
        )
    scene = prediction.scene
    title = f"{network}; object {scene.model.name}, pose {scene.pose}; protocol {protocol.name}"
    figure.suptitle(f"{title}\n{caption}", fontsize=12, parse_math=False)
    with replacing(path) as temporary:
        figure.savefig(temporary)


def _stroke_angles(axes: Any, prediction: Prediction) -> None:
    """Draw closing directions where a grasp could be: the colours are cyclic, so that in grey ±45° look the same."""
    height, width = prediction.quality.shape
    row, col = np.mgrid[0:height:_STROKES_APART, 0:width:_STROKES_APART]
    good = prediction.quality[row, col] >= RSS_2018.threshold
    theta = prediction.angle[row, col][good]
    axes.quiver(
        *(col[good], row[good], np.cos(theta), np.sin(theta)),
        pivot="mid",
        scale_units="x",
        scale=1 / (0.8 * _STROKES_APART),
        color="white",
        edgecolor="black",
        linewidth=0.4,
        width=0.008,
        headwidth=0,
        headlength=0,
        headaxislength=0,
    )


def _map(axes: Any, values: FloatMap, title: str, colours: str, limits: tuple[float, float]) -> Any:
    image = axes.imshow(values, cmap=colours, vmin=limits[0], vmax=limits[1])
    axes.set_title(title, fontsize=10)
    axes.set_xticks([])
    axes.set_yticks([])
    return axes.figure.colorbar(image, ax=axes, fraction=0.046, pad=0.03)
