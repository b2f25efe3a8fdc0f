import json
from dataclasses import replace

import keras
import pytest

from ggcnn_net2net.errors import TrainingError
from ggcnn_net2net.protocol import CORRECTED, PAPER
from ggcnn_net2net.training import Recipe
from ggcnn_net2net.training.rmsprop import Keras2RMSprop


@pytest.mark.parametrize(
    "wrong",
    [
        {"epochs": 0},
        {"epochs": 1.5},
        {"batch_size": -1},
        {"images_per_epoch": 0},
        {"learning_rate": 0.0},
        {"learning_rate": float("nan")},
        {"learning_rate": float("inf")},
        {"seed": -1},
        {"learning_rate_schedule": "linear"},
        {"learning_rate_schedule": "cosine", "optimizer": keras.optimizers.Adam()},
    ],
)
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(TrainingError, match="expected"):
        Recipe(**wrong)


def test_default_optimizer_is_that_of_the_paper():
    optimizer = Recipe().new_optimizer(10)
    assert isinstance(optimizer, Keras2RMSprop)
    assert float(optimizer.learning_rate) == pytest.approx(1e-3)


def test_optimizers_by_name():
    adam = Recipe(optimizer="adam", learning_rate=0.02).new_optimizer(10)
    assert isinstance(adam, keras.optimizers.Adam)
    assert float(adam.learning_rate) == pytest.approx(0.02)
    with pytest.raises(TrainingError, match="'nonsense'"):
        Recipe(optimizer="nonsense").new_optimizer(10)


def test_fingerprint_is_of_what_determines_the_steps():
    recipe = Recipe()
    same = [
        Recipe(),
        replace(recipe, epochs=99),
        replace(recipe, protocol=replace(PAPER, sim_angle_window=0, last_lookahead_takes_last=False)),
    ]
    others = [
        replace(recipe, batch_size=8),
        replace(recipe, optimizer="adam"),
        replace(recipe, optimizer=keras.optimizers.Adam()),
        replace(recipe, optimizer=keras.optimizers.Adam(0.1)),
        replace(recipe, learning_rate=0.1),
        replace(recipe, learning_rate_schedule="cosine"),
        replace(recipe, learning_rate_schedule="cosine", epochs=99),
        replace(recipe, images_per_epoch=100),
        replace(recipe, seed=1),
        replace(recipe, protocol=CORRECTED),
    ]
    assert {other.fingerprint for other in same} == {recipe.fingerprint}
    assert len({other.fingerprint for other in [recipe, *others]}) == len(others) + 1


@pytest.mark.parametrize("optimizer", ["adam", keras.optimizers.Adam(0.02, beta_1=0.8)])
def test_a_recipe_survives_a_file(optimizer):
    recipe = Recipe(optimizer=optimizer, epochs=3, protocol=CORRECTED)
    again = Recipe.from_dict(json.loads(json.dumps(recipe.as_dict())))
    assert again.as_dict() == recipe.as_dict()
    made, expected = (one.new_optimizer(1).get_config() for one in (again, recipe))
    assert {**made, "name": ""} == {**expected, "name": ""}  # Keras numbers those of one kind
