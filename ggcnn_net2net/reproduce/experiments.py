"""The searches behind Fig. 2 and Fig. 3 of the paper, and behind its other numbers of epochs, as one table."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ggcnn_net2net.errors import ResultsError
from ggcnn_net2net.protocol import CORRECTED, PAPER, Protocol

if TYPE_CHECKING:
    from ggcnn_net2net.search import SearchSettings

LEARNING_RATE = 1e-3
"""The paper's, in all of its searches."""


@dataclass(frozen=True)
class Curve:
    """A search, whose path is a curve. The defaults are those of all of the paper's searches (section III)."""

    name: str
    """As in the paper's legend; the same name in two experiments is the same search."""
    network: str = "published"
    """What the search starts from: "published", "zoo:NAME" or a model file."""
    paper_network: str = ""
    """What it starts from in PAPER instead, whose loss counts all pixels; "": the same."""
    epochs: int = 2
    retrain: int = 0
    transpose: bool = False
    lookahead: bool = True
    width: int = 3
    depth: int = 5

    @property
    def slug(self) -> str:
        """The name as part of a file name."""
        return re.sub(r"\W+", "-", self.name.replace("=", ""))

    @property
    def start(self) -> str:
        """What the search starts from, for people."""
        return Path(self.network).name

    def of_protocol(self, protocol: Protocol) -> Curve:
        """The curve with the network that it starts from in this protocol.

        A network that learnt with the masked loss has to learn what to say of pixels without labels before it gains
        anything in PAPER, and a small one forgets the grasps while it does.

        Args:
            protocol: of the search.

        Returns:
            This curve, or with another `network`.
        """
        starts_apart = self.paper_network and not protocol.masked_loss
        return replace(self, network=self.paper_network, paper_network="") if starts_apart else self

    def settings(
        self,
        budget: str,
        protocol: Protocol,
        seed: int,
        threads: int,
        max_parameters: int | None = None,
        learning_rate: float = LEARNING_RATE,
    ) -> SearchSettings:
        """The search's settings, with a budget of `search.BUDGETS`; limit and learning rate are the paper's."""
        from ggcnn_net2net.search import BUDGETS, SearchSettings
        from ggcnn_net2net.training import Recipe

        images = BUDGETS[budget]
        return SearchSettings(
            width=self.width,
            depth=self.depth,
            lookahead=self.lookahead,
            transpose=self.transpose,
            recipe=Recipe(
                epochs=self.epochs,
                images_per_epoch=images.images_per_epoch,
                learning_rate=learning_rate,
                protocol=protocol,
            ),
            max_parameters=max_parameters,
            retrain=self.retrain,
            score_images=images.score_images,
            seed=seed,
            threads=threads,
        )


@dataclass(frozen=True)
class Experiment:
    """Curves that stand in one picture."""

    name: str
    title: str
    curves: tuple[Curve, ...]
    protocols: tuple[Protocol, ...] = (PAPER,)
    """A row of panels each."""

    @property
    def depth(self) -> int:
        """Of the longest curve."""
        return max(curve.depth for curve in self.curves)


EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (
        Experiment(
            "fig2",
            "Extending GG-CNN (Fig. 2)",
            (
                Curve("e=2"),
                Curve("e=2 r=8", retrain=8),
                Curve("e=2 transpose", transpose=True),
                Curve("e=2 no lookahead", lookahead=False),
            ),
            (PAPER, CORRECTED),
        ),
        Experiment(
            "fig3",
            "Growing small GG-CNNs (Fig. 3)",
            (
                Curve("narrow", network="zoo:narrow", paper_network="zoo:narrow_paper", transpose=True),
                Curve("shallow", network="zoo:shallow", paper_network="zoo:shallow_paper", transpose=True),
            ),
        ),
        Experiment(
            "epochs",
            "Epochs after each operation (section III-A)",
            (Curve("e=2"), Curve("e=5", epochs=5), Curve("e=10", epochs=10)),
        ),
    )
}


def part_of(
    experiment: Experiment,
    *,
    curves: Collection[str] = (),
    protocols: Sequence[Protocol] = (),
    networks: Mapping[str, str] | None = None,
) -> Experiment:
    """An experiment with fewer curves, or other protocols or networks.

    Args:
        experiment: the whole.
        curves: names of the curves to keep; none: all.
        protocols: instead of its own; none: its own.
        networks: what a curve starts from instead, by the curve's name, in every protocol.

    Returns:
        The smaller experiment, under the same name.

    Raises:
        ResultsError: a curve that it does not have.
    """
    networks = networks or {}
    names = [curve.name for curve in experiment.curves]
    unknown = [name for name in (*curves, *networks) if name not in names]
    if unknown:
        raise ResultsError(f"expected curves of {experiment.name}: {', '.join(names)}; received {', '.join(unknown)}")
    kept = tuple(
        replace(curve, network=networks[curve.name], paper_network="") if curve.name in networks else curve
        for curve in experiment.curves
        if not curves or curve.name in curves
    )
    return replace(experiment, curves=kept, protocols=tuple(protocols) or experiment.protocols)
