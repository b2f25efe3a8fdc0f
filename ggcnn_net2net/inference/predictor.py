"""Depth images in, grasps out: what a grasp stack calls."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import DepthImageError
from ggcnn_net2net.grasping import Grasp, decode_maps
from ggcnn_net2net.inference.depth_image import depth_at, to_metres
from ggcnn_net2net.inference.intrinsics import Intrinsics, as_intrinsics
from ggcnn_net2net.inference.network import compiled_network
from ggcnn_net2net.inference.presets import Preset, preset_named
from ggcnn_net2net.inference.window import Window, crop_window, network_input, padded

if TYPE_CHECKING:
    import keras

MODES = ("crop", "full")


@dataclass(frozen=True)
class Prediction:
    """What came of one depth image, and how it was read."""

    grasps: list[Grasp]
    """Best first, in pixels of the image; `CameraGrasp` with a camera."""
    depth_unit: str
    """Unit in which the image was read, "m" or "mm"."""
    metres: npt.NDArray[np.float32]
    """(H, W) depth in metres, NaN where missing."""
    window: Window
    """The part of the image that the network saw."""
    maps: npt.NDArray[np.float32]
    """(4, h, w) quality, cos 2θ, sin 2θ and width / `width_scale`, in pixels of the network's image, before
    smoothing."""


class GraspPredictor:
    """Predicts grasps from depth images of any camera.

    Ready when constructed: the network is compiled and has run once. May be called from several threads at once;
    nothing is remembered from one call to the next. The network is compiled once for each size of its own image: never
    again in mode "crop", for each new size of the camera's image in mode "full".

    Example:
        >>> predictor = GraspPredictor("published", preset="kinova")
        >>> grasps = predictor.predict(depth, camera=camera_info.K)  # grasps[0].position is in metres
    """

    def __init__(
        self,
        network: keras.Model | str | Path,
        *,
        preset: str | Preset = "rss_2018",
        mode: str = "crop",
        backend: str = "tensorflow",
        image_shape: tuple[int, int] | None = None,
    ) -> None:
        """Load, compile and warm up.

        Args:
            network: a GG-CNN, the path of a model file, "published" or "zoo:NAME".
            preset: crop, filling, clipping, smoothing and thresholds of a public user of GG-CNN, one of `PRESETS`, or
                your own.
            mode: "crop": the network sees the preset's centre square, resized to the size it was trained on, as in the
                public ROS nodes. "full": it sees the whole image, pixel by pixel; the preset's crop does not count.
            backend: what computes the network, "tensorflow" or "openvino".
            image_shape: (H, W) of the images to come, for which mode "full" compiles now instead of at the first one.

        Raises:
            DepthImageError: no such preset or mode.
            ArchitectureError: no such backend.
            ModelFileError, DataNotFoundError, VerificationError: as `load_ggcnn`.
            MissingExtraError: the backend is not installed.
        """
        if mode not in MODES:
            raise DepthImageError(f"expected a mode of {' or '.join(MODES)}, received {mode!r}")
        self._preset = preset_named(preset)
        self._mode = mode
        model = _model_of(network)
        self._side: int = model.input_shape[1] or 300
        self._maps = compiled_network(model, backend)
        rehearsal = np.linspace(0.5, 1.5, self._side**2, dtype=np.float32).reshape(self._side, self._side)
        if image_shape is not None:
            rehearsal = np.resize(rehearsal, image_shape)
        self.look(rehearsal)

    @property
    def preset(self) -> Preset:
        """What is done around the network."""
        return self._preset

    @property
    def mode(self) -> str:
        """ "crop" or "full"."""
        return self._mode

    def predict(
        self, depth: npt.ArrayLike, camera: Any = None, n_grasps: int = 1, depth_unit: str | None = None
    ) -> list[Grasp] | list[list[Grasp]]:
        """The best grasps of a depth image, or of several.

        Args:
            depth: (H, W), or (n, H, W) images of one camera; integers or floats, metres or millimetres. NaN, infinite,
                zero and negative pixels are missing and are filled in.
            camera: intrinsics of the image: `Intrinsics`, a camera matrix (3 x 3, or 9 numbers), or a ROS CameraInfo.
            n_grasps: the most grasps an image.
            depth_unit: "m" or "mm"; None: detected by the rule of `to_metres`, and refused if ambiguous.

        Returns:
            Grasps, best first, none if there are none; with a camera each a `CameraGrasp`. For (n, H, W) a list of n
            such lists. Rows, columns and openings are in pixels of the image as it was handed over: (0, 0) is the
            centre of the upper left pixel, and angles grow counter-clockwise from the column axis.

        Raises:
            DepthImageError: no depth image, a unit that cannot be told, an image whose pixels are all missing, or no
                camera.
            GraspError: n_grasps below 1, or a network whose maps are not finite.
        """
        metres, unit = to_metres(depth, depth_unit)
        intrinsics = None if camera is None else as_intrinsics(camera)
        if metres.ndim == 2:
            return self._look(metres, unit, intrinsics, n_grasps).grasps
        return [self._look(image, unit, intrinsics, n_grasps).grasps for image in metres]

    def look(
        self, depth: npt.ArrayLike, camera: Any = None, n_grasps: int = 1, depth_unit: str | None = None
    ) -> Prediction:
        """As `predict` for one image (H, W), with everything that led to the grasps: unit, window, maps.

        Args:
            depth: (H, W), as of `predict`.
            camera: as of `predict`.
            n_grasps: as of `predict`.
            depth_unit: as of `predict`.

        Returns:
            The grasps, the unit, the depth in metres, the window that the network saw, and its maps.

        Raises:
            DepthImageError: as `predict`, or several images.
            GraspError: as `predict`.
        """
        metres, unit = to_metres(depth, depth_unit)
        if metres.ndim != 2:
            raise DepthImageError(
                f"expected one depth image (H, W), received shape {metres.shape}: predict takes several"
            )
        return self._look(metres, unit, None if camera is None else as_intrinsics(camera), n_grasps)

    def _look(
        self, metres: npt.NDArray[np.float32], unit: str, intrinsics: Intrinsics | None, n_grasps: int
    ) -> Prediction:
        cropped = self._mode == "crop"
        window = crop_window(metres.shape, self._preset, self._side) if cropped else Window(0, 0, *metres.shape)
        image, missing = network_input(metres, window, self._preset)
        height, width = image.shape
        maps = self._maps((image if cropped else padded(image))[None])[0][:, :height, :width]
        quality, cos, sin, width_map = maps
        if self._preset.zero_quality_where_missing:
            quality = np.where(missing, 0, quality)
        found = decode_maps(quality, cos, sin, width_map, n_grasps, self._preset.decoding)
        grasps = [window.to_image(grasp) for grasp in found]
        if intrinsics is not None:
            grasps = [intrinsics.as_camera_grasp(grasp, *depth_at(metres, grasp.row, grasp.col)) for grasp in grasps]
        return Prediction(grasps, unit, metres, window, maps)


def _model_of(network: keras.Model | str | Path) -> keras.Model:
    from ggcnn_net2net.model_files import check_ggcnn, load_ggcnn

    if isinstance(network, (str, Path)):
        return load_ggcnn(network)
    check_ggcnn(network)
    return network
