"""Grasp data: Cornell, Jacquard and simulated scenes, in one HDF5 layout."""
