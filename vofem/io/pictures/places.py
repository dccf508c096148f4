"""The places of contacts along a beam or between masses."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from vofem._validate import name_of
from vofem.bodies.base import Body
from vofem.bodies.path import TravellingPoint
from vofem.effects import Contact, Foundation, RigidStop
from vofem.errors import ArgumentError
from vofem.scene import Scene


def is_line(body: Body) -> bool:
    """Return whether a body is drawn as a line, not as a block."""
    return body.shape.kind == "line"


def linked(roots: Iterable[Body], pairs: Sequence[tuple[Any, ...]]) -> Iterator[tuple[Body, Any, Any, int]]:
    """Yield every body once, those that pairs of points link with a root directly after it.

    With a body come the point of an earlier body from which it is reached, its own point, and the number of the pair;
    with a root None, None and 0.
    """
    found: set[Body] = set()
    for root in roots:
        if root in found:
            continue
        found.add(root)
        yield root, None, None, 0
        queue = [root]
        for body in queue:
            for k, pair in enumerate(pairs):
                for here, there in (pair, pair[::-1]):
                    if here.body is body and there.body not in found:
                        found.add(there.body)
                        queue.append(there.body)
                        yield there.body, here, there, k


class Place(NamedTuple):
    """A contact of a body."""

    name: str
    #: Place on the axis of a beam in m. Masses are numbered from 1, and a contact lies between the numbers of its two
    #: masses.
    x: float
    surface: float | None  #: The displacement in m at which the body touches a stop; None between two bodies.


def along_beam(scene: Scene, beam: Body) -> list[Place]:
    """Return the contacts of a beam or another line, those of one-sided foundations too, but none that travel."""
    places = []
    for contact in all_contacts(scene):
        # A stop in space has no place of its own in the frame of a base that moves.
        fixed = contact.b is None and contact.of != "rotation" and getattr(contact, "frame", "base") == "base"
        surface = (-contact.gap if contact.side == "below" else contact.gap) if fixed else None
        own = [p for p in contact.points() if p.body is beam and not isinstance(p, TravellingPoint)]
        places += [Place(contact.name, p.x, surface) for p in own]
    return places


def all_contacts(scene: Scene) -> list[Contact | RigidStop]:
    """Return the contacts of a scene, those of one-sided foundations as if each were declared."""
    laws = scene.model.system.contacts
    if laws is None:
        return []
    stiffness = dict(zip(laws.names, laws.stiffness.tolist(), strict=True))
    beds = [
        Contact(bed.beam.at(float(x)), gap=bed.gap, stiffness=stiffness[name], side="below", acts_on="penetration",
                name=name)
        for bed in scene.effects
        if isinstance(bed, Foundation) and bed.one_sided
        for node, x in enumerate(bed.beam.nodes)
        if (name := f"{bed.name}[{node}]") in stiffness
    ]  # fmt: skip
    return [*scene.contacts, *beds]


def between_masses(scene: Scene) -> list[Place]:
    """Return the contacts of masses, which are numbered from 1 in the order of the scene."""
    number: dict[Body, int] = {body: k for k, body in enumerate(scene.bodies, start=1)}
    places = []
    for contact in scene.contacts:
        numbers = [number[point.body] for point in contact.points()]
        places.append(Place(contact.name, sum(numbers) / len(numbers), None))
    return places


def one_line(scene: Scene, body: Body | str | None) -> Body:
    """Return the line of a scene with this name, or the only one. A line is a beam or a similar body."""
    lines = [b for b in scene.bodies if is_line(b)]
    wanted = [b for b in lines if body is None or b.name == name_of(body)]
    if len(wanted) != 1:
        raise ArgumentError(f"the scene has the beams {[b.name for b in lines]}; say which one with body=")
    return wanted[0]
