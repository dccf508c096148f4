"""A sum of modes at many times: on panels of equal width oscillators are evaluated once for all panels.

The state of every mode is known at the beginning of each panel. The functions of time that lead from there to the
points of a panel are the same for all panels. One product of matrices therefore gives all points.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.motion import Motion
from vofem.linalg.exponential import oscillator_changes

Array = NDArray[np.float64]

#: Widths of panels that differ by less than this share are equal: they are halves of halves of one stretch.
_EQUAL = 1e-9


def changes_on_panels(motion: Motion, weight: Array, tau: Array, width: Array, fractions: Array) -> Array | None:
    """Return by how much a sum of modes has changed since the begin of a segment, shape (n_fractions, n_panels).

    Parameters
    ----------
    motion : Motion
    weight : ndarray, shape (m,)
        Weight of each mode in the sum.
    tau, width : ndarray, shape (n_panels,)
        Times in s at which panels begin, and their lengths in s.
    fractions : ndarray, shape (n_fractions,)
        Places in a panel, from 0 to 1.

    Returns
    -------
    ndarray or None
        None with complex modes and at resonance, where the motion is more than oscillators, harmonics and ramps.
    """
    if motion.spectrum.blocks is not None or motion.special.block.size or motion.clusters.rate.size:
        return None
    changes = np.empty((fractions.size, tau.size))
    for group in _of_equal_width(width):
        later = float(np.mean(width[group])) * fractions
        changes[:, group] = _changes(motion, weight, tau[group], later).T
    return changes


def _of_equal_width(width: Array) -> list[NDArray[np.int64]]:
    """Return the numbers of panels in groups of equal width."""
    order = np.argsort(width, kind="stable")
    wider = np.flatnonzero(np.diff(width[order]) > _EQUAL * width[order][1:]) + 1
    return np.split(order, wider)


def _changes(motion: Motion, weight: Array, tau: Array, later: Array) -> Array:
    """Return changes at times `later` after the begins `tau` of panels, shape (n_panels, n_fractions)."""
    spectrum = motion.spectrum
    z, v = motion.free_changes(tau)
    total = (weight @ z)[:, None] + np.zeros(later.size)
    z += motion.z[:, None]
    v += motion.v[:, None]
    c, s = oscillator_changes(spectrum.delta, spectrum.p, later)
    pull = v + spectrum.delta[:, None] * z
    total += (weight[:, None] * z).T @ c + (weight[:, None] * pull).T @ s
    if motion.ramps:
        total += weight @ motion.poly_z[:, 1] * (tau[:, None] + later)
    if motion.omega.size:
        steady = weight @ motion.steady_z
        before, after = (np.expm1(1j * np.multiply.outer(motion.omega, t)) for t in (tau, later))
        total += (steady @ before).real[:, None] + ((steady[:, None] * (1.0 + before)).T @ after).real
    return np.asarray(total)
