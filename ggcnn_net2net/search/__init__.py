"""Beam search over surgeries: the paper's, resumable, repeatable, parallel (sections II and III-A of the paper)."""

from ggcnn_net2net.search.beam import BeamSearch
from ggcnn_net2net.search.run import load_history, resume_search, start_search
from ggcnn_net2net.search.settings import BUDGETS, SearchSettings

__all__ = ["BUDGETS", "BeamSearch", "SearchSettings", "load_history", "resume_search", "start_search"]
