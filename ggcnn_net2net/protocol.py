"""Every choice in which the published code and a corrected reading of the paper differ.

`PAPER` does what the public code of the paper does, defects included; `CORRECTED` does what the paper means. Each
result carries the protocol it was made with, so that the two are never mixed in silence. `docs/fidelity.md` explains
each field, with its effect where that was measured.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from ggcnn_net2net.errors import GGCNNError


@dataclass(frozen=True)
class Protocol:
    """One setting of every choice. Use `PAPER`, `CORRECTED`, or `dataclasses.replace` of one of them."""

    name: str

    sim_angle_window: int
    """Half side in pixels of the window around the peak from which the simulator takes the grasp angle: the largest
    angle of the window if the peak's is positive, else the smallest (the public code's `ang_threshold`). 0 takes the
    peak's own angle."""

    object_centre: str
    """Point of an object that is its origin and centre of mass: "vertex_mean" (mean of the mesh's vertices, which lies
    where the mesh is finely cut) or "volume" (centre of mass of its convex parts)."""

    coupled_jaws: bool
    """Whether the jaws move together, as those of a real parallel gripper. As published each is driven alone with up
    to 1000 N, and the stronger one pushes the object, and the other jaw, out of the grasp."""

    solver_iterations: int
    """Iterations of the contact solver in a trial. With pybullet's default of 50, which the public code uses, it does
    not converge under 1000 N: held objects creep out between the jaws at centimetres a second."""

    palm_clearance: float
    """Metres that the palm stays above the seen surface at the grasp's centre. As published it ends on the surface, and
    its motors press the object onto the plane."""

    fingertip_clearance: float | None
    """Height in metres above the plane at which the descent stops the fingertips. None lets the gripper push its
    fingers against the plane, as published, wherever the grasped surface is lower than the fingers are long."""

    wider_noise: float
    """How unequally *wider* shares out the outgoing weights of a filter among its copies (`net2net.wider`, argument
    `noise`). With 0, as published, the copies get equal gradients and stay equal, so that *wider* adds no capacity."""

    wrapped_angle_difference: bool
    """Whether the IoU rate compares closing directions modulo π both ways. The published code takes `abs(a - b) % π`,
    which rejects a pair across ±π/2, such as 89° and -89°."""

    iou_recentres_depth: bool
    """Whether the IoU rate of the search subtracts each image's mean once more from the depth, which is already
    centred and clipped, as the published code does: the network is scored on inputs that it was not trained on."""

    masked_loss: bool
    """Whether the errors of cos, sin and width count on labelled pixels only. As published they count everywhere, so
    that a width is learnt as (probability of a label) x opening, which is too narrow."""

    shuffled_rows: bool
    """Whether training shuffles the images themselves. The search of the published code shuffles batches of consecutive
    rows, which hold augmentations of one scene."""

    last_lookahead_takes_last: bool
    """Whether the last lookahead, of one level, chooses the last entry of the beam instead of the best: of children
    that score 5, 9 and 7 the published code takes the 5."""

    def __post_init__(self) -> None:
        if self.object_centre not in ("vertex_mean", "volume"):
            raise GGCNNError(f"expected object_centre 'vertex_mean' or 'volume', received {self.object_centre!r}")

    def as_dict(self) -> dict[str, Any]:
        """Field names and values, for result files."""
        return asdict(self)


PAPER = Protocol(
    name="PAPER",
    sim_angle_window=5,
    object_centre="vertex_mean",
    coupled_jaws=False,
    solver_iterations=50,
    palm_clearance=0.0,
    fingertip_clearance=None,
    wider_noise=0.0,
    wrapped_angle_difference=False,
    iou_recentres_depth=True,
    masked_loss=False,
    shuffled_rows=False,
    last_lookahead_takes_last=True,
)
"""As the public code of the paper, defects included."""

CORRECTED = Protocol(
    name="CORRECTED",
    sim_angle_window=0,
    object_centre="volume",
    coupled_jaws=True,
    solver_iterations=200,
    palm_clearance=0.005,
    fingertip_clearance=0.002,
    wider_noise=0.3,
    wrapped_angle_difference=True,
    iou_recentres_depth=False,
    masked_loss=True,
    shuffled_rows=True,
    last_lookahead_takes_last=False,
)
"""As the paper means it."""


def protocol_named(name: str) -> Protocol:
    """The preset called `name` ("paper" or "corrected", in any case).

    Args:
        name: of the preset.

    Returns:
        `PAPER` or `CORRECTED`.

    Raises:
        GGCNNError: no such preset.
    """
    for preset in (PAPER, CORRECTED):
        if preset.name.lower() == name.lower():
            return preset
    raise GGCNNError(f"expected a protocol 'paper' or 'corrected', received {name!r}")
