"""Who a candidate is: stored folders are found again only as long as its key stays what it is."""

from dataclasses import replace

import pytest

from ggcnn_net2net.protocol import CORRECTED, PAPER
from ggcnn_net2net.search import SearchSettings
from ggcnn_net2net.search.candidates import child_of, root_candidate, seed_of
from ggcnn_net2net.training import Recipe

SETTINGS = SearchSettings(recipe=Recipe(epochs=2, images_per_epoch=100, protocol=PAPER), seed=3)
ROOT = root_candidate("network", "data")


def test_keys_and_seeds_stay_what_they_are():
    child = child_of(ROOT, "deeper(3)", SETTINGS, "data")
    assert ROOT.key == "b26ccae615125e89"
    assert child.key == "3510737ef430b507"
    assert (seed_of(child, 0, 3), seed_of(child, 1, 3)) == (483960458, 140718053)


@pytest.mark.parametrize(
    "other",
    [
        {"operation": "deeper(4)"},
        {"data": "others"},
        {"settings": replace(SETTINGS, seed=4)},
        {"settings": replace(SETTINGS, carry_optimizer=True)},
        {"settings": replace(SETTINGS, recipe=replace(SETTINGS.recipe, learning_rate=1e-4))},
        {"settings": replace(SETTINGS, recipe=replace(SETTINGS.recipe, protocol=CORRECTED))},
        {"parent": root_candidate("another network", "data")},
    ],
    ids=lambda other: next(iter(other)),
)
def test_what_is_trained_otherwise_is_another_candidate(other):
    same = {"parent": ROOT, "operation": "deeper(3)", "settings": SETTINGS, "data": "data"}
    assert child_of(**{**same, **other}).key != child_of(**same).key


@pytest.mark.parametrize(
    "other",
    [{"width": 5}, {"depth": 2}, {"lookahead": False}, {"max_parameters": 9}, {"retrain": 8}, {"threads": 2}],
    ids=lambda other: next(iter(other)),
)
def test_what_decides_the_way_alone_leaves_the_candidate(other):
    assert child_of(ROOT, "wider(1)", replace(SETTINGS, **other), "data") == child_of(
        ROOT, "wider(1)", SETTINGS, "data"
    )


def test_the_recipes_own_seed_does_not_matter():
    reseeded = replace(SETTINGS, recipe=replace(SETTINGS.recipe, seed=9))
    assert child_of(ROOT, "wider(1)", reseeded, "data") == child_of(ROOT, "wider(1)", SETTINGS, "data")
