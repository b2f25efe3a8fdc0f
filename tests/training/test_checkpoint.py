"""The optimizer's state: in a checkpoint, carried over surgery, and given back to a network from a file."""

import keras
import numpy as np
import pytest
from training_images import SyntheticGrasps, sha256_of_weights

import ggcnn_net2net as gn
from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.errors import TrainingError
from ggcnn_net2net.training import Recipe, train
from ggcnn_net2net.training.checkpoint import load_optimizer

OPTIMIZERS = [
    "rmsprop-keras2",
    "adam",
    pytest.param(keras.optimizers.RMSprop(1e-3, momentum=0.9), id="an optimizer of Keras"),
]
GROWTH = "wider(2), deeper(3)"


def state_of(model):
    """Step count and slots."""
    return {one.name: one.numpy() for one in model.optimizer.variables if one.name != "learning_rate"}


def assert_same(state, other):
    assert state.keys() == other.keys()
    for name, value in state.items():
        np.testing.assert_array_equal(value, other[name], err_msg=name)


class Stop(Exception):
    """Ends a training in the middle."""


class States(keras.callbacks.Callback):
    """The optimizer's state at the begin of training and after each step."""

    def __init__(self):
        super().__init__()
        self.seen = []

    def on_train_begin(self, logs=None):
        self.seen.append(state_of(self.model))

    def on_train_batch_end(self, batch, logs=None):
        self.seen.append(state_of(self.model))


@pytest.mark.parametrize("optimizer", OPTIMIZERS, ids=str)
def test_two_runs_with_the_state_carried_over_are_one(small, optimizer):
    """With one batch there is no order of batches in which the second run could differ."""
    data = SyntheticGrasps(4, 36)
    once = train(small, data, Recipe(epochs=6, optimizer=optimizer)).model
    half = train(small, data, Recipe(epochs=3, optimizer=optimizer)).model
    before = state_of(half)
    carried = train(half, data, Recipe(epochs=3, optimizer=optimizer), carry_optimizer=True).model
    fresh = train(half, data, Recipe(epochs=3, optimizer=optimizer)).model
    assert sha256_of_weights(carried) == sha256_of_weights(once) != sha256_of_weights(fresh)
    assert_same(state_of(half), before)


def test_a_child_starts_with_the_state_that_surgery_gave_it(small, grasps):
    parent = train(small, grasps, Recipe(epochs=1)).model
    child = gn.apply_operations(parent, GROWTH, carry_optimizer=True)
    states = States()
    train(child, grasps, Recipe(epochs=1, learning_rate=0.01), callbacks=[states], carry_optimizer=True)
    start, first_step, *_ = states.seen
    assert_same(start, state_of(child))
    assert start["iteration"] == 3
    for name, value in state_of(parent).items():
        if start[name].shape == value.shape:
            np.testing.assert_array_equal(start[name], value)
    assert start["conv2d_2_kernel_velocity"].shape[-1] == 8  # widened from 4, by copies
    assert start["conv2d_2_kernel_velocity"].all()
    assert not start["conv2d_3_deeper_kernel_velocity"].any()
    # a = 0.9 a + 0.1 g²: what is left of the carried state after one step is known.
    slots = [name for name in start if name.endswith("velocity") and start[name].any()]
    assert len(slots) == len(start) - 3  # the step count, and the slots of the new layer
    for name in slots:
        assert (first_step[name] >= np.float32(0.9) * start[name] * (1 - 1e-6)).all()


@pytest.mark.parametrize("schedule", [None, "cosine"])
def test_rate_and_schedule_stay_those_of_the_recipe(small, grasps, schedule):
    parent = train(small, grasps, Recipe(epochs=2)).model
    recipe = Recipe(epochs=2, learning_rate=0.01, learning_rate_schedule=schedule)
    states = States()
    result = train(parent, grasps, recipe, carry_optimizer=True, callbacks=[states])
    rates = [entry["learning_rate"] for entry in result.history]
    np.testing.assert_allclose(rates, [0.01, 0.005 if schedule else 0.01], rtol=1e-5)
    slots = {name: value for name, value in state_of(parent).items() if name != "iteration"}
    assert states.seen[0].pop("iteration") == (0 if schedule else 6)
    assert_same(states.seen[0], slots)


@pytest.mark.parametrize("optimizer", OPTIMIZERS[:2])
def test_an_interrupted_run_with_a_carried_state_goes_on_bit_by_bit(small, grasps, tmp_path, optimizer):
    recipe = Recipe(epochs=2, optimizer=optimizer)
    child = gn.apply_operations(train(small, grasps, recipe).model, GROWTH, noise=0.3, carry_optimizer=True)

    def interrupt(epoch, step, steps, loss):
        if (epoch, step) == (1, 2):
            raise Stop

    with pytest.raises(Stop):
        train(child, grasps, recipe, checkpoint_dir=tmp_path, on_progress=interrupt, carry_optimizer=True)
    resumed = train(child, grasps, recipe, checkpoint_dir=tmp_path, carry_optimizer=True).model
    undisturbed = train(child, grasps, recipe, carry_optimizer=True).model
    assert sha256_of_weights(resumed) == sha256_of_weights(undisturbed)
    assert_same(state_of(resumed), state_of(undisturbed))
    assert sha256_of_weights(resumed) != sha256_of_weights(train(child, grasps, recipe).model)


def test_a_checkpoint_of_another_starting_state_is_refused(small, grasps, tmp_path):
    recipe = Recipe(epochs=1)
    parent = train(small, grasps, recipe).model
    train(parent, grasps, recipe, checkpoint_dir=tmp_path / "carried", carry_optimizer=True)
    train(parent, grasps, recipe, checkpoint_dir=tmp_path / "fresh")
    with pytest.raises(TrainingError, match="another optimizer state"):
        train(parent, grasps, recipe, checkpoint_dir=tmp_path / "carried")
    with pytest.raises(TrainingError, match="another optimizer state"):
        train(parent, grasps, recipe, checkpoint_dir=tmp_path / "fresh", carry_optimizer=True)
    slot = parent.optimizer.variables[2]
    slot.assign(slot + 1)
    with pytest.raises(TrainingError, match="another optimizer state"):
        train(parent, grasps, recipe, checkpoint_dir=tmp_path / "carried", carry_optimizer=True)


def test_a_state_that_cannot_be_carried_is_named(small, grasps):
    def carry(model, **settings):
        train(model, grasps, Recipe(epochs=1, **settings), carry_optimizer=True)

    compiled = keras.models.clone_model(small)
    with pytest.raises(TrainingError, match="not compiled"):
        carry(compiled)
    compiled.compile("adam")
    with pytest.raises(TrainingError, match="before its first step"):
        carry(compiled)
    compiled.optimizer.build(compiled.trainable_variables)
    with pytest.raises(TrainingError, match="with Keras2RMSprop, received one with Adam"):
        carry(compiled)
    with pytest.raises(TrainingError, match=r"nothing more, received one with conv2d_1_kernel_velocity_hat"):
        compiled.compile(keras.optimizers.Adam(amsgrad=True))
        compiled.optimizer.build(compiled.trainable_variables)
        carry(compiled, optimizer="adam")
    other = gn.wider(small, 1)
    compiled.compile("adam")
    compiled.optimizer.build(other.trainable_variables)
    with pytest.raises(TrainingError, match=r"of shape \(9, 9, 1, 8\), received .* \(9, 9, 1, 16\)"):
        carry(compiled, optimizer="adam")


@pytest.mark.parametrize("schedule", [None, "cosine"])
@pytest.mark.parametrize("optimizer", ["rmsprop-keras2", "adam"])
def test_growing_a_network_from_its_files_is_growing_it_from_memory(small, grasps, tmp_path, optimizer, schedule):
    recipe = Recipe(epochs=2, optimizer=optimizer, learning_rate_schedule=schedule)
    trained = train(small, grasps, recipe, checkpoint_dir=tmp_path / "training").model
    gn.save_ggcnn(trained, tmp_path / "model.hdf5")

    model = gn.load_ggcnn(tmp_path / "model.hdf5")
    model.compile(recipe.new_optimizer(3))
    load_optimizer(tmp_path / "training", model)
    assert_same(state_of(model), state_of(trained))
    assert sha256_of_weights(model) == sha256_of_weights(trained)

    for operations in ("wider(1)", GROWTH):
        from_file = gn.apply_operations(model, operations, noise=0.3, carry_optimizer=True)
        from_memory = gn.apply_operations(trained, operations, noise=0.3, carry_optimizer=True)
        child = train(from_file, grasps, recipe, carry_optimizer=True).model
        expected = train(from_memory, grasps, recipe, carry_optimizer=True).model
        assert sha256_of_weights(child) == sha256_of_weights(expected)
        assert_same(state_of(child), state_of(expected))


def test_the_state_of_a_network_with_random_layers(grasps, tmp_path):
    """A dropout layer's state is in the checkpoint, but not among the weights of a file."""
    inputs = features = keras.Input((36, 36, 1))
    features = keras.layers.Dropout(0.5)(keras.layers.Conv2D(4, 3, padding="same")(features))
    model = keras.Model(inputs, [keras.layers.Conv2D(1, 2, padding="same", name=head)(features) for head in HEADS])
    trained = train(model, grasps, Recipe(epochs=1), checkpoint_dir=tmp_path).model
    # Keras has drawn another state for the copy, which a run must not depend on.
    again = keras.models.clone_model(model)
    again.set_weights(model.get_weights())
    assert sha256_of_weights(train(again, grasps, Recipe(epochs=1)).model) == sha256_of_weights(trained)
    other_seed = train(model, grasps, Recipe(epochs=1, seed=1)).model
    assert sha256_of_weights(other_seed) != sha256_of_weights(trained)
    restored = keras.models.clone_model(model)
    restored.set_weights(trained.get_weights())
    restored.compile(Recipe().new_optimizer(1))
    load_optimizer(tmp_path, restored)
    assert_same(state_of(restored), state_of(trained))


def test_an_optimizer_state_of_another_network_is_not_loaded(small, grasps, tmp_path):
    trained = train(small, grasps, Recipe(epochs=1), checkpoint_dir=tmp_path).model
    with pytest.raises(TrainingError, match=r"found no .*elsewhere.checkpoint\.npz"):
        load_optimizer(tmp_path / "elsewhere", trained)
    for other in (small, gn.deeper(trained, 1), gn.wider(trained, 1)):
        model = keras.models.clone_model(other)
        model.set_weights(other.get_weights())
        with pytest.raises(TrainingError, match="not compiled"):
            load_optimizer(tmp_path, model)
        model.compile(Recipe().new_optimizer(1))
        with pytest.raises(TrainingError, match="received one of other weights"):
            load_optimizer(tmp_path, model)
    # Keras 3's RMSprop names its slots alike, but is another optimizer.
    trained.compile("rmsprop")
    with pytest.raises(TrainingError, match="with RMSprop, received one with Keras2RMSprop"):
        load_optimizer(tmp_path, trained)
    (tmp_path / "checkpoint.npz").write_bytes(b"PK")
    with pytest.raises(TrainingError, match=r"cannot read .*checkpoint\.npz"):
        load_optimizer(tmp_path, trained)
