"""The code in the pages for users of predictions and exports runs, and gives the grasp of `GraspPredictor`."""

import math
import os
import re
import shutil
import subprocess
import sys
from contextlib import chdir
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import ggcnn_net2net as gn
from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.datasets.raw import read_image
from ggcnn_net2net.inference import PRESETS
from ggcnn_net2net.inpainting import fill_missing

DOCS = Path(__file__).parents[1] / "docs"
EXPORTED = ("network.hdf5", "network.onnx", "network.tflite", "network.xml")
HEADERS = Path("/usr/include/onnxruntime")  # of Debian's libonnxruntime-dev; g++ looks in CPATH, too
# No package that pip installs brings these headers, so where there are none there are no tests of C++, either.
WITH_CPP = shutil.which("g++") is not None and any(
    (Path(folder) / "onnxruntime_cxx_api.h").exists() for folder in (HEADERS, *os.environ.get("CPATH", "").split(":"))
)
TURN = math.radians(25)


def blocks(page, language):
    """The code blocks of a page in a language, in order."""
    return re.findall(
        rf"^```{language}\n(.*?)^```$", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )


def box(height, width):
    """Depth in metres of a box that is twice as long as it is wide, turned by `TURN` on a table 1.5 m away."""
    random = np.random.default_rng(0)
    rows, cols = np.mgrid[:height, :width] - np.array([height / 2, width / 2]).reshape(2, 1, 1)
    along = np.cos(TURN) * cols - np.sin(TURN) * rows
    across = np.sin(TURN) * cols + np.cos(TURN) * rows
    depth = 1.5 + random.normal(0, 5e-4, (height, width))
    return np.where((abs(along) < 60) & (abs(across) < 20), depth - 0.06, depth).astype(np.float32)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files that the pages read: a small trained network in every format, and depth images."""
    path = tmp_path_factory.mktemp("stacks")
    model = gn.load_ggcnn("zoo:narrow")
    crop, depth = box(300, 300), box(480, 640)
    for name in EXPORTED:
        gn.export(model, path / name, samples=crop[None])
    np.save(path / "crop.npy", crop)
    depth[200:210, 300:320] = np.nan
    np.save(path / "depth.npy", depth)
    return path


@pytest.fixture(scope="module")
def run(folder):
    """Function (page, blocks): run Python blocks of a page, all unless told, one after the other; their variables."""

    network = repr(str(folder / "network.hdf5"))

    def run_blocks(page, chosen=slice(None)):
        space = {"__name__": "page"}
        with chdir(folder):
            for code in blocks(page, "python")[chosen]:
                exec(compile(code.replace('"published"', network), page, "exec"), space)
        return space

    return run_blocks


@pytest.fixture(scope="module")
def rss_2018(folder):
    """The grasp of crop.npy with the constants that the pages without this package take: no distance to the border."""
    preset = replace(PRESETS["rss_2018"], decoding=gn.Decoding(peaks_at_border=True))
    (grasp,) = gn.GraspPredictor(folder / "network.hdf5", preset=preset).predict(np.load(folder / "crop.npy"))
    return grasp


def test_inference(run):
    space = run("inference.md")
    assert isinstance(space["grasp"], gn.CameraGrasp)
    assert space["quality"].shape == (300, 300)
    assert space["prediction"].grasps[0] == space["predictor"].predict(space["depth"], space["camera"])[0]


def test_export(run, folder, monkeypatch):
    exported = []
    monkeypatch.setattr(gn, "export", lambda *arguments: exported.append(arguments))  # `folder` has done it
    run("export.md")
    assert exported == [(str(folder / "network.hdf5"), "network.onnx")]


def test_kinova(run):
    space = run("stacks/kinova.md")
    assert np.shape(space["quality"]) == (1, 300, 300, 1)
    grasp, intrinsics = space["grasp"], space["K"]
    x, y, z, angle, width = space["command"]
    assert (x, y) == pytest.approx(((grasp.col - intrinsics[2]) / intrinsics[0] * z, (grasp.row - 235.5) / 575.8 * z))
    assert (angle, width * 4 / 3 * z / 575.8) == pytest.approx((grasp.angle, space["opening"]))


def test_mvp_grasp(run):
    space = run("stacks/mvp_grasp.md")
    grasp, yaw = space["grasp"], space["yaw"]
    x, y, z = grasp.position
    assert space["position"] == pytest.approx([0.3 + x, -y, 0.6 - z])
    # The x axis of quaternion_from_euler(π, 0, yaw), in the base frame, is across the closing direction: a Panda's
    # fingers close along its y axis.
    closing = space["rotation"] @ grasp.closing_direction
    assert np.dot(closing, [math.cos(yaw), math.sin(yaw), 0]) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(("runtime", "blocks_run"), [("LiteRT", 2), ("OpenVINO", 3), ("ONNX Runtime", 4)])
def test_edge(run, rss_2018, folder, runtime, blocks_run):
    names = [
        re.search("litert|openvino|onnxruntime|crop|filled", code)[0] for code in blocks("stacks/edge.md", "python")
    ]
    assert names == ["crop", "litert", "openvino", "onnxruntime", "filled"]
    space = run("stacks/edge.md", slice(0, blocks_run))
    model = gn.load_ggcnn(folder / "network.hdf5")
    for name, expected in zip(HEADS, model(space["image"]), strict=True):
        np.testing.assert_allclose(space["maps"][name], expected[0, ..., 0], atol=1e-4)
    assert (space["row"], space["col"]) == (rss_2018.row, rss_2018.col)
    received = [space["angle"], space["width_px"], space["quality"][space["row"], space["col"]]]
    assert received == pytest.approx([rss_2018.angle, rss_2018.width_px, rss_2018.quality], abs=2e-3)


def test_missing_pixels_are_filled_as_by_the_package():
    space = {}
    exec(blocks("stacks/edge.md", "python")[-1], space)
    rows, columns = np.indices((40, 50))
    depth = (0.8 + 0.002 * rows + 0.1 * (columns > 20)).astype(np.float32)
    depth[5:9, 18:25] = 0
    depth[:2, :3] = np.nan
    missing = ~(depth > 0)
    np.testing.assert_array_equal(space["filled"](depth), fill_missing(depth, missing))


class Message(SimpleNamespace):
    """A ROS message: fields by name; those of a pose are there from the beginning."""

    def __getattr__(self, name):
        if name not in ("pose", "position", "orientation"):
            raise AttributeError(name)
        setattr(self, name, Message())
        return getattr(self, name)


class Node:
    """Takes note of topics, messages and warnings."""

    def __init__(self, name):
        self.topics, self.callbacks, self.warnings = {}, {}, []

    def create_publisher(self, kind, topic, depth):
        self.topics[topic] = []
        return SimpleNamespace(publish=self.topics[topic].append)

    def create_subscription(self, kind, topic, callback, profile):
        self.callbacks[topic] = callback

    def get_logger(self):
        return SimpleNamespace(warning=lambda text, **options: self.warnings.append(text))


def ros_modules():
    """Stand-ins for the modules of ROS 2 that the page imports."""
    contents = {
        "rclpy": {},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"QoSProfile": Message, "ReliabilityPolicy": SimpleNamespace(BEST_EFFORT=2)},
        "geometry_msgs.msg": {"PoseStamped": Message},
        "sensor_msgs.msg": {"CameraInfo": Message, "Image": Message},
        "std_msgs.msg": {"Float32": Message},
    }
    for name, content in contents.items():
        module = ModuleType(name)
        vars(module).update(content)
        yield name, module


@pytest.fixture
def ros_node(run, monkeypatch):
    for name, module in ros_modules():
        monkeypatch.setitem(sys.modules, name, module)
    return run("stacks/ros2.md")["GraspNode"]()


def image_message(depth, encoding, is_bigendian=False, padding=0):
    kind = {"32FC1": "f4", "16UC1": "u2"}[encoding]
    rows = np.pad(depth, ((0, 0), (0, padding))).astype((">" if is_bigendian else "<") + kind)
    height, width = depth.shape
    return Message(
        header="camera_depth_optical_frame",
        encoding=encoding,
        is_bigendian=is_bigendian,
        height=height,
        width=width,
        step=rows.strides[0],
        data=rows.tobytes(),
    )


@pytest.mark.parametrize(("is_bigendian", "padding"), [(False, 0), (True, 0), (False, 4)])
@pytest.mark.parametrize("encoding", ["32FC1", "16UC1"])
def test_ros2(ros_node, folder, encoding, is_bigendian, padding):
    focal = (600.0, 500.0)
    camera = [focal[0], 0.0, 320.0, 0.0, focal[1], 240.0, 0.0, 0.0, 1.0]
    depth = np.load(folder / "depth.npy")
    if encoding == "16UC1":
        depth = np.nan_to_num(depth * 1000).round()
    on_depth = ros_node.callbacks["depth/image"]
    message = image_message(depth, encoding, is_bigendian, padding)
    on_depth(message)
    assert ros_node.topics == {"grasp/pose": [], "grasp/opening": []}  # no intrinsics yet
    ros_node.callbacks["depth/camera_info"](Message(k=camera))
    on_depth(message)

    (sent,), (opening,) = ros_node.topics.values()
    (grasp,) = gn.GraspPredictor(folder / "network.hdf5", preset="kinova").predict(depth, camera)
    assert sent.header == "camera_depth_optical_frame"
    position, orientation = sent.pose.position, sent.pose.orientation
    assert (position.x, position.y, position.z) == grasp.position
    assert opening.data == grasp.opening
    z, w = orientation.z, orientation.w
    x_axis = (w * w - z * z, 2 * w * z, 0.0)  # of the rotation (0, 0, z, w)
    assert x_axis == pytest.approx(grasp.closing_direction)
    # Along that axis the image's columns grow and its rows fall where the angle is positive.
    assert math.atan2(-x_axis[1] * focal[1], x_axis[0] * focal[0]) == pytest.approx(grasp.angle)


def test_ros2_goes_on_after_an_image_without_depth(ros_node):
    ros_node.callbacks["depth/camera_info"](Message(k=[600.0, 0, 320, 0, 600, 240, 0, 0, 1]))
    ros_node.callbacks["depth/image"](image_message(np.zeros((480, 640)), "16UC1"))
    assert len(ros_node.warnings) == 1
    assert ros_node.topics["grasp/pose"] == []


def test_ros2_is_short():
    (code,) = blocks("stacks/ros2.md", "python")
    assert len(code.splitlines()) < 60


@pytest.fixture(scope="module")
def program(folder):
    """Function (network, depth image): the numbers that the C++ program prints."""
    import onnxruntime

    (code,) = blocks("stacks/cpp_onnxruntime.md", "cpp")
    (folder / "grasp.cpp").write_text(code, encoding="utf-8")
    (library,) = (Path(onnxruntime.__file__).parent / "capi").glob("libonnxruntime.so.*")
    soname = folder / "libonnxruntime.so.1"
    soname.symlink_to(library)
    command = ["g++", "-std=c++17", "-O2", "-Wall", "-Wextra", "-Werror", "-I", HEADERS, "grasp.cpp", soname]
    subprocess.run([*command, f"-Wl,-rpath,{folder}", "-o", "grasp"], cwd=folder, check=True)

    def run_program(network, depth):
        depth.astype(np.float32).tofile(folder / "depth.raw")
        done = subprocess.run(
            [folder / "grasp", network, folder / "depth.raw"], capture_output=True, text=True, check=True
        )
        return dict(zip(*[iter(done.stdout.split())] * 2, strict=True))

    return run_program


def assert_same(printed, grasp):
    assert (float(printed["row"]), float(printed["col"])) == (grasp.row, grasp.col)
    assert float(printed["angle"]) == pytest.approx(grasp.angle, abs=1e-4)
    assert float(printed["width_px"]) == pytest.approx(grasp.width_px, abs=2e-3)
    assert float(printed["quality"]) == pytest.approx(grasp.quality, abs=1e-4)


def check_cpp(program, folder, rss_2018):
    assert_same(program(folder / "network.onnx", np.load(folder / "crop.npy")), rss_2018)


def check_cpp_on_cornell(program, folder, data_root):
    network = gn.export("published", folder / "published.onnx", samples=box(300, 300)[None])
    preset = replace(PRESETS["rss_2018"], decoding=gn.Decoding(peaks_at_border=True))
    predictor = gn.GraspPredictor("published", preset=preset)
    files = sorted((data_root / "cornell").rglob("pcd*d.tiff"))[::10]
    assert len(files) == 10
    for file in files:
        depth = read_image(file)
        crop = fill_missing(depth, np.isnan(depth))[90:390, 170:470]
        assert_same(program(network, crop), predictor.predict(crop)[0])


if WITH_CPP:
    test_cpp = check_cpp
    test_cpp_on_cornell = pytest.mark.slow(check_cpp_on_cornell)
