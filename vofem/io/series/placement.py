"""Places of bodies and contacts in space, for a series of VTU files.

The x axis runs along the beams, and y points upward like the displacement. Every
body has a plane of its own, whose z is its number in the scene times a spacing.
Bodies are thus separate in space and coincide in the side view. If an effect
connects a body with one that is already placed, the two points get the same x,
and b is placed above a by the gap. In the side view they touch when the gap
closes. Bodies that are tied by a joint share a plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.bodies import Beam
from vofem.bodies.base import Body, Point, Row, place_of
from vofem.effects import Joint
from vofem.errors import ArgumentError
from vofem.scene import Scene

Array = NDArray[np.float64]

#: Of the size of the scene: distance of the planes, half the width of a stop.
_SPACING, _STOP = 0.1, 0.02


@dataclass(frozen=True)
class Foot:
    """One end of a contact, on a body.

    Attributes
    ----------
    body : Body
    place : ndarray, shape (3,)
        Place at rest, m.
    row : Row
        Row of the displacement, over the degrees of freedom of the body.
    """

    body: Body
    place: Array
    row: Row


@dataclass(frozen=True)
class Touch:
    """A contact in space.

    Attributes
    ----------
    index : int
        Among the contacts of the system.
    a : Foot
    b : Foot or None
        None for a stop.
    stop : ndarray, shape (3,)
        Where a stop is; unused between two bodies.
    """

    index: int
    a: Foot
    b: Foot | None
    stop: Array


@dataclass(frozen=True)
class Placement:
    """The places of all bodies and contacts.

    Attributes
    ----------
    origins : dict of Body to ndarray, shape (3,)
        Where x = 0 of a body is at rest, in m.
    touches : tuple of Touch
    half_stop : float
        Half the width of a stop, m.
    """

    origins: dict[Body, Array]
    touches: tuple[Touch, ...]
    half_stop: float


def place(scene: Scene, magnification: float) -> Placement:
    """Return the places of all bodies and contacts, with gaps drawn `magnification` times as large."""
    size = _size(scene, magnification)
    origins = {body: np.array([0.0, 0.0, k * _SPACING * size]) for k, body in enumerate(scene.bodies)}
    pairs = [e for e in scene.effects if len(e.points()) == 2]
    # Joints first: what is tied stands where it is tied.
    pairs.sort(key=lambda effect: not isinstance(effect, Joint))
    placed: set[Body] = set()
    for root in scene.bodies:
        if root in placed:
            continue
        placed.add(root)
        found = [root]
        for body in found:
            for effect in pairs:
                a, b = effect.points()
                gap = magnification * _gap(effect)
                for here, there, up in ((a, b, gap), (b, a, -gap)):
                    if here.body is body and there.body not in placed:
                        along = origins[body][0] + place_of(here) - place_of(there)
                        origins[there.body][:2] = along, origins[body][1] + up
                        if isinstance(effect, Joint):
                            origins[there.body][2] = origins[body][2]
                        placed.add(there.body)
                        found.append(there.body)
    return Placement(origins, tuple(_touches(scene, origins, magnification)), _STOP * size)


def _size(scene: Scene, magnification: float) -> float:
    """Return the longest beam, or the largest gap where there are only masses, m."""
    lengths = [float(np.ptp(body.shape.x)) for body in scene.bodies]
    gaps = [abs(magnification * _gap(contact)) for contact in scene.contacts]
    return max(lengths, default=0.0) or max(gaps, default=0.0) or 1.0


def _gap(effect: Any) -> float:
    """Return the gap of an effect in m; 0 where it is one of rotations."""
    return float(getattr(effect, "gap", 0.0)) if getattr(effect, "of", "displacement") == "displacement" else 0.0


def _touches(scene: Scene, origins: dict[Body, Array], magnification: float) -> list[Touch]:
    laws = scene.model.system.contacts
    if laws is None:
        return []

    def foot(point: Point) -> Foot:
        return Foot(point.body, origins[point.body] + np.array([place_of(point), 0.0, 0.0]), point.row())

    known = {contact.name: contact for contact in scene.contacts}
    touches = []
    for index, name in enumerate(laws.names):
        if name in known:
            contact = known[name]
            a, b = foot(contact.a), None if contact.b is None else foot(contact.b)
            side: str | None = contact.side
        else:  # one of a one-sided foundation
            point, side = _node_of(scene, index)
            a, b = foot(point), None
        up = 1.0 if side == "above" else -1.0
        gap = laws.gap[index] if name not in known else _gap(known[name])
        stop = a.place + up * magnification * gap * np.array([*a.body.shape.direction, 0.0])
        touches.append(Touch(index, a, b, stop))
    return touches


def _node_of(scene: Scene, index: int) -> tuple[Point, str]:
    """Return the point and the side of a contact that is known by its row only."""
    model = scene.model
    assert model.contact_rows is not None
    row = model.contact_rows[[index]].tocoo()
    for body, start in model.offsets.items():
        if row.nnz == 1 and start <= row.col[0] < start + body.size and isinstance(body, Beam):
            known, dof = body.degrees_of_freedom, int(row.col[0]) - start
            if not known.rotation[dof]:
                return body.at(float(known.x[dof])), "above" if row.data[0] > 0 else "below"
    raise ArgumentError(f"contact {index} of the scene lies on no point that could be shown")
