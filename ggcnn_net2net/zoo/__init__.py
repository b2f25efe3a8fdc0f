"""The zoo: small networks that this project trained, each with a record of what made it.

`load_ggcnn("zoo:NAME")`, and every command that takes a model file, open them.
"""

from ggcnn_net2net.zoo.adding import MAX_BYTES, REQUIRED_FIELDS, add, read_provenance
from ggcnn_net2net.zoo.files import PREFIX, STAND_IN, StandInWarning, names, network_file, provenance
from ggcnn_net2net.zoo.measured import MEASURED, measured
from ggcnn_net2net.zoo.searched import searched

__all__ = [
    "MAX_BYTES",
    "MEASURED",
    "PREFIX",
    "REQUIRED_FIELDS",
    "STAND_IN",
    "StandInWarning",
    "add",
    "measured",
    "names",
    "network_file",
    "provenance",
    "read_provenance",
    "searched",
]
