"""Vibration modes, with any contacts held closed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import listed, name_of, unknown, whole
from vofem.arrays import Array
from vofem.assembly import Model
from vofem.bodies.base import Body
from vofem.bodies.beam import Beam
from vofem.errors import ArgumentError
from vofem.lookup import body_named
from vofem.scene import Scene, as_scene
from vofem.system import System

#: Up to this size all modes come from dense matrices.
_DENSE = 1500


class Modes:
    """Undamped vibration modes in ascending order of frequency; rigid motions come first.

    Attributes
    ----------
    omega : ndarray, shape (count,)
        Angular frequencies in rad/s; exactly 0 for rigid motions.
    scene : Scene
    closed : tuple
        Contacts that were held closed.
    """

    def __init__(self, scene: Scene, closed: Sequence[Any], omega: Array, shapes: Array) -> None:
        self.scene, self.closed = scene, tuple(closed)
        self._model: Model = scene.model
        self.omega = omega
        self._shapes = shapes

    def __repr__(self) -> str:
        span = f" of {self.frequencies[0]:.6g} to {self.frequencies[-1]:.6g} Hz" if self.omega.size else ""
        return f"Modes({self.omega.size} modes{span})"

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The bodies of the scene."""
        return tuple(self._model.offsets)

    @property
    def frequencies(self) -> Array:
        """Frequencies in Hz, shape (count,)."""
        return self.omega / (2.0 * np.pi)

    @property
    def free_shapes(self) -> Array:
        """Shapes over the free degrees of freedom, scaled to unit modal mass, shape (n, count)."""
        return self._shapes

    def shape(self, k: int, x: ArrayLike | None = None, body: Any = None) -> Array:
        """Return the shape of a mode, scaled to unit modal mass.

        Parameters
        ----------
        k : int
            Number of the mode, counted from 0.
        x : array_like, optional
            Places along a beam in m. It has no meaning for a mass.
        body : Beam or Mass, or its name, optional
            The body. It must be given if the scene has several.

        Returns
        -------
        ndarray, shape (len(x),), or (1,) for a mass; of other bodies at the places of their shape
            The shape in 1/sqrt(kg).
        """
        k = whole("Modes.shape: k", k, 0, self.omega.size - 1)
        chosen = self._body(body)
        values = self._model.of_body(chosen, self._shapes[:, k])
        if isinstance(chosen, Beam):
            if x is None:
                raise ArgumentError("the shape of a beam needs x, the points to evaluate it at")
            return np.asarray(chosen.field_matrix(x) @ values)
        return np.asarray(chosen.shape.rows @ values)

    def _body(self, body: Any) -> Body:
        bodies = tuple(self._model.offsets)
        if body is None:
            if len(bodies) != 1:
                raise ArgumentError(f"the scene has {len(bodies)} bodies; say which one with body=")
            return bodies[0]
        return body_named(bodies, body)


def modes(scene: Scene, count: int = 6, closed: Sequence[Any] = ()) -> Modes:
    """Return the lowest vibration modes, undamped, with the named contacts closed.

    Dampers and springpots are left out. In motion a springpot also stiffens the
    structure, the more the faster it moves.

    Parameters
    ----------
    scene : Scene
        The scene.
    count : int
        Number of modes. Fewer are returned if the system has fewer.
    closed : sequence of str or Contact
        Contacts that act as linear springs; all others are open.

    Raises
    ------
    ArgumentError
        For an unknown contact, and for one that is rigid or travels.
    """
    from vofem.linalg.eigen import modal_basis
    from vofem.linalg.null_space import null_space

    count = whole("modes: count", count)
    system = as_scene("modes", scene).model.system
    stiffness, rigid, strain = system.stiffness, system.rigid, system.strain
    for group in system.laws:
        reason = group.modes_refusal()
        if reason is not None:
            raise ArgumentError(f"modes: {reason}")
    chosen = contact_indices("modes", system, closed)
    if chosen:
        from scipy.sparse import diags, vstack

        laws = system.contacts
        assert laws is not None
        rows = laws.rows[chosen]
        stiffness = stiffness + rows.T @ diags(laws.stiffness[chosen]) @ rows
        if strain is not None:
            strain = vstack([strain, diags(np.sqrt(laws.stiffness[chosen])) @ rows], format="csr")
        if rigid.shape[1]:
            rigid = rigid @ null_space(np.asarray(rows @ rigid), np.asarray(abs(rows) @ np.abs(rigid)))
    if system.size <= _DENSE:
        squares, shapes = modal_basis(system.mass, stiffness, system.scale, rigid, strain)
    else:
        squares, shapes = _lowest(system.mass, stiffness, rigid, min(count, system.size - 2))
    count = min(count, squares.size)
    return Modes(scene, tuple(listed(closed)), np.sqrt(squares[:count]), shapes[:, :count])


def contact_indices(what: str, system: System, closed: Sequence[Any]) -> list[int]:
    """Return the numbers of named contacts, which act as springs when closed; `what` is for the message."""
    laws = system.contacts
    names = [] if laws is None else list(laws.names)
    indices = []
    for item in listed(closed):
        name = name_of(item)
        if name not in names:
            raise unknown("contact", name, names, what=what)
        j = names.index(name)
        assert laws is not None
        why = "is rigid, so that it is no spring" if laws.rigid[j] else ""
        if laws.moving is not None and j in laws.moving.riders:
            why = "travels along a beam, so that it is a spring at no fixed place"
        if why:
            raise ArgumentError(
                f"{what}: closed names {laws.labels[j]}, which {why}. Put a Contact with a stiffness there, on a point "
                "that does not travel"
            )
        indices.append(j)
    return indices


def _lowest(mass: Any, stiffness: Any, rigid: Array, count: int) -> tuple[Array, Array]:
    """Return the lowest modes of a large system by Lanczos on the inverse problem."""
    from scipy.sparse.linalg import eigsh

    # A shift well below the first elastic mode makes K regular where rigid motions remain.
    typical = float(np.median(stiffness.diagonal() / mass.diagonal()))
    sigma = -1e-12 * typical if rigid.shape[1] else 0.0
    start = np.random.default_rng(0).standard_normal(mass.shape[0])
    squares, shapes = eigsh(stiffness.tocsc(), k=count, M=mass.tocsc(), sigma=sigma, which="LM", v0=start)
    order = np.argsort(squares)
    squares, shapes = squares[order], shapes[:, order]
    squares[: rigid.shape[1]] = 0.0
    return np.maximum(squares, 0.0), shapes
