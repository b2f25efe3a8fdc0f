"""`python -m ggcnn_net2net` is `ggcnn-net2net`."""

from ggcnn_net2net.cli.main import main

if __name__ == "__main__":
    main()
