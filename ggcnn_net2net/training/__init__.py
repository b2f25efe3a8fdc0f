"""Training of GG-CNNs by the paper's recipe, on an exact and faster graph."""
