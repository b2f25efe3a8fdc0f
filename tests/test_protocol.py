from dataclasses import fields, replace

import pytest

from ggcnn_net2net.errors import GGCNNError
from ggcnn_net2net.protocol import CORRECTED, PAPER, Protocol, protocol_named


def test_presets_differ_in_every_field():
    """A field in which they agree is no choice, and does not belong into Protocol."""
    for field in fields(Protocol):
        assert getattr(PAPER, field.name) != getattr(CORRECTED, field.name), field.name


def test_presets_by_name():
    assert protocol_named("paper") is PAPER
    assert protocol_named("Corrected") is CORRECTED
    with pytest.raises(GGCNNError, match="'published'"):
        protocol_named("published")


def test_presets_are_what_the_results_were_made_with():
    """A change of a value is a change of every result, and must not go unseen."""
    assert PAPER.as_dict() == {
        "name": "PAPER",
        "sim_angle_window": 5,
        "object_centre": "vertex_mean",
        "coupled_jaws": False,
        "solver_iterations": 50,
        "palm_clearance": 0.0,
        "fingertip_clearance": None,
        "wider_noise": 0.0,
        "wrapped_angle_difference": False,
        "iou_recentres_depth": True,
        "masked_loss": False,
        "shuffled_rows": False,
        "last_lookahead_takes_last": True,
    }
    assert CORRECTED.as_dict() == {
        "name": "CORRECTED",
        "sim_angle_window": 0,
        "object_centre": "volume",
        "coupled_jaws": True,
        "solver_iterations": 200,
        "palm_clearance": 0.005,
        "fingertip_clearance": 0.002,
        "wider_noise": 0.3,
        "wrapped_angle_difference": True,
        "iou_recentres_depth": False,
        "masked_loss": True,
        "shuffled_rows": True,
        "last_lookahead_takes_last": False,
    }


def test_a_centre_that_does_not_exist_is_refused():
    with pytest.raises(GGCNNError, match="'vertex_mean' or 'volume', received 'middle'"):
        replace(PAPER, object_centre="middle")
