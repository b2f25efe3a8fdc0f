"""Training of GG-CNNs by the paper's recipe, on an exact and faster graph."""

from ggcnn_net2net.training.data import TrainingData
from ggcnn_net2net.training.recipe import Recipe
from ggcnn_net2net.training.threads import set_threads
from ggcnn_net2net.training.train import TrainingResult, mean_loss, train

__all__ = ["Recipe", "TrainingData", "TrainingResult", "mean_loss", "set_threads", "train"]
