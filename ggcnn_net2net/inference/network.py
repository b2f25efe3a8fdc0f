"""The fast path: a GG-CNN as one compiled function from images to maps."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.errors import ArchitectureError, DepthImageError, MissingExtraError
from ggcnn_net2net.fast_graph import fast_graph

if TYPE_CHECKING:
    import keras
    import tensorflow as tf

FloatArray = npt.NDArray[np.float32]
Network = Callable[[npt.ArrayLike], FloatArray]
"""Images (n, H, W), depth in metres minus the image's mean -> maps (n, 4, H, W): quality, cos 2θ, sin 2θ, width / 150
px. May be called from several threads."""
_OneImage = Callable[[FloatArray], FloatArray]
"""(1, H, W, 1) -> (1, H, W, 4)."""
_Graph = Callable[["tf.Tensor"], "tf.Tensor"]


def compiled_network(model: keras.Model, backend: str = "tensorflow") -> Network:
    """Compile a GG-CNN for inference.

    The four heads run as one convolution (`fast_graph`), and the weights are constants of the compiled graph, so that
    a backend can lay them out once: what is done to `model` later has no effect. A graph is compiled for each image
    size when it is first met; images of one call run one by one, so a result does not depend on its batch.

    Args:
        model: a GG-CNN. Images of another size than its own are taken as well, of any size if the network is fully
            convolutional, as all GG-CNNs are.
        backend: a name of `BACKENDS`. "openvino" computes in float32 here, also where it would choose bfloat16.

    Raises:
        ArchitectureError: an unknown backend.
        MissingExtraError: the backend is not installed.
        DepthImageError: when it is called with an array of another shape, or of a size for which the network's layers
            do not fit together.
    """
    if backend not in BACKENDS:
        raise ArchitectureError(f"expected a backend of {', '.join(BACKENDS)}, received {backend!r}")
    compile_for = BACKENDS[backend]()
    lock = threading.Lock()

    @lru_cache(maxsize=8)
    def compiled(size: tuple[int, int]) -> _OneImage:
        return compile_for(_frozen_graph(model, size), size)

    def network(images: npt.ArrayLike) -> FloatArray:
        stack = np.ascontiguousarray(images, dtype=np.float32)
        if stack.ndim != 3 or 0 in stack.shape[1:]:
            raise DepthImageError(f"expected images as (n, height, width), received shape {stack.shape}")
        with lock:  # lru_cache would compile twice for two threads
            run = compiled(stack.shape[1:])
        maps = [run(image[None, ..., None]) for image in stack]
        if not maps:
            return np.empty((0, 4, *stack.shape[1:]), np.float32)
        together = maps[0] if len(maps) == 1 else np.concatenate(maps)  # one image is not copied
        return together.transpose(0, 3, 1, 2)

    return network


def _frozen_graph(model: keras.Model, size: tuple[int, int]) -> _Graph:
    """The graph of `model` for images of `size`, with its weights as constants."""
    import keras
    import tensorflow as tf

    if tuple(model.input_shape[1:3]) != size:
        model = _for_any_size(model, size)
    maps = fast_graph(model)
    weights = [(variable, tf.constant(variable.numpy())) for variable in model.variables]

    def graph(image: tf.Tensor) -> tf.Tensor:
        with keras.StatelessScope(state_mapping=weights):
            return maps(image, False)

    return graph


def _for_any_size(model: keras.Model, size: tuple[int, int]) -> keras.Model:
    import keras

    try:
        clone = keras.models.clone_model(model, input_tensors=keras.Input((None, None, 1)))
        clone.set_weights(model.get_weights())
        shapes = {tuple(shape[1:3]) for shape in clone.compute_output_shape((1, *size, 1))}
    except Exception as error:  # layers raise what they like for a size that they cannot take
        raise DepthImageError(
            f"expected images of {model.input_shape[1:3]} px for this network, received {size}: {error}"
        ) from error
    if shapes != {size}:
        raise DepthImageError(
            f"expected an image whose maps are of its own size, received {size} px, for which they are of {shapes}: "
            "pad it to a multiple of the network's stride, 12 px for GG-CNN"
        )
    return clone


def _tensorflow() -> Callable[[_Graph, tuple[int, int]], _OneImage]:
    def compile_for(graph: _Graph, size: tuple[int, int]) -> _OneImage:
        import tensorflow as tf

        concrete = tf.function(graph, autograph=False).get_concrete_function(tf.TensorSpec((1, *size, 1)))
        return lambda image: concrete(tf.constant(image)).numpy()

    return compile_for


def _openvino() -> Callable[[_Graph, tuple[int, int]], _OneImage]:
    try:
        import openvino
    except ImportError as error:
        raise MissingExtraError(
            'the backend "openvino" is not installed: pip install "ggcnn_net2net[export]", or use "tensorflow"'
        ) from error
    core = openvino.Core()

    def compile_for(graph: _Graph, size: tuple[int, int]) -> _OneImage:
        import tensorflow as tf

        function = tf.function(graph, autograph=False, input_signature=[tf.TensorSpec((1, *size, 1))])
        options = {"PERFORMANCE_HINT": "LATENCY", "INFERENCE_PRECISION_HINT": "f32"}
        compiled = core.compile_model(openvino.convert_model(function), "CPU", options)
        requests = threading.local()  # one request cannot serve two threads

        def run(image: FloatArray) -> FloatArray:
            if not hasattr(requests, "one"):
                requests.one = compiled.create_infer_request()
            result: Any = requests.one.infer([image])
            return np.array(result[0])  # the request keeps its buffer

        return run

    return compile_for


BACKENDS = {"tensorflow": _tensorflow, "openvino": _openvino}
"""What can run a network: name -> the function that makes its compiler."""
