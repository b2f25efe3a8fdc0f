"""Which channels of a model have to be copied together.

Every channel of every layer's output is a vertex. A layer that passes a channel on (BatchNormalization,
pooling, Add, Concatenate, ...) ties its input vertex to its output vertex; a convolution ties nothing, it
makes new channels. The connected components are the groups of channels that must be copied together: a skip
connection puts the channels of all layers that it adds into the same groups, whatever lies in between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ggcnn_net2net.errors import SurgeryError
from ggcnn_net2net.net2net.graph import ModelGraph
from ggcnn_net2net.net2net.rules import RULES, activation_refusal, is_expandable, refusal

PerChannel = dict[str, np.ndarray]
"""Layer name -> one integer for each of its output channels."""


@dataclass(frozen=True)
class Channels:
    """The channel groups of one model."""

    groups: PerChannel
    """The group of each channel."""

    blocks: PerChannel
    """The block in which each channel lies; copies go to the end of their block. The channels of a layer are
    one block, except where a Concatenate or a Flatten lays several side by side."""

    fixed: dict[int, str]
    """Group -> why it cannot be copied."""

    expandable: list[str]
    """Names of the layers that *deeper* and *wider* are for, in model order."""

    @classmethod
    def of(cls, graph: ModelGraph) -> Channels:
        """Find the groups of `graph`."""
        refused = {name: reason for name in graph.layers if (reason := _refusal(graph, name))}
        groups, blocks = _groups_and_blocks(graph, [name for name in graph.layers if name not in refused])
        returned = np.concatenate([groups[name] for name in graph.outputs])
        expandable = [
            name
            for name, layer in graph.layers.items()
            if is_expandable(layer) and not np.isin(groups[name], returned).any()
        ]
        return cls(groups, blocks, _fixed(graph, groups, refused), expandable)

    def layer_name(self, layer: int | str) -> str:
        """Name of an expandable layer, given by name or by the paper's index.

        Raises:
            SurgeryError: there is no such layer, or it is not expandable.
        """
        if layer in self.expandable:
            return str(layer)
        if isinstance(layer, int | np.integer) and 1 <= layer <= len(self.expandable):
            return self.expandable[layer - 1]
        problem = "does not exist"
        if layer in self.groups:
            problem = "is an output of the model, or neither a convolution nor a Dense layer"
        known = ", ".join(f"{index} {name}" for index, name in enumerate(self.expandable, start=1)) or "none"
        raise SurgeryError(f"expected one of the expandable layers ({known}), received {layer!r}, which {problem}")

    def check_copyable(self, layer: str) -> None:
        """Check that the channels of `layer` can be copied.

        Raises:
            SurgeryError: they cannot; the message names the layer that stands in the way.
        """
        own = self.groups[layer]
        for group in own.tolist():
            if group in self.fixed:
                raise SurgeryError(f"cannot widen layer {layer!r}: {self.fixed[group]}")
        if len(np.unique(own)) < len(own):
            raise SurgeryError(
                f"cannot widen layer {layer!r}: a layer behind it combines some of its channels with others, "
                "so that they cannot be copied one by one"
            )

    def draw_copies(self, layer: str, number: int, rng: np.random.Generator) -> np.ndarray:
        """Draw the groups that get a copy, so that `layer` gets `number` more channels.

        Returns:
            The drawn groups, in the order of drawing; a group may be drawn more than once.

        Raises:
            SurgeryError: the channels of `layer` cannot be copied.
        """
        self.check_copyable(layer)
        own = self.groups[layer]
        return own[rng.integers(len(own), size=number)]

    def origins(self, drawn: np.ndarray) -> PerChannel:
        """What the layers' channels become when the `drawn` groups are copied.

        Returns:
            For each channel that a layer will have, the channel it has now that is kept or copied there; for
            those layers alone that get more channels.
        """
        return {
            name: _with_copies(groups, self.blocks[name], drawn)
            for name, groups in self.groups.items()
            if np.isin(groups, drawn).any()
        }


def _with_copies(groups: np.ndarray, blocks: np.ndarray, drawn: np.ndarray) -> np.ndarray:
    copied, drawn_at = np.nonzero(groups[:, None] == drawn[None, :])
    channels = np.concatenate([np.arange(len(groups)), copied])
    order = np.concatenate([np.full(len(groups), -1), drawn_at])
    return channels[np.lexsort((channels, order, blocks[channels]))]


def _groups_and_blocks(graph: ModelGraph, passing: list[str]) -> tuple[PerChannel, PerChannel]:
    """Groups and blocks of all channels, tied by the layers named in `passing`."""
    vertices, size = _vertices(graph)
    ties: list[np.ndarray] = []
    # A vertex also stands for the gap between its channel and the next. Gaps are passed on like channels; one
    # that a layer makes itself (Concatenate, between its inputs) parts two blocks, here and wherever it comes
    # from or goes.
    gap_ties: list[np.ndarray] = []
    parting = np.zeros(size, dtype=bool)
    for name in passing:
        for tie in _ties(graph, name, vertices):
            side_by_side = (np.diff(tie) == 1).all(axis=0)
            ties.append(tie)
            gap_ties.append(tie[:, :-1][:, side_by_side])
            parting[tie[1]] = True
    for tie in gap_ties:
        parting[tie[1]] = False
    group, gap = _components(ties, size), _components(gap_ties, size)
    parting = np.isin(gap, gap[parting])
    groups = {name: group[own] for name, own in vertices.items()}
    blocks: PerChannel = {name: np.cumsum(parting[own]) - parting[own] for name, own in vertices.items()}
    return groups, blocks


def _vertices(graph: ModelGraph) -> tuple[PerChannel, int]:
    vertices: PerChannel = {}
    size = 0
    for name in graph.layers:
        width = graph.shapes[name][-1] or 0
        vertices[name] = np.arange(size, size + width)
        size += width
    return vertices, size


def _ties(graph: ModelGraph, name: str, vertices: PerChannel) -> list[np.ndarray]:
    """Ties of one layer, each an array of two rows: vertices of an input, vertices of the output."""
    layer, sources = graph.layers[name], graph.sources[name]
    ties = RULES[type(layer).__name__].ties(layer, graph.input_shapes(name), graph.shapes[name])
    return [np.stack([vertices[sources[number]][own], vertices[name][made]]) for number, own, made in ties]


def _components(ties: list[np.ndarray], size: int) -> np.ndarray:
    rows, columns = np.concatenate([np.empty((2, 0), dtype=int), *ties], axis=1)
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(size, size))
    return connected_components(graph, directed=False)[1]


def _refusal(graph: ModelGraph, name: str) -> str | None:
    return refusal(graph.layers[name], graph.input_shapes(name), graph.shapes[name])


def _fixed(graph: ModelGraph, groups: PerChannel, refused: dict[str, str]) -> dict[int, str]:
    fixed: dict[int, str] = {}

    def fix(layer: str, obstacle: str, reason: str) -> None:
        message = f"layer {obstacle!r} stands in the way, because {reason}"
        fixed.update(dict.fromkeys(groups[layer].tolist(), message))

    for name, layer in graph.layers.items():
        if name in refused:
            for reached in (*graph.sources[name], name):
                fix(reached, name, refused[name])
        elif reason := activation_refusal(layer):
            fix(name, name, reason)
    return fixed
