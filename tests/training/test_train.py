import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import keras
import numpy as np
import pytest
import training_images
from training_images import SyntheticGrasps, sha256_of_weights

import ggcnn_net2net as gn
from ggcnn_net2net.architecture import HEADS
from ggcnn_net2net.errors import TrainingError
from ggcnn_net2net.protocol import CORRECTED
from ggcnn_net2net.training import Recipe, mean_loss, set_threads, train

RECIPE = Recipe(epochs=3)


def start(size, epochs, threads, checkpoint_dir="", seconds=0.0):
    command = [sys.executable, training_images.__file__, size, epochs, threads, checkpoint_dir, seconds]
    return subprocess.Popen([str(part) for part in command], stdout=subprocess.PIPE, text=True)


def last_line(process):
    output, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    return output.splitlines()[-1]


def test_the_loss_falls_and_the_model_given_stays(small, grasps):
    before = sha256_of_weights(small)
    result = train(small, grasps, Recipe(epochs=12), validation=grasps)
    assert sha256_of_weights(small) == before
    assert result.model is not small
    assert [layer.name for layer in result.model.layers] == [layer.name for layer in small.layers]
    assert result.history[-1]["loss"] < 0.9 * result.history[0]["loss"]
    assert result.history[-1]["val_loss"] < 0.9 * result.history[0]["val_loss"]


def test_history_has_every_loss(small, grasps):
    history = train(small, grasps, RECIPE, validation=grasps).history
    assert json.loads(json.dumps(history)) == history
    assert [entry["epoch"] for entry in history] == [0, 1, 2]
    for entry in history:
        assert entry["loss"] == pytest.approx(sum(entry[f"{head}_loss"] for head in HEADS))
        assert entry["val_loss"] == pytest.approx(sum(entry[f"val_{head}_loss"] for head in HEADS))
        assert entry["learning_rate"] == pytest.approx(1e-3)
        assert entry["seconds"] > 0


def test_validation_loss_is_that_of_all_images(small, grasps):
    uneven = SyntheticGrasps(7, 36, seed=5)  # the last batch has three images
    result = train(small, grasps, Recipe(epochs=1), validation=uneven)
    maps = np.concatenate([np.asarray(head) for head in result.model(uneven.inputs, training=False)], axis=-1)
    expected = ((maps - uneven.targets) ** 2).mean(axis=(0, 1, 2)).sum()
    assert result.history[0]["val_loss"] == pytest.approx(expected, rel=1e-5)
    assert mean_loss(result.model, uneven, Recipe()) == result.history[0]["val_loss"]


def test_lineage_is_carried_over(small, grasps):
    grown = gn.deeper(small, 3)
    assert gn.history_of(train(grown, grasps, RECIPE).model) == gn.history_of(grown) != []


def test_same_inputs_give_the_same_bits_and_others_do_not(small, grasps):
    def trained(**changes):
        return sha256_of_weights(train(small, grasps, replace(RECIPE, **changes)).model)

    assert trained() == trained()
    others = [trained(seed=1), trained(protocol=CORRECTED), trained(images_per_epoch=8), trained(batch_size=3)]
    assert len({trained(), *others}) == 5


@pytest.mark.slow
def test_processes_give_the_same_bits():
    runs = [start(300, 2, 2) for _ in range(2)]  # six steps, at the size and with the threads of real use
    assert len({last_line(run) for run in runs}) == 1


def test_epochs_in_two_goes_are_those_in_one(small, grasps, tmp_path):
    once = train(small, grasps, Recipe(epochs=4), checkpoint_dir=tmp_path / "once")
    train(small, grasps, Recipe(epochs=2), checkpoint_dir=tmp_path / "twice")
    twice = train(small, grasps, Recipe(epochs=4), checkpoint_dir=tmp_path / "twice")
    assert sha256_of_weights(twice.model) == sha256_of_weights(once.model)
    assert [entry["loss"] for entry in twice.history] == [entry["loss"] for entry in once.history]
    again = train(small, grasps, Recipe(epochs=4), checkpoint_dir=tmp_path / "twice", on_progress=pytest.fail)
    assert sha256_of_weights(again.model) == sha256_of_weights(once.model)


class Stop(Exception):
    pass


@pytest.mark.parametrize("optimizer", ["adam", "rmsprop-keras2"])
def test_an_interrupted_run_goes_on_bit_by_bit(small, grasps, tmp_path, optimizer):
    recipe = replace(RECIPE, optimizer=optimizer, learning_rate_schedule="cosine", protocol=CORRECTED)

    def interrupt(epoch, step, steps, loss):
        if (epoch, step) == (1, 2):
            raise Stop

    with pytest.raises(Stop):
        train(small, grasps, recipe, checkpoint_dir=tmp_path, on_progress=interrupt)
    seen = []
    resumed = train(small, grasps, recipe, checkpoint_dir=tmp_path, on_progress=lambda *state: seen.append(state[:2]))
    assert seen[0] == (1, 1)
    assert sha256_of_weights(resumed.model) == sha256_of_weights(train(small, grasps, recipe).model)


@pytest.mark.slow
def test_a_killed_run_goes_on_bit_by_bit(tmp_path):
    undisturbed = start(36, 4, 1)
    killed = start(36, 4, 1, tmp_path / "checkpoints", 0.2)
    for line in killed.stdout:
        if line.startswith("2 1 "):  # a step of the third epoch is done
            os.kill(killed.pid, signal.SIGKILL)
            break
    killed.communicate()
    assert killed.returncode == -signal.SIGKILL
    assert [path.name for path in (tmp_path / "checkpoints").iterdir()] == ["checkpoint.npz"]
    resumed = start(36, 4, 1, tmp_path / "checkpoints")
    output, _ = resumed.communicate(timeout=120)
    assert output.startswith("2 1 ")
    assert output.splitlines()[-1] == last_line(undisturbed)


def test_a_checkpoint_of_another_run_is_refused(small, grasps, tmp_path):
    train(small, grasps, RECIPE, checkpoint_dir=tmp_path)
    with pytest.raises(TrainingError, match="another recipe"):
        train(small, grasps, replace(RECIPE, seed=1), checkpoint_dir=tmp_path)
    with pytest.raises(TrainingError, match="another data"):
        train(small, SyntheticGrasps(12, 36, seed=1), RECIPE, checkpoint_dir=tmp_path)
    with pytest.raises(TrainingError, match="another network"):
        train(gn.build_ggcnn("narrow", input_size=36, seed=2), grasps, RECIPE, checkpoint_dir=tmp_path)
    with pytest.raises(TrainingError, match="at most 2 epochs"):
        train(small, grasps, Recipe(epochs=2), checkpoint_dir=tmp_path)
    fresh = train(small, grasps, replace(RECIPE, seed=1), checkpoint_dir=tmp_path, resume=False)
    assert len(fresh.history) == 3


@pytest.mark.parametrize("keep", [0, 100, 0.5])
def test_a_damaged_checkpoint_is_named(small, grasps, tmp_path, keep):
    train(small, grasps, RECIPE, checkpoint_dir=tmp_path)
    path = tmp_path / "checkpoint.npz"
    content = path.read_bytes()
    path.write_bytes(content[: int(keep * len(content)) if isinstance(keep, float) else keep])
    with pytest.raises(TrainingError, match=r"checkpoint\.npz.*delete it"):
        train(small, grasps, RECIPE, checkpoint_dir=tmp_path)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_loss_that_is_not_finite_stops_at_once(small, value):
    data = SyntheticGrasps(12, 36)
    data.inputs[:] = value
    with pytest.raises(TrainingError, match=r"epoch 0, step 0, at learning rate 0\.001: lower the learning rate"):
        train(small, data, RECIPE)


def test_data_of_another_size_is_refused(small):
    with pytest.raises(TrainingError, match=r"expected inputs of shape \(4, 36, 36, 1\)"):
        train(small, SyntheticGrasps(12, 48), RECIPE)


def test_callbacks_see_what_keras_shows_them(small, grasps):
    calls = []

    class Recorder(keras.callbacks.Callback):
        def on_train_begin(self, logs=None):
            calls.append(("train", self.params["epochs"], self.params["steps"]))

        def on_epoch_begin(self, epoch, logs=None):
            calls.append(("begin", epoch))

        def on_train_batch_end(self, batch, logs=None):
            calls.append(("batch", batch))
            assert logs["loss"] > 0

        def on_epoch_end(self, epoch, logs=None):
            calls.append(("end", epoch))
            assert logs["val_loss"] > 0
            assert float(self.model.optimizer.learning_rate) == pytest.approx(1e-3)

        def on_train_end(self, logs=None):
            calls.append(("over",))

    train(small, grasps, Recipe(epochs=1), validation=grasps, callbacks=[Recorder()])
    assert calls == [("train", 1, 3), ("begin", 0), ("batch", 0), ("batch", 1), ("batch", 2), ("end", 0), ("over",)]


def test_callbacks_stop_and_slow_down(small, grasps):
    stop = keras.callbacks.EarlyStopping("loss", min_delta=10, patience=2)
    assert len(train(small, grasps, Recipe(epochs=9), callbacks=[stop]).history) == 3
    slow = keras.callbacks.ReduceLROnPlateau("loss", factor=0.1, min_delta=10, patience=1)
    rates = [entry["learning_rate"] for entry in train(small, grasps, RECIPE, callbacks=[slow]).history]
    np.testing.assert_allclose(rates, [1e-3, 1e-3, 1e-4], rtol=1e-5)


def test_cosine_ends_at_nothing(small, grasps):
    recipe = Recipe(epochs=4, learning_rate_schedule="cosine")
    result = train(small, grasps, recipe)
    expected = [1e-3 * (1 + np.cos(np.pi * epoch / 4)) / 2 for epoch in range(4)]
    np.testing.assert_allclose([entry["learning_rate"] for entry in result.history], expected, rtol=1e-5)
    assert float(result.model.optimizer.learning_rate) == pytest.approx(0, abs=1e-9)


def test_an_optimizer_that_is_given_is_copied(small, grasps):
    mine = keras.optimizers.SGD(0.01, momentum=0.5)
    recipe = replace(RECIPE, optimizer=mine)
    first = sha256_of_weights(train(small, grasps, recipe).model)
    assert not mine.built
    assert first == sha256_of_weights(train(small, grasps, recipe).model)
    json.dumps(recipe.as_dict())


def test_statistics_and_regularizers_are_those_of_keras_fit(grasps):
    inputs = features = keras.Input((36, 36, 1))
    features = keras.layers.Conv2D(4, 3, padding="same", kernel_regularizer=keras.regularizers.L2(0.1))(features)
    features = keras.layers.ReLU()(keras.layers.BatchNormalization(momentum=0.5)(features))
    model = keras.Model(inputs, [keras.layers.Conv2D(1, 2, padding="same", name=head)(features) for head in HEADS])
    stock = keras.models.clone_model(model)
    stock.set_weights(model.get_weights())
    stock.compile(keras.optimizers.SGD(0.1), "mse")
    order = [row for rows in gn.training.data.batches_of_epoch(12, 4, 0, seed=0, shuffled_rows=False) for row in rows]
    stock.fit(
        grasps.inputs[order],
        {head: grasps.targets[order, ..., number : number + 1] for number, head in enumerate(HEADS)},
        batch_size=4,
        epochs=1,
        shuffle=False,
        verbose=0,
    )
    trained = train(model, grasps, Recipe(epochs=1, optimizer=keras.optimizers.SGD(0.1))).model
    assert len(trained.weights) == len(stock.weights) == 14
    for ours, theirs in zip(trained.get_weights(), stock.get_weights(), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-6)


def test_frozen_layers_stay(small, grasps):
    frozen = keras.models.clone_model(small)
    frozen.get_layer("conv2d_1").trainable = False
    trained = train(frozen, grasps, RECIPE).model
    np.testing.assert_array_equal(trained.get_layer("conv2d_1").kernel, frozen.get_layer("conv2d_1").kernel)
    assert abs(trained.get_layer("conv2d_2").kernel - frozen.get_layer("conv2d_2").kernel).numpy().max() > 0


def test_the_result_can_be_saved_and_grown(small, grasps, tmp_path):
    trained = train(small, grasps, RECIPE).model
    gn.save_ggcnn(trained, tmp_path / "trained.hdf5")
    assert sha256_of_weights(gn.load_ggcnn(tmp_path / "trained.hdf5")) == sha256_of_weights(trained)
    assert gn.wider(trained, 3, carry_optimizer=True).optimizer.built


def test_threads_are_set_before_tensorflow_starts(small):
    with pytest.raises(TrainingError, match="before TensorFlow computes anything"):
        set_threads(7)
    with pytest.raises(TrainingError, match="1 or more"):
        set_threads(0)


def test_importing_training_is_quick():
    code = "import sys, ggcnn_net2net.training; assert not {'tensorflow', 'keras', 'h5py'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(gn.__file__).parent.parent)


def test_a_loss_of_nothing_is_refused(small):
    with pytest.raises(TrainingError, match="without any"):
        mean_loss(small, SyntheticGrasps(0, 36), Recipe(batch_size=2))
