from dataclasses import fields

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
