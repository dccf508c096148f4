"""Section forces of a beam that balance the loads along it and its elastic bedding, which are effects of a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import array
from vofem.arrays import Array
from vofem.bodies.beam import Beam
from vofem.bodies.cubics import hermite
from vofem.effects.foundation import Foundation
from vofem.effects.loads import BaseMotion, DistributedLoad, Gravity
from vofem.time_functions import as_time_function

#: Gauss points of an element, or of the part of it up to a place: exact for loads of degree 15.
_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)

#: A load per length in N/m at points (m,), shape (m, n_times).
LinePressure = Callable[[Array], Array]


def recovered_sections(beam: Beam, x: ArrayLike, q: Array, load: LinePressure) -> tuple[Array, Array]:
    """Return bending moment (N m) and shear force (N) that balance the load within every element.

    The moment of the cubics, ``EI eta''``, is one that no load acts on inside an element. Its linear part gives the
    forces at the ends of the element; the fixed-end moments and forces of the load are taken from these, and the load
    is integrated from the left end to x. Where nodal displacements are exact, as in statics with constant EI, so are
    moment and shear force.

    `x` (shape (k,)): in m; at a node the element to its right is taken (the last node: to its left).
    `q` has shape (beam.size, n_times).
    `load`: the load per length, all that is proportional to displacements or accelerations included.
    Returns `moment, shear` (shape (k, n_times)).
    """
    element, xi = beam.locate(np.atleast_1d(array(f"a point of {beam.label}", x)))
    h, left, count = beam.element_lengths[element], beam.nodes[element], q.shape[1]
    s = xi * h
    g, w = 0.5 * (1.0 + _POINTS), 0.5 * _WEIGHTS
    # The linear part of EI eta'' has the same work on all cubics, so the same forces at the ends.
    whole = left[:, None] + g * h[:, None]
    stiffness = beam.bending_stiffness(whole.ravel())[0][:, None]
    moment = (stiffness * (beam.field_matrix(whole.ravel(), 2) @ q)).reshape(*whole.shape, count)
    mean, tilt = np.einsum("g,kgt->kt", w, moment), np.einsum("g,kgt->kt", 3.0 * w * (2.0 * g - 1.0), moment)
    pressure = load(whole.ravel()).reshape(*whole.shape, count)
    before = load((left[:, None] + g * s[:, None]).ravel()).reshape(*whole.shape, count)
    force, turning = (np.einsum("kg,kgt->kt", w * h[:, None] * hermite(i, g, h[:, None]), pressure) for i in (0, 1))
    shear = 2.0 * tilt / h[:, None] - force + s[:, None] * np.einsum("g,kgt->kt", w, before)
    lever = s[:, None] ** 2 * np.einsum("g,kgt->kt", w * (1.0 - g), before)
    return mean + (2.0 * xi - 1.0)[:, None] * tilt + turning - s[:, None] * force + lever, shear


def balanced_sections(
    effects: Iterable[Any], beam: Beam, x: ArrayLike, times: Array, q: Array, a: Array | None = None
) -> tuple[Array, Array]:
    """Return bending moment (N m) and shear force (N) that balance loads and, with accelerations, inertia.

    `q`, `a` (shape (beam.size, n_times)): degrees of freedom and their second rates; results are (len(x), n_times).
    """
    loads: list[tuple[Callable[[Array], Array], Callable[[ArrayLike], Any]]] = []
    bedding: list[Callable[[Array], Array]] = []
    for effect in effects:
        match effect:
            case DistributedLoad() if effect.beam is beam:
                loads.append((effect.along, as_time_function(effect.f)))
            case Gravity():
                loads.append((lambda x, g=effect.g: -g * beam.mass_per_length(x), np.ones_like))  # type: ignore[misc]
            case BaseMotion() if effect.body is beam:
                loads.append((lambda x: -beam.mass_per_length(x), as_time_function(effect.acceleration)))
            case Foundation() if effect.beam is beam and not effect.one_sided:
                bedding.append(effect.along)
    values = [np.broadcast_to(np.asarray(function(times), dtype=float), times.shape) for _, function in loads]

    def load(places: Array) -> Array:
        total = np.zeros((places.size, times.size))
        for (along, _), value in zip(loads, values, strict=True):
            total += np.outer(along(places), value)
        eta = beam.field_matrix(places)
        if a is not None:
            total -= beam.mass_per_length(places)[:, None] * (eta @ a)
        if bedding:
            total -= sum((stiffness(places) for stiffness in bedding), np.zeros(places.size))[:, None] * (eta @ q)
        return total + beam.tension * (beam.field_matrix(places, 2) @ q) if beam.tension else total

    return recovered_sections(beam, x, q, load)
