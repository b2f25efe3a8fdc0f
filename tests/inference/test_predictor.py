from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import keras
import numpy as np
import pytest

import ggcnn_net2net as gn
from ggcnn_net2net.errors import ArchitectureError, DepthImageError, GraspError, ModelFileError
from ggcnn_net2net.grasping import decode_maps
from ggcnn_net2net.inference.intrinsics import CameraGrasp
from ggcnn_net2net.inference.predict import predict_grasps, predict_maps
from ggcnn_net2net.inference.predictor import GraspPredictor
from ggcnn_net2net.inference.presets import PAPER_SIMULATOR, PRESETS, RSS_2018_PRESET

SIDE = 36
EAGER = replace(RSS_2018_PRESET, decoding=gn.Decoding(quality_sigma=1, min_distance=2, threshold=-1e9), crop=None)
"""Finds grasps in whatever a network says, also an untrained one."""


@pytest.fixture(scope="module")
def small():
    return gn.build_ggcnn("shallow", input_size=SIDE, seed=0)


@pytest.fixture(scope="module")
def predictor(small):
    return GraspPredictor(small, preset=EAGER)


@pytest.fixture(scope="module")
def published(data_root):
    return gn.load_ggcnn("published")


def scene(shape=(SIDE, SIDE), seed=0):
    random = np.random.default_rng(seed)
    depth = cv2.GaussianBlur(random.uniform(0.5, 1.5, shape), (0, 0), 2) + random.normal(0, 0.001, shape)
    return depth.astype(np.float32)


def real_scene(data_root, number):
    return cv2.imread(str(data_root / "cornell" / "01" / f"pcd{number:04d}d.tiff"), cv2.IMREAD_UNCHANGED)


@pytest.mark.parametrize("number", [100, 110, 120])
def test_rss_2018_is_the_network_and_the_decoding_in_sequence(published, data_root, number):
    depth = real_scene(data_root, number)
    crop = depth[90:390, 170:470]
    (maps,) = predict_maps(published, [np.clip(crop - crop.mean(), -1, 1)])
    expected = decode_maps(*maps, n_grasps=3)
    found = GraspPredictor(published).predict(depth, n_grasps=3)
    assert 1 <= len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        assert (one.row - 90, one.col - 170) == (other.row, other.col)
        assert (one.angle, one.width_px, one.quality) == pytest.approx(
            (other.angle, other.width_px, other.quality), abs=1e-3
        )


def test_the_papers_simulator_preset_is_predict_grasps(published, data_root):
    depth = np.stack([real_scene(data_root, number)[90:390, 170:470] for number in (101, 111)])
    expected = predict_grasps(published, depth, PAPER_SIMULATOR.decoding)
    found = GraspPredictor(published, preset="paper_simulator").predict(depth)
    for (one,), other in zip(found, expected, strict=True):
        assert (one.row, one.col) == (other.row, other.col)
        assert one.angle == pytest.approx(other.angle, abs=1e-3)


def test_the_whole_image_is_seen_in_mode_full(published, data_root):
    """Away from the borders, a map of the whole image is the map of a crop that has the same mean."""
    depth = real_scene(data_root, 100)[:473, :631]
    full = GraspPredictor(published, preset=replace(RSS_2018_PRESET, clip=None), mode="full", image_shape=depth.shape)
    prediction = full.look(depth, n_grasps=50)
    assert prediction.maps.shape == (4, 473, 631)
    rows, cols = slice(84, 384), slice(168, 468)  # multiples of the stride
    (crop,) = predict_maps(published, [depth[rows, cols] - depth.mean(dtype=np.float64)])
    np.testing.assert_allclose(prediction.maps[0][rows, cols][60:-60, 60:-60], crop[0][60:-60, 60:-60], atol=1e-4)
    grasps = prediction.grasps
    assert [grasp.quality for grasp in grasps] == sorted((grasp.quality for grasp in grasps), reverse=True)


def test_one_image_many_images_no_image(predictor):
    images = np.stack([scene(seed=seed) for seed in range(3)])
    one_by_one = [predictor.predict(image, n_grasps=2) for image in images]
    assert all(len(grasps) == 2 for grasps in one_by_one)
    assert predictor.predict(images, n_grasps=2) == one_by_one
    assert predictor.predict(images[:0]) == []
    assert predictor.predict(list(images[:1])) == [one_by_one[0][:1]]


def test_no_grasp_is_an_empty_list(small):
    quiet = GraspPredictor(small, preset=replace(EAGER, decoding=gn.Decoding(threshold=1e9)))
    assert quiet.predict(scene()) == []
    assert quiet.predict(scene()[None], camera=[500, 0, 18, 0, 500, 18, 0, 0, 1]) == [[]]


@pytest.mark.parametrize(
    "change",
    [
        lambda depth: depth.astype(np.float64),
        np.asfortranarray,
        lambda depth: np.repeat(np.repeat(depth, 2, axis=0), 3, axis=1)[::2, ::3],
        lambda depth: depth[::-1][::-1],
        lambda depth: depth.astype(np.float64) * 1000,
        lambda depth: depth.tolist(),
    ],
)
def test_types_and_layouts_do_not_matter(predictor, change):
    (expected,) = predictor.predict(scene())
    (found,) = predictor.predict(change(scene()))
    assert (found.row, found.col) == (expected.row, expected.col)
    assert found.angle == pytest.approx(expected.angle, abs=1e-4)


def test_integers_are_millimetres(predictor):
    millimetres = (scene() * 1000).round()
    expected = predictor.predict(millimetres / 1000)
    for dtype in (np.uint16, np.int32, np.uint64):
        prediction = predictor.look(millimetres.astype(dtype))
        assert prediction.depth_unit == "mm"
        assert prediction.grasps == expected


@pytest.mark.parametrize("mode", ["crop", "full"])
@pytest.mark.parametrize("shape", [(1, 5), (5, 7), (37, 35), (61, 200), (480, 640)])
def test_every_size(small, mode, shape):
    predictor = GraspPredictor(small, preset=EAGER, mode=mode)
    depth = np.abs(scene(shape)) + 0.1
    prediction = predictor.look(depth, n_grasps=5)
    assert prediction.maps.shape[1:] == ((SIDE, SIDE) if mode == "crop" else shape)
    for grasp in prediction.grasps:
        assert -0.5 <= grasp.row <= shape[0] - 0.5
        assert -0.5 <= grasp.col <= shape[1] - 0.5


def test_grasps_in_metres(predictor):
    depth = scene((100, 100))
    camera = gn.Intrinsics(90.0, 90.0, 50.0, 50.0)
    (in_pixels,) = predictor.predict(depth)
    (grasp,) = predictor.predict(depth, camera)
    assert isinstance(grasp, CameraGrasp)
    assert (grasp.row, grasp.col, grasp.angle) == (in_pixels.row, in_pixels.col, in_pixels.angle)
    z = float(depth[round(grasp.row), round(grasp.col)])
    assert grasp.position == pytest.approx(((grasp.col - 50) / 90 * z, (grasp.row - 50) / 90 * z, z))
    assert grasp.opening == pytest.approx(grasp.width_px * z / 90)
    assert grasp.measured


def test_threads_get_the_same_grasps_as_one(predictor):
    images = [scene(seed=seed) for seed in range(24)]
    expected = [predictor.predict(image, n_grasps=3) for image in images]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda image: predictor.predict(image, n_grasps=3), images))
    assert found == expected


def test_nothing_is_compiled_after_construction(small):
    traces = []

    class Counting(keras.layers.Layer):
        def call(self, inputs):
            traces.append(inputs.shape)
            return inputs

    inputs = keras.Input((SIDE, SIDE, 1))
    layers = [type(layer).from_config(layer.get_config()) for layer in small.layers[1:]]
    x = Counting()(inputs)
    for layer in layers[:-4]:
        x = layer(x)
    predictor = GraspPredictor(keras.Model(inputs, [head(x) for head in layers[-4:]]), preset=EAGER)
    compiled = len(traces)
    assert compiled > 0
    for shape, dtype in (((36, 36), np.float32), ((50, 90), np.float64), ((20, 20), np.float32), ((480, 640), float)):
        predictor.predict(np.abs(scene(shape)).astype(dtype) + 0.1)
    predictor.predict((scene() * 1000).astype(np.uint16))
    predictor.predict(np.stack([scene(), scene()]))
    assert len(traces) == compiled


def test_backends_agree(published, data_root):
    pytest.importorskip("openvino")
    depth = np.stack([real_scene(data_root, number) for number in (104, 112, 121)])
    camera = [575, 0, 320, 0, 575, 240, 0, 0, 1]
    expected, found = (
        GraspPredictor(published, preset="kinova", backend=backend).predict(depth, camera)
        for backend in ("tensorflow", "openvino")
    )
    for (one,), (other,) in zip(found, expected, strict=True):
        assert (one.row, one.col) == (other.row, other.col)
        assert one.position == other.position
        assert (one.angle, one.opening) == pytest.approx((other.angle, other.opening), abs=1e-4)


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_predicts_with_holes(published, data_root, name):
    depth = real_scene(data_root, 103)
    depth[200:230, 300:330] = 0
    predictor = GraspPredictor(published, preset=name)
    assert predictor.preset is PRESETS[name]
    grasps = predictor.predict(depth, camera=[575, 0, 320, 0, 575, 240, 0, 0, 1], n_grasps=2)
    assert grasps
    assert all(np.isfinite(grasp.position).all() for grasp in grasps)


def test_wrong_arguments(small, predictor, tmp_path):
    with pytest.raises(DepthImageError, match="kinova"):
        GraspPredictor(small, preset="kinva")
    with pytest.raises(DepthImageError, match="crop or full"):
        GraspPredictor(small, mode="half")
    with pytest.raises(ArchitectureError, match="tensorflow"):
        GraspPredictor(small, backend="torch")
    with pytest.raises(ModelFileError):
        GraspPredictor(tmp_path / "none.hdf5")
    with pytest.raises(ModelFileError, match="pos_out"):
        GraspPredictor(keras.Model(small.inputs, small.outputs[::-1]))
    with pytest.raises(DepthImageError, match="predict takes several"):
        predictor.look(scene()[None])
    with pytest.raises(GraspError, match="n_grasps"):
        predictor.predict(scene(), n_grasps=0)
    with pytest.raises(DepthImageError, match="missing"):
        predictor.predict(np.stack([scene(), np.zeros_like(scene())]))
    with pytest.raises(DepthImageError, match="CameraInfo"):
        predictor.predict(scene(), camera="realsense")


def test_a_model_file_is_taken_as_well(small, predictor, tmp_path):
    gn.save_ggcnn(small, tmp_path / "small.hdf5")
    assert GraspPredictor(tmp_path / "small.hdf5", preset=EAGER).predict(scene()) == predictor.predict(scene())
