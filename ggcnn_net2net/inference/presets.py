"""What the public users of GG-CNN do around the network: crop, filling, clipping, smoothing, thresholds.

The grasp that comes out depends on these constants as much as on the weights. A preset is a value;
`dataclasses.replace` makes a variant of it. What a source does beyond what its preset says is told with each.

The sources read a pixel p of a crop that was resized by s as p * s + offset. Here a pixel is its centre, as in OpenCV's
resize: (p + 0.5) * s - 0.5 + offset, which for the kinova node (s = 4/3) is 1/6 pixel more.
"""

from __future__ import annotations

from dataclasses import dataclass

from ggcnn_net2net.errors import DepthImageError
from ggcnn_net2net.grasping import RSS_2018, Decoding


@dataclass(frozen=True)
class Preset:
    """Everything between a depth image in metres and grasps that is not the network.

    Raises:
        DepthImageError: a crop or clip of 0 or less.
    """

    name: str
    decoding: Decoding = RSS_2018
    """Constants of the decoding, in pixels of the network's image."""
    crop: int | None = 300
    """Side in pixels of the centre square that the network sees, resized to the network's image. None, and in images
    with a shorter side: the largest square."""
    crop_up: int = 0
    """Pixels by which the square lies above the centre, as far as the image goes."""
    clip: float | None = 1.0
    """Depth minus its mean is clipped to plus and minus this many metres. None: not clipped."""
    resize_before_filling: bool = False
    """Whether missing pixels are filled in after the resize, which widens them by interpolation, or before it."""
    missing_margin: int = 0
    """Pixels by which missing areas are widened before they are filled in."""
    zero_quality_where_missing: bool = False
    """Whether pixels without a measured depth get the quality 0."""

    def __post_init__(self) -> None:
        if (self.crop is not None and self.crop < 1) or (self.clip is not None and self.clip <= 0):
            raise DepthImageError(f"expected crop and clip above 0, or None, received {self.crop} and {self.clip}")


RSS_2018_PRESET = Preset("rss_2018")
"""The Keras code of RSS 2018, as it evaluates: https://github.com/dougsm/ggcnn, evaluate.py at
1a4f2bbaa655835e909d8719c174b5168d3e74c3, dataset_processing/grasp.py and image.py at
472b0d582ec24d86766da1a8eafba1619ddd3057. Gaussians of 5 px (quality) and 1 px (width), local maxima from 0.2 on, 20 px
apart.

Not reproduced: it crops around the labelled grasps, which a robot does not have; here around the image's centre."""

KINOVA = Preset(
    "kinova",
    Decoding(
        quality_sigma=5.0,
        width_sigma=0.0,
        angle_sigma=2.0,
        border="reflect",
        min_distance=10,
        peaks_at_border=True,
        threshold=0.0,
    ),
    crop=400,
    resize_before_filling=True,
    zero_quality_where_missing=True,
)
"""The ROS node of RSS 2018 for a Kinova arm, in open loop: https://github.com/dougsm/ggcnn_kinova_grasping,
ggcnn_kinova_grasping/scripts/run_ggcnn.py at 004139fedd5ad304f36de76b43466b4474b2081b. Gaussians of 5 px (quality) and
2 px (angle, itself), width as predicted; the best grasp is the global maximum, however low.

Not reproduced, because it is state: in closed loop (tool below 0.34 m) the node takes, of the three best local maxima
from 0.1 on, the one nearest to its previous ones; `n_grasps=3` gives such maxima to choose from. The node reads the
depth at the grasp's pixel and is silent where that is missing; see `CameraGrasp.measured`. It sends the width in pixels
of the 300x300 image; here it is in pixels of the camera's. Zeros, which it interpolates with their neighbours, are
missing here from the start."""

MVP = Preset(
    "mvp",
    Decoding(
        quality_sigma=2.0,
        width_sigma=2.0,
        angle_sigma=2.0,
        border="reflect",
        min_distance=10,
        peaks_at_border=True,
        threshold=0.0,
    ),
    crop_up=40,
    missing_margin=1,
)
"""The ROS service of Multi-View Picking for a Franka arm: https://github.com/dougsm/mvp_grasp,
ggcnn/ros_nodes/ggcnn_service.py and ggcnn/cfg/ggcnn_service.yaml at 3b2f788ca8953e437d7fcc3d821937ee028eb2ae,
ggcnn/src/ggcnn/ggcnn.py at 6fd2ce3ffd223d27d293146d0de9f1e6b322f2c4. Gaussians of 2 px on all maps, global maximum; the
crop lies 40 px above the centre. (`min_distance` only separates further grasps, which the service does not return.)

Not reproduced: it sets the quality of the first one or two rows to 0, where it means that of missing pixels (an index
array of bytes in place of a mask); it clips the quality to 0.999; it turns the angle by the camera's rotation; it
stretches 300 columns over 301, and takes the opening from a field of view instead of the focal length. The multi-view
planner (mvp_grasping) crops 350 px."""

GGCNN_MASTER = Preset("ggcnn_master", Decoding(quality_sigma=2.0, width_sigma=1.0, angle_sigma=2.0))
"""The PyTorch code: https://github.com/dougsm/ggcnn, models/common.py at e0b21aba3e9bb8a822a93bd7260d71ad68deb927,
utils/dataset_processing/grasp.py at a74833867cee80f979ed2f144543c57406334f84. Gaussians of 2 px (quality), 2 px (angle)
and 1 px (width), local maxima from 0.2 on, 20 px apart.

Not reproduced: as with RSS 2018, it crops around labels."""

PAPER_SIMULATOR = Preset("paper_simulator", Decoding(angle_window=5), crop=None, clip=None)
"""The simulator of the paper that this package reproduces: https://github.com/m-rios/ggcnn_plus, core/network.py at
192867722e201efd4ec3f4b3ae224f99a9b3d150. Smoothing and maxima as RSS 2018; the angle is the extreme of the 11x11 window
at the maximum; depth is not clipped. Its camera takes 300x300 px, all of which the network sees."""

PRESETS = {preset.name: preset for preset in (RSS_2018_PRESET, KINOVA, MVP, GGCNN_MASTER, PAPER_SIMULATOR)}
"""Name -> preset."""


def preset_named(preset: str | Preset) -> Preset:
    """The preset of a name, or the one that is given.

    Args:
        preset: a name of `PRESETS`, or a preset of your own.

    Returns:
        The preset.

    Raises:
        DepthImageError: no preset has this name.
    """
    if isinstance(preset, Preset):
        return preset
    if preset not in PRESETS:
        raise DepthImageError(f"expected a preset, one of {', '.join(PRESETS)}, received {preset!r}")
    return PRESETS[preset]
