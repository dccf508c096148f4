"""Rigid stop: a one-sided constraint at which the velocity reverses at once."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Annotated

from vofem._validate import wrong
from vofem.assembly import ContactEntry, SystemBuilder
from vofem.bodies.base import Point
from vofem.effects.kinds import AtPoint, End, Named
from vofem.effects.two_points import Side, Stop
from vofem.parameters import CHOSEN, Real, declared, label_of, rule


@declared()
class RigidStop(Stop):
    """A rigid stop with a coefficient of restitution, for ``method="event_driven"`` and orbits by shooting.

    Let b be the row of the gap function ``s = b.q - gap``, whose sign conventions are those of `Contact`. The stop
    keeps ``s <= 0``. Where s reaches zero with the speed ``b.v > 0``, the velocities change at once,

        v+ = v- - (1 + e) (b.v-)/(b M^-1 b') M^-1 b',

    so that the speed of approach is reversed and multiplied by e. Each bounce is a row of
    ``result.contacts[name].impacts`` whose closing and opening are the same time. If forces press the body against the
    stop, bounces with e < 1 accumulate: the speed falls below any limit in a finite time. Once it is below 1e-9 of the
    largest speed of approach, the contact is pinned: it rests exactly at its gap until its reaction vanishes. With
    e = 0 it is pinned at once.

    Raises
    ------
    ArgumentError
        If `side` is missing, or is given for a stop between two points, or if a value is out of range.

    References
    ----------
    B. Brogliato, Nonsmooth Mechanics, Springer 2016, doi:10.1007/978-3-319-28664-8.
    """

    a: End
    b: Annotated[
        Point | None,
        AtPoint(
            "``beam.at(x)`` or a `Mass`. With b, a is the lower point: the bodies touch when a has risen relative to b "
            "by the gap. Without b the stop is fixed in space."
        ),
    ] = None
    _: KW_ONLY
    gap: Annotated[float, Real("m", "The gap.")]
    restitution: Annotated[
        float,
        Real("", "Coefficient of restitution e: speed after over speed before an impact, from 0 to 1.", least=0.0),
    ]
    side: Side = None
    name: Named = CHOSEN

    @rule("restitution")
    def _no_energy_is_made(self) -> None:
        if self.restitution > 1.0:
            raise wrong(
                f"{label_of(self)}: restitution", f"{self.restitution:g}", "a number from 0 to 1",
                "; above 1 every impact would add energy",
            )  # fmt: skip

    def compile(self, builder: SystemBuilder) -> None:
        """Add the row and the coefficient."""
        row = self._row(builder, -1.0 if self.side == "below" else 1.0)
        builder.add_contact(ContactEntry(name=self.name, row=row, gap=self.gap, restitution=self.restitution))

    def describe(self) -> str:
        """Return points, gap and coefficient."""
        return f"RigidStop {self.name!r} {self._place()}, restitution {self.restitution:g}"
