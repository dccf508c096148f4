"""The envelope of a motion: its least and largest values in equal parts of a window of time."""

from __future__ import annotations

import numpy as np

from vofem.arrays import Array


def envelope_of(times: Array, values: Array, window: tuple[float, float], parts: int) -> tuple[Array, Array, Array]:
    """Return the middles of the parts that hold values, and the least and the largest value in each.

    `times`, `values` (shape (n,)): times and values in the order of time.
    `window`: in s.
    Returns `middle, low, high` (shape (k,)).
    """
    edges = np.linspace(*window, parts + 1)
    part = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, parts - 1)
    held, first = np.unique(part, return_index=True)
    low, high = np.minimum.reduceat(values, first), np.maximum.reduceat(values, first)
    return 0.5 * (edges[held] + edges[held + 1]), low, high
