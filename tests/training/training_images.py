"""Synthetic training data, and a training run to be started as a process of its own."""

from __future__ import annotations

import hashlib
import sys
import time

import numpy as np


class SyntheticGrasps:
    """Tilted planes with a box on each; the box is the label. Implements `TrainingData`."""

    def __init__(self, n_images: int, size: int, seed: int = 0, seconds: float = 0.0) -> None:
        self.fingerprint = f"synthetic {n_images} {size} {seed}"
        self.seconds = seconds
        random = np.random.default_rng(seed)
        grid = np.linspace(-1, 1, size)
        tilt = random.uniform(-0.1, 0.1, (2, n_images, 1, 1))
        centre = random.uniform(-0.5, 0.5, (2, n_images, 1, 1))
        rows, cols = grid[None, :, None], grid[None, None, :]
        box = (abs(rows - centre[0]) < 0.2) & (abs(cols - centre[1]) < 0.3)
        depth = tilt[0] * rows + tilt[1] * cols - 0.2 * box + random.normal(0, 0.002, (n_images, size, size))
        angle = np.where(box, random.uniform(-1.5, 1.5, (n_images, 1, 1)), 0)
        width = np.where(box, 0.4, 0)
        self.inputs = (depth - depth.mean((1, 2), keepdims=True))[..., None].astype(np.float32)
        self.targets = np.stack([box, np.cos(2 * angle), np.sin(2 * angle), width], axis=-1).astype(np.float32)

    def __len__(self) -> int:
        return len(self.inputs)

    def batch(self, rows, epoch):
        time.sleep(self.seconds)
        rows = list(rows)
        return self.inputs[rows], self.targets[rows]


def sha256_of_weights(model) -> str:
    digest = hashlib.sha256()
    for weight in model.get_weights():
        digest.update(weight.tobytes())
    return digest.hexdigest()


def main(size: str, epochs: str, threads: str, checkpoint_dir: str, seconds: str) -> None:
    import ggcnn_net2net as gn
    from ggcnn_net2net.training import Recipe, set_threads, train

    set_threads(int(threads))
    data = SyntheticGrasps(12, int(size), seconds=float(seconds))
    model = gn.build_ggcnn("narrow", input_size=int(size), seed=1)
    recipe = Recipe(epochs=int(epochs))
    result = train(
        model, data, recipe, checkpoint_dir=checkpoint_dir or None, on_progress=lambda *state: print(*state, flush=True)
    )
    print(sha256_of_weights(result.model))


if __name__ == "__main__":
    main(*sys.argv[1:])
