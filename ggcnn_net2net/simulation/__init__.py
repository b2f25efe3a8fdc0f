"""The paper's grasp benchmark in pybullet: objects, scenes, gripper, trials. Knows grasps, but no Keras.

Frames: world coordinates in metres, z up, the ground plane at z = 0. Quaternions are (x, y, z, w) as in pybullet.
"""

from ggcnn_net2net.quiet import silence_output
from ggcnn_net2net.simulation.gripper_spec import PAPER_GRIPPER, GripperSpec, load_gripper

with silence_output():  # pybullet prints its build time when it is imported
    import pybullet  # noqa: F401

__all__ = ["PAPER_GRIPPER", "GripperSpec", "load_gripper"]
