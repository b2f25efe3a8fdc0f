from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from skimage.transform import resize, rotate

from ggcnn_net2net.datasets.augmentation import PLAIN, Augmentation, augment
from ggcnn_net2net.datasets.label_maps import draw_label_maps
from ggcnn_net2net.datasets.raw import open_scenes
from ggcnn_net2net.datasets.scene import LabelledScene
from ggcnn_net2net.errors import DatasetError
from ggcnn_net2net.grasping import Grasp, grasp_to_rectangle, rectangle_to_grasp, wrap_angle

SMALL = Augmentation(size=100)
SHAPE = (150, 200)


def scene_with_spot(grasp):
    """A flat scene with a Gaussian bump at corner 0 of the grasp's rectangle."""
    rectangle = grasp_to_rectangle(grasp, 20)
    row, col = np.indices(SHAPE)
    distance = (row - rectangle[0, 0]) ** 2 + (col - rectangle[0, 1]) ** 2
    depth = (1 + 0.5 * np.exp(-distance / (2 * 2.0**2))).astype(np.float32)
    return LabelledScene("spot", "spot", depth, np.zeros((*SHAPE, 3), np.uint8), rectangle[None])


# No corner comes so close to the border that the mirror image beyond it shows beside the spot.
grasps = st.builds(
    Grasp,
    row=st.floats(45, 105),
    col=st.floats(45, 155),
    angle=st.floats(-np.pi / 2, np.pi / 2, exclude_max=True),
    width_px=st.floats(15, 50),
)


@given(grasps, st.integers(0, 1000))
def test_rectangles_move_with_the_image(grasp, seed):
    """A bright spot at a rectangle's corner is at that corner in every sample."""
    sample = augment(scene_with_spot(grasp), np.random.default_rng(seed), SMALL)
    corner = sample.rectangles[0, 0]
    assume((corner > 10).all() and (corner < 89).all())
    top, left = np.round(corner).astype(int) - 10
    window = sample.depth[top : top + 21, left : left + 21]
    weight = np.clip(window - window.max() + 0.4, 0, None)  # the spot's upper part
    rows, cols = np.indices(window.shape)
    centroid = [(axis * weight).sum() / weight.sum() for axis in (rows, cols)] + np.array([top, left])
    np.testing.assert_allclose(centroid, corner, atol=0.35)


@given(grasps, st.integers(0, 1000))
def test_angle_and_opening_transform(grasp, seed):
    sample = augment(scene_with_spot(grasp), np.random.default_rng(seed), SMALL)
    rng = np.random.default_rng(seed)
    rotation, zoom = rng.uniform(-np.pi, np.pi), rng.uniform(0.4, 1.0)
    moved, jaw = rectangle_to_grasp(sample.rectangles[0])
    assert wrap_angle(moved.angle - grasp.angle - rotation) == pytest.approx(0, abs=1e-6)
    assert moved.width_px == pytest.approx(grasp.width_px / zoom)
    assert jaw == pytest.approx(20 / zoom)
    np.testing.assert_array_equal(sample.maps, draw_label_maps(sample.rectangles, (100, 100)))


@settings(max_examples=30)
@given(st.integers(0, 1000))
def test_depth_is_centred_and_clipped(seed):
    scene = scene_with_spot(Grasp(70, 90, 0.2, 30))
    deep = replace(scene, depth=np.where(np.arange(200) < 90, 1, 9) * np.ones(SHAPE, np.float32))
    for each in (scene, deep):
        depth = augment(each, np.random.default_rng(seed), SMALL).depth
        assert depth.dtype == np.float32
        assert depth.shape == (100, 100)
        assert np.abs(depth).max() <= 1
    assert augment(scene, np.random.default_rng(seed), SMALL).depth.mean() == pytest.approx(0, abs=1e-6)


def test_plain_is_a_crop():
    scene = replace(scene_with_spot(Grasp(70, 90, 0.2, 30)), rgb=np.arange(150 * 200 * 3).reshape(150, 200, 3) % 251)
    scene = replace(scene, rgb=scene.rgb.astype(np.uint8))
    sample = augment(scene, np.random.default_rng(0), replace(PLAIN, size=100))
    top, left = np.floor(scene.rectangles.mean(axis=(0, 1))).astype(int) - 50
    np.testing.assert_array_equal(sample.rgb, scene.rgb[top : top + 100, left : left + 100])
    crop = scene.depth[top : top + 100, left : left + 100]
    np.testing.assert_allclose(sample.depth, crop - crop.mean(), atol=1e-6)
    np.testing.assert_allclose(sample.rectangles, scene.rectangles - [top, left])


@pytest.mark.parametrize("centre", [(5, 5), (145, 195)])
def test_crops_stay_within_the_image(centre):
    scene = scene_with_spot(Grasp(*centre, 0, 20))
    sample = augment(scene, np.random.default_rng(0), replace(PLAIN, size=100))
    corner = np.clip(np.floor(centre) - 50, 0, np.array(SHAPE) - 100)
    np.testing.assert_allclose(sample.rectangles, scene.rectangles - corner)


@pytest.mark.parametrize("centre", [(20, 30), (75, 100), (140, 20), (10, 190)])
def test_beyond_the_border_lies_the_mirror_image(centre):
    """As published; a crop beside the border shows much of it once it is turned."""
    rows, cols = np.indices(SHAPE)
    waves = (1 + 0.2 * np.sin(rows / 9) + 0.1 * np.cos(cols / 7) + 0.002 * cols).astype(np.float32)
    scene = replace(scene_with_spot(Grasp(*centre, 0.2, 30)), depth=waves)
    middle = scene.rectangles.mean(axis=(0, 1))
    top, left = np.clip(np.floor(middle).astype(int) - 50, 0, np.array(SHAPE) - 100)
    for seed in range(4):
        sample = augment(scene, np.random.default_rng(seed), replace(SMALL, zoom=(1, 1)))
        angle = np.degrees(np.random.default_rng(seed).uniform(-np.pi, np.pi))
        turned = rotate(waves, angle, center=middle[::-1], mode="symmetric", preserve_range=True)
        expected = turned[top : top + 100, left : left + 100]
        np.testing.assert_allclose(sample.depth, expected - expected.mean(), atol=2e-3)


def test_same_as_the_steps_of_the_public_code(data_root):
    """Rotation, crop and zoom one after the other, each interpolated, as published."""
    scene = open_scenes(data_root / "cornell")[0]
    for seed in range(4):
        sample = augment(scene, np.random.default_rng(seed), Augmentation())
        rng = np.random.default_rng(seed)
        angle, zoom = rng.uniform(-np.pi, np.pi), rng.uniform(0.4, 1.0)
        centre = scene.rectangles.mean(axis=(0, 1))
        turned = rotate(scene.depth, np.degrees(angle), center=centre[::-1], mode="symmetric", preserve_range=True)
        top, left = np.clip(centre.astype(int) - 150, 0, np.array(scene.depth.shape) - 300)
        margin = int(300 * (1 - zoom)) // 2
        window = turned[top + margin : top + 300 - margin, left + margin : left + 300 - margin]
        expected = resize(window, (300, 300), mode="symmetric", preserve_range=True)
        difference = np.abs(sample.depth - (expected - expected.mean()))
        # Whole pixels of the published zoom move the image's edge by up to a pixel.
        assert np.median(difference) < 0.001  # metres
        assert np.corrcoef(sample.depth.ravel(), expected.ravel())[0, 1] > 0.999


def test_same_seed_same_sample():
    scene = scene_with_spot(Grasp(70, 90, 0.2, 30))
    first, second, other = (augment(scene, np.random.default_rng(seed), SMALL) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.depth, second.depth)
    assert (first.depth != other.depth).any()


def test_unusable_scenes_are_refused():
    scene = scene_with_spot(Grasp(70, 90, 0.2, 30))
    rng = np.random.default_rng(0)
    with pytest.raises(DatasetError, match="300x300"):
        augment(scene, rng, Augmentation())
    with pytest.raises(DatasetError, match="leave the scene out"):
        augment(replace(scene, rectangles=np.zeros((0, 4, 2))), rng, SMALL)
    with pytest.raises(DatasetError, match="NaN"):
        augment(replace(scene, depth=np.full(SHAPE, np.nan, np.float32)), rng, SMALL)
    with pytest.raises(DatasetError, match="one size"):
        augment(replace(scene, rgb=np.zeros((10, 10, 3), np.uint8)), rng, SMALL)


@pytest.mark.parametrize("values", [{"zoom": (0, 1)}, {"zoom": (0.9, 0.4)}, {"zoom": (0.5, 1.5)}, {"per_scene": 0}])
def test_impossible_settings_are_refused(values):
    with pytest.raises(DatasetError, match="expected"):
        Augmentation(**values)
