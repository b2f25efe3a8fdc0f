import json
from dataclasses import replace

import pytest

from ggcnn_net2net.cli.figures import fig2
from ggcnn_net2net.cli.search import run
from ggcnn_net2net.errors import SearchError
from ggcnn_net2net.protocol import CORRECTED
from ggcnn_net2net.search import BUDGETS, SearchSettings
from ggcnn_net2net.training import Recipe

UNUSUAL = SearchSettings(
    width=4,
    patience=2,
    recipe=Recipe(epochs=7, images_per_epoch=60, learning_rate=3e-4, protocol=CORRECTED),
    heuristic="loss",
    max_parameters=16_104,
    halving=True,
    replicates=3,
)


def test_the_defaults_are_the_papers():
    settings = SearchSettings()
    assert (settings.beam.width, settings.beam.depth, settings.beam.lookahead) == (3, 5, True)
    assert settings.beam.last_entry  # as the public code does
    assert settings.beam.maximise
    assert (settings.recipe.epochs, settings.retrain, settings.heuristic) == (2, 0, "iou")
    assert not (settings.halving or settings.carry_optimizer or settings.distil or settings.replicates > 1)
    assert settings.protocol.wider_noise == 0


@pytest.mark.parametrize("settings", [SearchSettings(), SearchSettings(lookahead=False), UNUSUAL])
def test_settings_survive_the_journal(settings):
    assert SearchSettings.from_dict(json.loads(json.dumps(settings.as_dict()))) == settings


def test_the_algorithm_gets_what_follows_from_the_others():
    assert not UNUSUAL.beam.maximise
    assert not UNUSUAL.beam.last_entry
    assert UNUSUAL.beam.patience == 2


@pytest.mark.parametrize(("epochs", "rungs"), [(2, (1, 2)), (3, (1, 2, 3)), (8, (2, 4, 8)), (10, (3, 5, 10))])
def test_rungs_of_successive_halving(epochs, rungs):
    recipe = Recipe(epochs=epochs)
    assert SearchSettings(recipe=recipe, halving=True).rungs == rungs
    assert SearchSettings(recipe=recipe).rungs == (epochs,)


def test_budgets_grow_up_to_all_images():
    *limited, paper = BUDGETS.values()
    assert [budget.images_per_epoch for budget in limited] == sorted({budget.images_per_epoch for budget in limited})
    assert [budget.score_images for budget in limited] == sorted({budget.score_images for budget in limited})
    assert paper.images_per_epoch is paper.score_images is None


def test_commands_offer_all_budgets():
    for command in (run, fig2):  # whose --help must not load the search
        (offered,) = (option.type.choices for option in command.params if option.name == "budget")
        assert list(offered) == list(BUDGETS)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"width": 0}, "1 or more"),
        ({"heuristic": "beauty"}, "iou, loss, sim.*'beauty'"),
        ({"threads": 0}, "threads of 1 or more, received 0"),
        ({"max_parameters": -5}, "max_parameters"),
        ({"replicates": 0}, "replicates"),
        ({"retrain": -1}, "retrain"),
        ({"halving": True, "recipe": Recipe(epochs=4, learning_rate_schedule="cosine")}, "halving.*'cosine'"),
        ({"distil": "parent", "recipe": Recipe(protocol=CORRECTED)}, "masked_loss.*CORRECTED"),
        ({"distil": "parent", "distil_weight": 0.0}, "distil_weight"),
        ({"lookahead": False, "retrain": 8}, "expected lookahead for retrain and patience.*retrain=8"),
        ({"lookahead": False, "patience": 1}, "patience=1"),
    ],
)
def test_wrong_settings(wrong, message):
    with pytest.raises(SearchError, match=message):
        SearchSettings(**wrong)


def test_a_teacher_needs_the_published_loss():
    protocol = replace(CORRECTED, masked_loss=False)
    assert SearchSettings(distil="parent", recipe=Recipe(protocol=protocol)).distil_weight == 0.5


def test_settings_of_another_version():
    stored = SearchSettings().as_dict()
    with pytest.raises(SearchError, match=r"this version.*colour"):
        SearchSettings.from_dict({**stored, "colour": "red"})
    del stored["recipe"]
    with pytest.raises(SearchError, match=r"this version.*recipe"):
        SearchSettings.from_dict(stored)
