"""Fixtures of the dataset tests. Makes `small_scenes`, which stands beside the tests, importable from them."""

import sys
from pathlib import Path

import numpy as np
import pytest

from ggcnn_net2net.datasets.augmentation import PLAIN, augment

sys.path.insert(0, str(Path(__file__).parent))

from small_scenes import make_scene, write_cornell_scene


@pytest.fixture
def cornell(tmp_path):
    """Six scenes in two sub-folders, three objects of two scenes each."""
    root = tmp_path / "cornell"
    for number in range(100, 106):
        corners = [(150, 200), (210, 190), (215, 220), (155, 230)]
        text = "".join(f"{x + number - 100} {y} \n" for x, y in corners)
        write_cornell_scene(root / ("01" if number < 103 else "02"), number, rectangles=text)
    lines = [
        f"{number:04d} {(number - 100) // 2} thing{(number - 100) // 2} pcdb0002r.png" for number in range(100, 106)
    ]
    (root / "z.txt").write_text("\n".join(lines) + "\n")
    return root


@pytest.fixture
def samples():
    """Three samples; the last has more rectangles than the layout reserves room for."""
    many = [(200 + index, 300 - index, index / 10, 30 + index) for index in range(40)]
    scenes = [make_scene("a"), make_scene("b", grasps=[(240, 320, 1.0, 100)]), make_scene("c", grasps=many)]
    return [augment(scene, np.random.default_rng(0), PLAIN) for scene in scenes]
