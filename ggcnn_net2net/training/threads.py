"""How many threads TensorFlow uses."""

from __future__ import annotations

from ggcnn_net2net.errors import TrainingError


def set_threads(threads: int) -> None:
    """Let TensorFlow compute with this number of threads. The same number gives the same weights bit for bit.

    Args:
        threads: 1 or more; call it before anything is computed.

    Raises:
        TrainingError: TensorFlow has started already with another number.
    """
    import tensorflow as tf

    if threads < 1:
        raise TrainingError(f"expected 1 or more threads, received {threads}")
    try:
        tf.config.threading.set_intra_op_parallelism_threads(threads)
        tf.config.threading.set_inter_op_parallelism_threads(threads)
    except RuntimeError as error:
        raise TrainingError(
            f"expected set_threads({threads}) before TensorFlow computes anything, received it afterwards: call it "
            "right after the imports, or start a new process"
        ) from error
