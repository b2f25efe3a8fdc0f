import keras
import numpy as np
import pytest
from training_images import SyntheticGrasps

import ggcnn_net2net as gn
from ggcnn_net2net.architecture import HEADS, NAMED
from ggcnn_net2net.training import Recipe, train
from ggcnn_net2net.training.rmsprop import Keras2RMSprop

SIZE = 60


@pytest.fixture(scope="module")
def images():
    return SyntheticGrasps(8, SIZE)


@pytest.mark.parametrize("name", [*NAMED, "C7x7x5s2_C4x4x3s1_T5x5x3s1_T6x6x7s2"])
def test_a_step_is_that_of_keras_fit(name, images):
    model = gn.build_ggcnn(name, input_size=SIZE, seed=3)
    stock = keras.models.clone_model(model)
    stock.set_weights(model.get_weights())
    stock.compile(Keras2RMSprop(1e-3), "mse")
    targets = {head: images.targets[:4, ..., number : number + 1] for number, head in enumerate(HEADS)}
    losses = stock.fit(images.inputs[:4], targets, batch_size=4, epochs=1, verbose=0, shuffle=False)

    class FirstFour(SyntheticGrasps):
        def __len__(self):
            return 4

    result = train(model, FirstFour(8, SIZE), Recipe(epochs=1))
    for ours, theirs, before in zip(result.model.get_weights(), stock.get_weights(), model.get_weights(), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5)
        assert abs(theirs - before).max() > 1e-4
    assert result.history[0]["loss"] == pytest.approx(losses.history["loss"][0], rel=1e-5)
