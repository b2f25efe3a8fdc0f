"""`python -m ggcnn_net2net.reproduce` is `ggcnn-net2net reproduce`."""

from ggcnn_net2net.cli.main import run
from ggcnn_net2net.cli.reproduce import reproduce

if __name__ == "__main__":
    run(reproduce, "python -m ggcnn_net2net.reproduce")
