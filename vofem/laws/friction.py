# mypy: disable-error-code="no-any-return"
"""Coulomb friction: sliders on rows, rigid or behind a spring (Jenkins elements)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from vofem.arrays import Array
from vofem.kernels.jit import jit
from vofem.laws.group import LawGroup, ListedLaws
from vofem.laws.hysteretic import HystereticLaws, jenkins
from vofem.laws.law import COMMIT, FORCE, KINK, MEAN, MEAN_TANGENT, STORED, TANGENT, Law

if TYPE_CHECKING:
    from vofem.time_functions import TimeFunction


#: Statuses of a slider beside CLOSED (stuck behind its spring) and PINNED (stuck): it slides in either direction.
UP, DOWN = 3, 4


@dataclass(frozen=True, eq=False)
class FrictionLaw:
    """A slider on a row b: ``R = coefficient N sign(w)`` at the slip speed ``w = b.v - belt``; at rest a reaction."""

    group: ClassVar[type[LawGroup]]

    name: str
    label: str
    #: `limit`, `static`: friction force while it slides, and largest reaction while it sticks, N.
    limit: float
    static: float
    stiffness: float  #: Of the spring in series, N/m; inf for a rigid slider.
    belt: TimeFunction | None  #: Speed of the belt, m/s.
    normal: float  #: Normal force, N; 1 where a contact presses or where it varies, so that limits are coefficients.
    contact: str | None = None  #: Name of the contact whose force presses.
    varies: TimeFunction | None = None  #: Normal force, N, that depends on time; it presses only while it is positive.


@dataclass(frozen=True)
class FrictionLaws(ListedLaws):
    """Sliders, one per row."""

    place: ClassVar[int] = 3
    kind: ClassVar[str] = "friction"
    named: ClassVar[str] = "sliders"
    static: ClassVar[bool] = False

    laws: tuple[FrictionLaw, ...]

    @property
    def special(self) -> bool:
        """Whether a slider is more than a law with a memory: it is rigid, or its normal force varies."""
        return any(np.isinf(law.stiffness) or law.contact is not None or law.varies is not None for law in self.laws)

    def nonlinearity(self, method: str) -> str | None:
        """Return why the sliders are not linear while their status lasts: belts whose speed has no closed form."""
        for law in self.laws:
            if law.contact is not None:
                return (
                    f"{law.label} is pressed by the contact {law.contact!r}, so that its matrices are not symmetric, "
                    f"which {method} does not treat"
                )
            if law.varies is not None:
                return f"{law.label} has a normal force that depends on time, which {method} does not treat"
            if law.belt is not None and not law.belt.closed_form:
                return f"{law.label}: the speed of its belt has no closed form, which {method} needs"
        return None

    def refusal(self, what: str) -> str:
        """Return why a function cannot treat sliders, and what to do instead."""
        orbits = "" if self.orbit_refusal() is not None else " and orbits by shooting"
        return f"{what} does not treat {self.labels[0]}; runs in time{orbits} do; use these, or leave the slider out"

    def orbit_refusal(self) -> str | None:
        """Return why shooting cannot treat the sliders, and what to do instead; None for rigid ones without belts."""
        for law in self.laws:
            why, cure = "", "simulate the scene until it has settled"
            if law.contact is not None:
                why = f"is pressed by the contact {law.contact!r}"
            elif law.varies is not None:
                why = "has a normal force that varies"
            elif law.stiffness < np.inf:
                why = "has a stiffness, whose spring remembers where it slid last"
                cure = "use method='harmonic_balance', or simulate the scene until it has settled"
            elif law.belt is not None:
                why = "stands on a belt"
            if why:
                return f"{law.label} {why}; shooting takes rigid sliders under a constant normal force only: {cure}"
        return None

    def statics_refusal(self, path: bool) -> str | None:
        """Return why statics cannot treat sliders: equilibria are not unique."""
        return (
            f"{self.labels[0]} holds a body in many places, so {'quasi_static' if path else 'equilibrium'} has no "
            "unique answer; simulate the scene until it rests"
        )

    def harmonic_refusal(self) -> str | None:
        """Return why harmonic balance cannot treat a slider, whose force jumps or whose coordinate drifts."""
        for law in self.laws:
            if law.contact is not None:
                found, cure = f"is pressed by the contact {law.contact!r}", "give normal= instead"
            elif law.varies is not None:
                found, cure = "has a normal force that varies", "give a constant one"
            elif np.isinf(law.stiffness):
                found, cure = (
                    "sticks rigidly, so its force jumps",
                    "find the orbit by shooting, give the slider a spring, stiffness=",
                )
            elif law.static > law.limit:
                found, cure = "has a static coefficient above the sliding one, so its force jumps", "leave out static="
            elif law.belt is not None:
                found, cure = "lies on a belt", "let a second body move"
            else:
                continue
            return f"{law.label} {found}, which harmonic balance cannot treat; {cure}, or let a simulation settle"
        return None

    def as_springs(self) -> JenkinsSliders:
        """Return the sliders, all behind springs, as elastic, perfectly plastic springs."""
        laws = []
        for law in self.laws:
            spring, slip = np.array([law.stiffness]), np.array([law.limit])
            laws.append(jenkins(law.label, law.name, law.stiffness, 0.0, spring, slip, law.limit, "N"))
        return JenkinsSliders(self.rows, tuple(laws))

    def shifted(self, start: float) -> FrictionLaws:
        """Return the sliders for a run that begins at a time in s."""
        from vofem.time_functions.shifted import Shifted

        def later(function: TimeFunction | None) -> TimeFunction | None:
            return None if function is None else Shifted(function, start)

        return replace(
            self, laws=tuple(replace(law, belt=later(law.belt), varies=later(law.varies)) for law in self.laws)
        )  # fmt: skip

    def numbers(self) -> Array:
        """Return all numbers that define the sliders but belts."""
        return np.array([[law.limit, law.static, law.stiffness] for law in self.laws]).ravel()

    def potential(self, u: Array) -> Array:
        """No energy follows from coordinates."""
        return np.zeros(u.shape[1])

    def reactions(self, u: Array) -> Array:
        """No force follows from coordinates."""
        return np.zeros(u.shape)

    @cached_property
    def forms(self) -> tuple[Law, ...]:
        """The sliders behind springs as functions; a rigid slider exerts no force that follows from its coordinate."""
        return tuple(self._form(law) for law in self.laws)

    def _form(self, law: FrictionLaw) -> Law:
        if np.isinf(law.stiffness):
            return Law(law.label, law.name, no_law, stiffness=0.0)
        known = law.contact is None and law.varies is None
        normal = law.normal if known else 0.0
        numbers = [law.limit / law.normal, law.static / law.normal, law.stiffness, normal, normal]
        return Law(
            law.label, law.name, slider, np.array(numbers), np.array([np.nan, 0.0, 1.0]), law.stiffness,
            rising=law.static == law.limit,
        )  # fmt: skip


@dataclass(frozen=True)
class JenkinsSliders(HystereticLaws):
    """Sliders behind springs in harmonic motions, in the order of the `FrictionLaws` that they stand for."""

    slides: ClassVar[bool] = True


FrictionLaw.group = FrictionLaws


@jit
def no_law(what: int, p: Any, z: Any, u0: float, u1: float) -> float:
    """Answer for a row without a law of its own."""
    return np.nan if what == KINK else 0.0


@jit
def slider(what: int, p: Any, z: Any, u0: float, u1: float) -> float:
    """Answer for a slider behind a spring.

    The numbers p are the coefficients of sliding and of break-away, the stiffness of the spring, N/m, and the normal
    forces at the start and at the end of the path, N, which vary evenly in between. The internal variables z are the
    coordinate at the start, m, NaN before any path, the stretch of the spring there, m, and 1 while the slider sticks.
    """
    if what == KINK:
        return np.nan
    k, begin = p[2], z[1]
    way = u1 - z[0] if z[0] == z[0] else 0.0
    hard = p[1] if z[2] == 1.0 else p[0]
    end = begin + way
    side = 1.0 if end >= 0.0 else -1.0
    sticks = side * end <= hard * p[4] / k
    if not sticks:
        end = side * p[0] * p[4] / k
    if what == FORCE:
        return k * end
    if what == TANGENT:
        return k if sticks else 0.0
    if what == STORED:
        return 0.5 * k * end * end
    if what == COMMIT:
        z[0], z[1], z[2] = u1, end, 1.0 if sticks else 0.0
    if what in (MEAN, MEAN_TANGENT):
        if sticks:
            return 0.5 * k if what == MEAN_TANGENT else k * (begin + 0.5 * way)
        # The part of the path on which the spring stretches, up to the friction force at that time.
        rise, low = hard * (p[4] - p[3]) / k, hard * p[3] / k
        room = side * way - rise
        part = min(max((low - side * begin) / room, 0.0), 1.0) if room > 0.0 else 0.0
        if what == MEAN_TANGENT:
            # At break-away the force falls, and a longer path breaks away earlier.
            falls = (hard - p[0]) * (p[3] + part * (p[4] - p[3])) / room if 0.0 < part < 1.0 else 0.0
            return part * (0.5 * k * part - falls)
        middle = p[3] + 0.5 * (1.0 + part) * (p[4] - p[3])
        return k * part * (begin + 0.5 * part * way) + side * (1.0 - part) * p[0] * middle
    return 0.0
