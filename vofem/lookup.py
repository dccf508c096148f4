"""Finding a body, a beam, or rows of points by name: outcomes know their bodies by name."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from vofem._validate import name_of, one_of, unknown, wrong
from vofem.assembly import Model
from vofem.assembly.triplets import stacked
from vofem.bodies.base import Body, Point, Row
from vofem.bodies.beam import Beam
from vofem.errors import ArgumentError

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


def body_named(bodies: Iterable[Body], body: Any, cure: str = "") -> Body:
    """Return the body of the same name, or raise `ArgumentError`, ending with a cure.

    `cure`: the end of the message: what the user can do.
    """
    known = {candidate.name: candidate for candidate in bodies}
    name = name_of(body)
    if not isinstance(getattr(body, "name", body), str):
        raise wrong("body", name, f"a body or its name, {one_of(tuple(known))}", "; are arguments in another order?")
    if name not in known:
        raise unknown("body", name, known, cure)
    return known[name]


def the_beam(bodies: Iterable[Body], body: Any) -> Beam:
    """Return the beam of that name, or the only one where none is given."""
    bodies = tuple(bodies)
    if body is None:
        beams = [candidate for candidate in bodies if isinstance(candidate, Beam)]
        if not beams:
            raise ArgumentError("the scene has no beam, expected one; the motion of masses is displacement(point)")
        if len(beams) != 1:
            raise ArgumentError(f"the scene has {len(beams)} beams; say which one with body=")
        return beams[0]
    beam = body_named(bodies, body)
    if not isinstance(beam, Beam):
        raise ArgumentError(f"{beam.label} has no deflection along x; use displacement(point)")
    return beam


def row_of(bodies: Iterable[Body], point: Any) -> tuple[Body, Row]:
    """Return the body of a point, or of the name of a mass, and the point's row on it, resolved by name and x."""
    bodies = tuple(bodies)
    if isinstance(point, str):
        point = body_named(bodies, point)
    if not isinstance(point, Point):
        raise wrong("point", repr(point), "beam.at(x), a Mass or its name")
    body = body_named(bodies, point.body)
    return body, body.resolve(point)


def rows_over(model: Model, bodies: Iterable[Body], points: Iterable[Any]) -> csr_matrix:
    """Return the rows of points over a model's free degrees of freedom, shape (n_points, n)."""
    bodies = tuple(bodies)
    found = (row_of(bodies, point) for point in points)
    rows = [Row(row.indices + model.offsets[body], row.weights) for body, row in found]
    return model.unknowns.rows(stacked(rows, model.size))
