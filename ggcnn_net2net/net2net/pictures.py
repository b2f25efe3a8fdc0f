"""A picture of surgery: kernels of a GG-CNN before and after. Identities are diagonals, copies are framed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ggcnn_net2net.atomic import replacing
from ggcnn_net2net.errors import SurgeryError
from ggcnn_net2net.net2net.graph import ModelGraph
from ggcnn_net2net.net2net.rebuild import weights_of
from ggcnn_net2net.net2net.rules import RULES

if TYPE_CHECKING:
    import keras

_HEADS = "heads"
_DRAWN = ("Conv2D", "Conv2DTranspose")
_MARK = "#d95f02"
_MOST_NUMBERED = 16  # channels on the longer side of a panel; more numbers would run into each other


@dataclass(frozen=True)
class KernelPanel:
    """One layer of a GG-CNN, or its heads side by side."""

    name: str
    """Of the layer; "heads" for those."""

    title: str

    strength: npt.NDArray[np.floating]
    """(channels in, channels out): largest absolute weight of all taps."""

    inputs: npt.NDArray[np.intp]
    """`outputs` of the layer before."""

    outputs: npt.NDArray[np.intp]
    """For each filter, the first one of the layer that equals it; another than itself means a copy."""

    @property
    def is_identity(self) -> bool:
        """Whether every channel passes as it is, at one tap with the weight 1."""
        return self.strength.shape[0] == self.strength.shape[1] and bool((self.strength == np.eye(len(self))).all())

    def __len__(self) -> int:
        return len(self.inputs)


def kernel_panels(model: keras.Model) -> list[KernelPanel]:
    """The layers of a GG-CNN, as they are drawn.

    Args:
        model: a chain of Conv2D and Conv2DTranspose layers that ends in heads, as `architecture_of` reads it.

    Returns:
        One panel a hidden layer, in model order, and one for the heads. Two filters of a layer are equal if their
        weights and biases are.

    Raises:
        SurgeryError: a network that is no such chain.
    """
    graph = ModelGraph.of(model)
    panels: list[KernelPanel] = []
    heads: list[KernelPanel] = []
    for name, layer in graph.layers.items():
        rule = RULES.get(type(layer).__name__)
        if rule is None or rule.width is None:
            continue
        if type(layer).__name__ not in _DRAWN:
            raise SurgeryError(
                f"expected a chain of {' and '.join(_DRAWN)} layers to draw, received {name!r} of class "
                f"{type(layer).__name__}: leave the picture out"
            )
        weights = weights_of(layer)
        kernel = np.moveaxis(weights["kernel"], (rule.sums["kernel"], rule.owns["kernel"]), (-2, -1))
        filters = kernel.reshape(-1, kernel.shape[-1])
        outputs = _firsts(np.vstack([filters, weights["bias"]]) if "bias" in weights else filters)
        inputs = panels[-1].outputs if panels else np.arange(kernel.shape[-2])
        strength = abs(kernel).reshape(-1, *kernel.shape[-2:]).max(axis=0)
        panel = KernelPanel(name, _title(layer, kernel.shape[-2]), strength, inputs, outputs)
        (heads if name in graph.outputs else panels).append(panel)
    if len({head.strength.shape[0] for head in heads}) > 1:
        raise SurgeryError("expected heads that read one layer, received heads of several: leave the picture out")
    together = np.concatenate([head.strength for head in heads], axis=1)
    title = f"{len(heads)} {_HEADS}\n{together.shape[0]} → 1 each"
    return [*panels, KernelPanel(_HEADS, title, together, heads[0].inputs, np.arange(together.shape[1]))]


def draw_surgery(path: Path, before: keras.Model, after: keras.Model, operations: str) -> None:
    """Draw the kernels of a GG-CNN and those of the network that surgery made of it, each layer above itself.

    Args:
        path: picture to write; its suffix is the format.
        before: see `kernel_panels`.
        after: what `apply_operations` made of it, whose layers have kept their names.
        operations: as they are to stand in the title.
    """
    from matplotlib.figure import Figure  # importing the package must not import matplotlib

    rows = [{panel.name: panel for panel in kernel_panels(model)} for model in (before, after)]
    figure = Figure(figsize=(1.55 * len(rows[1]), 5.4), layout="constrained")
    grid = figure.subplots(2, len(rows[1]), squeeze=False)
    for column, name in enumerate(rows[1]):
        largest = max(float(row[name].strength.max()) for row in rows if name in row)
        for row, axes in zip(rows, grid[:, column], strict=True):
            if name in row:
                _draw(axes, row[name], largest, is_new=name not in rows[0])
            else:
                axes.set_axis_off()
    for axes, model, label in zip(grid[:, 0], (before, after), ("before", "after"), strict=True):
        axes.set_ylabel(f"{label}: {model.count_params():,} parameters\n\nfrom channel", fontsize=8)
    figure.suptitle(
        f"{operations}\nA column is a filter, a row the channel that it reads: white 0, black the largest weight. "
        "Framed: copies, numbered as what they copy.",
        fontsize=10,
    )
    with replacing(path) as temporary:
        figure.savefig(temporary, dpi=110)


def _firsts(columns: npt.NDArray[np.floating]) -> npt.NDArray[np.intp]:
    """For each column the index of the first one that equals it."""
    _, first, group = np.unique(columns, axis=1, return_index=True, return_inverse=True)
    return first[group.ravel()]


def _title(layer: Any, channels_in: int) -> str:
    kind = "T" if type(layer).__name__ == "Conv2DTranspose" else "C"
    size = "x".join(map(str, layer.kernel_size))
    return f"{kind}{size}, stride {layer.strides[0]}\n{channels_in} → {layer.filters}"


def _draw(axes: Any, panel: KernelPanel, largest: float, is_new: bool) -> None:
    axes.imshow(panel.strength, cmap="Greys", vmin=0, vmax=largest or 1, interpolation="nearest")
    what = "\nNEW: identity" if is_new and panel.is_identity else "\n"
    axes.set_title(panel.title + what, fontsize=8, weight="bold" if is_new else "normal")
    for spine in axes.spines.values():
        spine.set_linewidth(2.5 if is_new else 0.8)
    _frame_copies(panel.inputs, axes.axhspan)
    _frame_copies(panel.outputs, axes.axvspan)
    longer = max(panel.strength.shape)
    numbers = {axes.set_yticks: panel.inputs, axes.set_xticks: panel.outputs if panel.name != _HEADS else ()}
    for set_ticks, origins in numbers.items():
        labelled = origins if longer <= _MOST_NUMBERED else ()
        set_ticks(range(len(labelled)), labels=map(str, labelled), fontsize=min(6.5, 75 / longer))


def _frame_copies(origins: npt.NDArray[np.intp], span: Any) -> None:
    for channel in np.flatnonzero(origins != np.arange(len(origins))):
        span(channel - 0.5, channel + 0.5, fill=False, edgecolor=_MARK, linewidth=1.3)
