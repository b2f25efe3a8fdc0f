import json
from dataclasses import dataclass, field, replace

import cv2
import pytest
from training_images import sha256_of_weights

import ggcnn_net2net as gn
from ggcnn_net2net.errors import SurgeryError, TrainingError
from ggcnn_net2net.net2net import parse_operations
from ggcnn_net2net.protocol import CORRECTED
from ggcnn_net2net.training import Recipe, train
from ggcnn_net2net.training.distillation import Distilled
from ggcnn_net2net.training.stages import stage_dir, stages_of, train_stages, write_stage_curves

RECIPE = Recipe(epochs=1, protocol=CORRECTED, seed=3)
GROWTH = parse_operations("wider(3), deeper(1)")
FINAL_EPOCHS = 2


class Interrupted(Exception):
    pass


@dataclass
class Recorder:
    """Keeps every step that it is told of; interrupts the run before the step after the last one it may see."""

    most: int | None = None
    steps: list[tuple[int, int]] = field(default_factory=list)

    def __call__(self, epoch, step, steps, loss):
        self.steps.append((epoch, step))
        if len(self.steps) == self.most:
            raise Interrupted


@pytest.fixture(scope="module")
def grown(small, grasps):
    return train_stages(small, grasps, RECIPE, GROWTH, FINAL_EPOCHS, validation=grasps)


def test_it_is_surgery_and_training_by_turns(grown, small, grasps):
    first, second = (stage.recipe for stage in stages_of(RECIPE, GROWTH, FINAL_EPOCHS))
    wide = gn.apply_operations(small, GROWTH[:1], first.seed, CORRECTED.wider_noise)
    between = train(wide, grasps, first).model
    deep = gn.apply_operations(between, GROWTH[1:], second.seed)
    by_hand = train(deep, grasps, second, validation=grasps)
    assert sha256_of_weights(grown.model) == sha256_of_weights(by_hand.model)
    assert gn.history_of(grown.model) == gn.history_of(deep)
    assert [step["noise"] for step in gn.history_of(grown.model)[:1]] == [CORRECTED.wider_noise]
    assert [entry["loss"] for entry in grown.history[1:]] == [entry["loss"] for entry in by_hand.history]
    assert [(entry["stage"], entry["epoch"]) for entry in grown.history] == [(0, 0), (1, 1), (1, 2), (1, 3)]
    assert json.loads(json.dumps(grown.history)) == grown.history


def test_one_stage_without_surgery_is_train(small, grasps, tmp_path):
    recipe = replace(RECIPE, learning_rate_schedule="cosine")
    plain = train(small, grasps, recipe, checkpoint_dir=tmp_path)
    recorder = Recorder()
    # It goes on from the checkpoint of train, which is therefore the same run in the same folder.
    staged = train_stages(small, grasps, recipe, [None], checkpoint_dir=tmp_path, on_progress=recorder)
    assert recorder.steps == []
    assert staged.history == plain.history
    assert sha256_of_weights(staged.model) == sha256_of_weights(plain.model)


@pytest.mark.parametrize("steps", [4, 7])  # three steps an epoch: in the first and the second epoch of stage 1
def test_an_interrupted_stage_goes_on_with_the_same_bits(grown, small, grasps, tmp_path, steps):
    arguments = (small, grasps, RECIPE, GROWTH, FINAL_EPOCHS)
    with pytest.raises(Interrupted):
        train_stages(*arguments, checkpoint_dir=tmp_path, on_progress=Recorder(steps))
    assert sha256_of_weights(gn.load_ggcnn(stage_dir(tmp_path, 0) / "model.hdf5")) != sha256_of_weights(grown.model)
    recorder = Recorder()
    resumed = train_stages(*arguments, checkpoint_dir=tmp_path, on_progress=recorder)
    begins = (steps - 1) // 3  # the epoch that was interrupted
    assert recorder.steps == [(epoch, step) for epoch in range(begins, 4) for step in (1, 2, 3)]
    assert sha256_of_weights(resumed.model) == sha256_of_weights(grown.model)
    assert [entry["loss"] for entry in resumed.history] == [entry["loss"] for entry in grown.history]
    assert sha256_of_weights(gn.load_ggcnn(stage_dir(tmp_path, 1) / "model.hdf5")) == sha256_of_weights(grown.model)


def test_other_operations_do_not_go_on_from_the_checkpoints(small, grasps, tmp_path):
    train_stages(small, grasps, RECIPE, GROWTH, checkpoint_dir=tmp_path)
    other = parse_operations("wider(3), deeper(2)")
    with pytest.raises(TrainingError, match=r"stage_1.*another network"):
        train_stages(small, grasps, RECIPE, other, checkpoint_dir=tmp_path)
    train_stages(small, grasps, RECIPE, other, checkpoint_dir=tmp_path, resume=False)


def test_more_epochs_of_an_early_stage_are_refused_before_any_training(small, grasps, tmp_path):
    train_stages(small, grasps, RECIPE, GROWTH, checkpoint_dir=tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.npz")}
    with pytest.raises(TrainingError, match=r"stage 0 with the 1 epochs.*received 2: only the last stage"):
        train_stages(small, grasps, replace(RECIPE, epochs=2), GROWTH, checkpoint_dir=tmp_path)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.npz")} == before
    train_stages(small, grasps, RECIPE, GROWTH, FINAL_EPOCHS, checkpoint_dir=tmp_path)  # can still be prolonged


def test_a_fresh_start_forgets_the_checkpoints_of_all_stages(small, grasps, tmp_path):
    train_stages(small, grasps, RECIPE, GROWTH, checkpoint_dir=tmp_path)
    other = replace(RECIPE, seed=4)
    with pytest.raises(Interrupted):
        train_stages(small, grasps, other, GROWTH, checkpoint_dir=tmp_path, resume=False, on_progress=Recorder(2))
    train_stages(small, grasps, other, GROWTH, checkpoint_dir=tmp_path)


def test_wrong_operations_are_refused_before_any_training(small, grasps, tmp_path):
    recorder = Recorder()
    with pytest.raises(SurgeryError, match=r"operation 2 of 2, wider\(20\)"):
        train_stages(
            small,
            grasps,
            RECIPE,
            parse_operations("deeper(1), wider(20)"),
            checkpoint_dir=tmp_path,
            on_progress=recorder,
        )
    with pytest.raises(TrainingError, match="one operation or more"):
        train_stages(small, grasps, RECIPE, [], checkpoint_dir=tmp_path)
    with pytest.raises(TrainingError, match="received 1 and -1"):
        train_stages(small, grasps, RECIPE, [None], -1, checkpoint_dir=tmp_path)
    assert recorder.steps == []
    assert list(tmp_path.iterdir()) == []


def test_the_control_takes_the_same_steps_in_the_same_order_without_surgery(grown, small, grasps):
    class Watched:
        fingerprint = "watched"

        def __init__(self):
            self.read = []

        def __len__(self):
            return len(grasps)

        def batch(self, rows, epoch):
            self.read.append((epoch, tuple(rows)))
            return grasps.batch(rows, epoch)

    images, control_images = Watched(), Watched()
    train_stages(small, images, RECIPE, GROWTH, FINAL_EPOCHS)
    control = train_stages(small, control_images, RECIPE, [None, None], FINAL_EPOCHS)
    assert control_images.read == images.read
    assert [epoch for epoch, _ in images.read[::3]] == [0, 1, 2, 3]  # so fresh augmentations stay fresh
    assert control.model.count_params() == small.count_params() < grown.model.count_params()
    plain = train(small, grasps, replace(RECIPE, epochs=4)).model  # an optimizer that is not started afresh
    assert sha256_of_weights(control.model) != sha256_of_weights(plain)


def test_the_last_stage_alone_lets_the_learning_rate_fall():
    recipe = Recipe(epochs=2, learning_rate_schedule="cosine", seed=5)
    stages = stages_of(recipe, [None, None, None], 3)
    assert [stage.recipe.learning_rate_schedule for stage in stages] == [None, None, "cosine"]
    assert [stage.recipe.epochs for stage in stages] == [2, 2, 5]
    assert stages_of(recipe, [None])[0].recipe == recipe


def test_every_stage_has_a_seed_of_its_own():
    seeds = [stage.recipe.seed for seed in (0, 1) for stage in stages_of(Recipe(seed=seed), [None] * 5)]
    assert len(set(seeds)) == 10
    assert seeds[0] == 0
    assert seeds[5] == 1
    assert seeds[:3] == [stage.recipe.seed for stage in stages_of(Recipe(), GROWTH + GROWTH[:1])]
    assert all(type(seed) is int for seed in seeds)


def test_distillation_with_a_masked_loss_is_refused_here_too(small, grasps):
    with pytest.raises(TrainingError, match="masked_loss"):
        train_stages(small, Distilled(grasps, small, 0.5), RECIPE, [None, None])


def test_curves_are_drawn(grown, tmp_path):
    picture = tmp_path / "curves.png"
    write_stage_curves(grown.history, stages_of(RECIPE, GROWTH, FINAL_EPOCHS), picture, "a title")
    drawn = cv2.imread(str(picture))
    orange = (abs(drawn.astype(int) - [0x0E, 0x7F, 0xFF]).sum(axis=2) < 60).any(axis=0)  # columns with it
    assert (orange[1:] & ~orange[:-1]).sum() >= 2  # a line a stage, and what is written above them
