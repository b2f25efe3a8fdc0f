"""Net2Net surgery: operations that make a network deeper or wider and leave its function as it is.

Works on any functional `keras.Model` of convolutions, transposed convolutions and Dense layers, and returns
a plain `keras.Model`. Sources: Chen, Goodfellow and Shlens, "Net2Net: Accelerating Learning via Knowledge
Transfer", ICLR 2016; its application to GG-CNN in "Extending GG-CNN through Automated Model Space Exploration
using Knowledge Transfer", section III.
"""

from ggcnn_net2net.net2net.deepen import deeper
from ggcnn_net2net.net2net.history import history_of, set_history
from ggcnn_net2net.net2net.operation import Operation, parse_operations
from ggcnn_net2net.net2net.search_space import (
    EXTENDED_OPERATIONS,
    OPTIMIZED_OPERATIONS,
    apply_operations,
    operations,
    parameters_after,
)
from ggcnn_net2net.net2net.widen import wider

__all__ = [
    "EXTENDED_OPERATIONS",
    "OPTIMIZED_OPERATIONS",
    "Operation",
    "apply_operations",
    "deeper",
    "history_of",
    "operations",
    "parameters_after",
    "parse_operations",
    "set_history",
    "wider",
]
