"""Implementation of saved runs: one HDF5 file with scene, model, history and the fields for ParaView."""
