"""Saved runs from the inside: one HDF5 file with the scene, the model, the history and the fields for ParaView."""
