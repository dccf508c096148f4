"""Implementation of scene files: their schema, reading and writing."""
