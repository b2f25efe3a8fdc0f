import pytest

from ggcnn_net2net.grasping import Grasp
from ggcnn_net2net.protocol import PAPER
from ggcnn_net2net.simulation.pictures import trial_strip


@pytest.mark.parametrize(
    ("col", "captions"),
    [(150, ["before closing", "closed", "over the bin", "end"]), (220, ["before closing", "closed", "end"])],
    ids=["it is carried", "it is missed"],
)
def test_a_strip_shows_the_phases_that_a_trial_had(world, box_scene, col, captions):
    strip, result = trial_strip(world, box_scene, Grasp(150.0, float(col), 0.0, 30.0), PAPER)
    assert result.success is ("over the bin" in captions)
    assert strip.captions == captions
    assert len(strip.pictures) == 1 + len(captions)
    assert strip.title == f"box/0: {result.outcome}"
