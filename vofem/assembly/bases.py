"""Bases that bodies stand on, and how their displacements move the contacts of these bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vofem.bodies.base import Body
from vofem.errors import ArgumentError
from vofem.time_functions import Displacement, TimeFunction


@dataclass(frozen=True)
class Base:
    """The motion of the base of one body."""

    body: Body
    acceleration: TimeFunction  #: In m/s^2, positive upward.
    #: `displacement`, `velocity`: at t = 0, m and m/s; None where they were not given.
    displacement: float | None
    velocity: float | None
    label: str  #: For messages.

    @property
    def motion(self) -> tuple[TimeFunction, float | None, float | None]:
        """What tells whether two bases move together."""
        return self.acceleration, self.displacement, self.velocity


def offsets(
    label: str, signs: Sequence[tuple[Body, float]], bases: Sequence[Base]
) -> tuple[tuple[Displacement, float], ...]:
    """Return what the displacements of bases add to a coordinate, as functions of time and their factors.

    `label`: of the effect, for messages.
    `signs`: bodies whose absolute displacements are meant, with the signs with which they enter.
    Raises `ArgumentError` if the displacement of a base is needed and not known.
    """
    base_of = {base.body: base for base in bases}
    mine = [(base_of[body], sign) for body, sign in signs if body in base_of]
    if len(mine) == 2 and mine[0][0].motion == mine[1][0].motion:
        return ()
    found = []
    for base, sign in mine:
        if base.displacement is None or base.velocity is None:
            missing = " and ".join(
                f"{name}=" for name in ("displacement", "velocity") if getattr(base, name) is None
            )  # fmt: skip
            raise ArgumentError(
                f"{label} needs the displacement of the base, of which {base.label} gives the acceleration only; "
                f"state where the base is and how it moves at t = 0: BaseMotion(..., {missing}...), positive upward, "
                "in m and m/s"
            )
        if not base.acceleration.closed_form:
            raise ArgumentError(
                f"{label} needs the displacement of the base, and {base.label} is a callable, which cannot be "
                "integrated exactly; write it with Sine, Ramp, Tabulated and their sums, or approximate it: "
                "vf.Approximated(a, t_end, tolerance)"
            )
        found.append((Displacement(base.acceleration, base.displacement, base.velocity), sign))
    return tuple(found)
