"""*wider*: copy channels and share out their outgoing weights (Chen et al., "Net2Net", 2016, section 2.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ggcnn_net2net.errors import SurgeryError
from ggcnn_net2net.net2net.channels import Channels, PerChannel
from ggcnn_net2net.net2net.graph import ModelGraph
from ggcnn_net2net.net2net.operation import Operation
from ggcnn_net2net.net2net.rebuild import Weights, check_optimizer, copy_optimizer_state, rebuild, weights_of
from ggcnn_net2net.net2net.rules import RULES, Rule

if TYPE_CHECKING:
    import keras


def wider(
    model: keras.Model,
    layer: int | str,
    factor: float = 2,
    *,
    filters: int | None = None,
    noise: float = 0.0,
    seed: int = 0,
    carry_optimizer: bool = False,
) -> keras.Model:
    """Give `layer` more filters, copies of those it has, and share out the outgoing weights among them.

    The first filters are the present ones, the others copies of filters drawn uniformly with replacement.
    Every layer that sums over the channels gets its weights divided by the number of copies. Between the two,
    the channels may run through normalization, activation, pooling, upsampling, Concatenate or Flatten; where
    they are added to those of another layer (a skip connection), that layer gets copies of the same channels.

    Copies with equal shares get equal gradients and stay equal for ever, so that nothing is gained. `noise`
    makes the shares unequal: it adds to the outgoing weights of the copies of one channel random numbers that
    sum to zero over the copies, drawn anew for every tap and output channel. So the function stays the same,
    and the gradient pulls each copy another way. (Noise on the incoming weights would change the function;
    one factor per copy would only scale its gradient, to which RMSprop and Adam are blind.)

    Args:
        model: a functional `keras.Model`. It is left as it is.
        layer: the paper's index (from 1, over the hidden Conv2D, Conv2DTranspose and Dense layers in model
            order), or the name of such a layer.
        factor: new number of filters relative to the present one, above 1. The number is rounded, and at
            least one more than now.
        filters: new number of filters, in place of `factor`.
        noise: standard deviation of the random numbers, before their mean over the copies is taken off,
            relative to the standard deviation of the kernel that they are added to. 0, as published, adds
            none.
        seed: seed of the choice of copies and of the noise.
        carry_optimizer: compile the new model like `model`, with the state of its optimizer, in which copied
            filters have copied slots.

    Returns:
        A new `keras.Model` that computes the same function.

    Raises:
        SurgeryError: no such layer, not more filters than now, or channels that reach a layer that is not
            supported, an input or an output of the model.

    Example:
        >>> str(architecture_of(wider(build_ggcnn("narrow"), 1)))
        'C9x9x16_C5x5x4_C3x3x2_T3x3x2_T5x5x4_T9x9x8'
    """
    if carry_optimizer:
        check_optimizer(model)
    if not 0 <= noise < np.inf:
        raise SurgeryError(f"expected noise of 0 or more, received noise={noise}")
    graph = ModelGraph.of(model)
    channels = Channels.of(graph)
    name = channels.layer_name(layer)
    number = _new_width(name, len(channels.groups[name]), factor, filters)
    rng = np.random.default_rng(seed)
    copies = _Copies.drawn(graph, channels, name, number, rng)
    edited = {reached: copies.weights(reached, noise, rng) for reached in copies.reached()}
    copies.edit_config()
    entry = {
        "operation": str(Operation("wider", layer, factor=factor, filters=filters)),
        "layer": name,
        "filters": number,
        "seed": seed,
        "noise": noise,
    }
    child = rebuild(model, graph.config, edited, entry)
    if carry_optimizer:
        copy_optimizer_state(model, child, copies.resize)
    return child


def added_parameters(graph: ModelGraph, channels: Channels, name: str, factor: float, filters: int | None) -> int:
    """Number of parameters that *wider* adds when it widens layer `name`; arguments and errors as there."""
    number = _new_width(name, len(channels.groups[name]), factor, filters)
    copies = _Copies.drawn(graph, channels, name, number, np.random.default_rng(0))
    return sum(
        copies.resize(layer, weight, values).size - values.size
        for layer in copies.reached()
        for weight, values in weights_of(graph.layers[layer]).items()
    )


def _new_width(layer: str, present: int, factor: float, filters: int | None) -> int:
    if filters is None and factor > 1 and present * factor < np.inf:
        return max(round(present * factor), present + 1)
    if filters is not None and filters > present:
        return filters
    received = f"factor={factor}" if filters is None else f"filters={filters}"
    raise SurgeryError(f"cannot widen layer {layer!r}: expected more than its {present} filters, received {received}")


@dataclass(frozen=True)
class _Copies:
    """Copied channels, and what they mean for the layers that make them, pass them on and sum over them."""

    graph: ModelGraph

    origins: PerChannel
    """For each channel that a layer will have, the one it is now; of layers that get more channels."""

    @classmethod
    def drawn(cls, graph: ModelGraph, channels: Channels, name: str, number: int, rng: np.random.Generator) -> _Copies:
        """Drawn at random, so that layer `name` gets `number` channels."""
        more = number - len(channels.groups[name])
        return cls(graph, channels.origins(channels.draw_copies(name, more, rng)))

    def reached(self) -> list[str]:
        """Names of the layers that make or take a copied channel."""
        grown = self.origins.keys()
        return [name for name, sources in self.graph.sources.items() if not grown.isdisjoint([name, *sources])]

    def edit_config(self) -> None:
        """Give the convolutions and Dense layers their new number of channels."""
        for name, origins in self.origins.items():
            width = RULES[type(self.graph.layers[name]).__name__].width
            if width is not None:
                self.graph.layer_config(name)["config"][width] = len(origins)

    def weights(self, layer: str, noise: float, rng: np.random.Generator) -> Weights:
        """New weights of one layer."""
        weights = {}
        for name, values in weights_of(self.graph.layers[layer]).items():
            weights[name] = self.resize(layer, name, values)
            axis, origins = self._summed(layer, name)
            if origins is not None:
                weights[name] = _share_out(weights[name], axis, origins, noise * float(values.std()), rng)
        return weights

    def resize(self, layer: str, weight: str, values: np.ndarray) -> np.ndarray:
        """Copy the entries of the copied channels in an array that has the shape of a weight."""
        owns = self._rule(layer).owns
        if layer in self.origins and weight in owns:
            values = np.take(values, self.origins[layer], axis=owns[weight])
        axis, origins = self._summed(layer, weight)
        return values if origins is None else np.take(values, origins, axis=axis)

    def _summed(self, layer: str, weight: str) -> tuple[int, np.ndarray | None]:
        """The axis over which `layer` sums with `weight`, and the channels' origins there if they change."""
        sums = self._rule(layer).sums
        if weight not in sums:
            return 0, None
        return sums[weight], self.origins.get(self.graph.sources[layer][0])

    def _rule(self, layer: str) -> Rule:
        return RULES.get(type(self.graph.layers[layer]).__name__, Rule())


def _share_out(
    values: np.ndarray, axis: int, origins: np.ndarray, scale: float, rng: np.random.Generator
) -> np.ndarray:
    """Give all copies of a channel equal shares of its weights, plus noise that sums to zero over them."""
    number = np.bincount(origins)[origins]
    shares = np.moveaxis(values, axis, -1) / number
    if scale > 0:
        noise = rng.normal(scale=scale, size=shares.shape)
        total = np.zeros((len(number), *shares.shape[:-1]))
        np.add.at(total, origins, np.moveaxis(noise, -1, 0))
        shares = shares + noise - np.moveaxis(total[origins], 0, -1) / number
    return np.moveaxis(shares, -1, axis)
