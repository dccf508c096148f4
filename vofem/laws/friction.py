"""Coulomb friction: sliders on rows, rigid or behind a spring (Jenkins elements)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vofem.laws.group import LawGroup, ListedLaws
from vofem.laws.hysteretic import HystereticLaws, jenkins

if TYPE_CHECKING:
    from vofem.time_functions import TimeFunction

Array = NDArray[np.float64]

#: Statuses of a slider beside CLOSED (stuck behind its spring) and PINNED (stuck): it slides in either direction.
UP, DOWN = 3, 4


@dataclass(frozen=True, eq=False)
class FrictionLaw:
    """A slider on a row b: ``R = coefficient N sign(w)`` at the slip speed ``w = b.v - belt``; at rest R is a reaction.

    Attributes
    ----------
    name, label : str
    limit, static : float
        Friction force while it slides, and largest reaction while it sticks, N.
    stiffness : float
        Of the spring in series, N/m; inf for a rigid slider.
    belt : TimeFunction, optional
        Speed of the belt, m/s.
    normal : float
        Normal force, N; 1 where a contact presses, so that limits are coefficients.
    contact : str, optional
        Name of the contact whose force presses.
    """

    group: ClassVar[type[LawGroup]]

    name: str
    label: str
    limit: float
    static: float
    stiffness: float
    belt: TimeFunction | None
    normal: float
    contact: str | None = None


@dataclass(frozen=True)
class FrictionLaws(ListedLaws):
    """Sliders, one per row."""

    place: ClassVar[int] = 3
    kind: ClassVar[str] = "friction"
    static: ClassVar[bool] = False

    laws: tuple[FrictionLaw, ...]

    def nonlinearity(self, method: str) -> str | None:
        """Return why the sliders are not linear while their status lasts: belts whose speed has no closed form."""
        for law in self.laws:
            if law.contact is not None:
                return (
                    f"{law.label} is pressed by the contact {law.contact!r}, so that its matrices are not symmetric, "
                    f"which {method} does not treat"
                )
            if law.belt is not None and not law.belt.closed_form:
                return f"{law.label}: the speed of its belt has no closed form, which {method} needs"
        return None

    def refusal(self, what: str) -> str:
        """Return why something cannot treat sliders, and what to do instead."""
        pressed = any(law.contact is not None for law in self.laws)
        only = "'energy_conserving'" if pressed else "'event_driven' or 'energy_conserving'"
        orbits = "" if self.orbit_refusal() is not None else ", and orbits by shooting do"
        return f"{what} does not treat {self.labels[0]}; only simulate(method={only}){orbits or ' does'}"

    def orbit_refusal(self) -> str | None:
        """Return why shooting cannot treat the sliders, and what to do instead; None for rigid ones without belts."""
        for law in self.laws:
            why, cure = "", "simulate the scene until it has settled"
            if law.contact is not None:
                why = f"is pressed by the contact {law.contact!r}"
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

        laws = (law if law.belt is None else replace(law, belt=Shifted(law.belt, start)) for law in self.laws)
        return replace(self, laws=tuple(laws))

    def numbers(self) -> Array:
        """Return all numbers that define the sliders but belts."""
        return np.array([[law.limit, law.static, law.stiffness] for law in self.laws]).ravel()

    def potential(self, u: Array) -> Array:
        """No energy follows from coordinates."""
        return np.zeros(u.shape[1])

    def reactions(self, u: Array) -> Array:
        """No force follows from coordinates."""
        return np.zeros(u.shape)

    @property
    def forms(self) -> tuple[Any, ...]:
        """No law in the sense of `law.Law`: a slider's force does not follow from its coordinate."""
        return ()


@dataclass(frozen=True)
class JenkinsSliders(HystereticLaws):
    """Sliders behind springs in harmonic motions, in the order of the `FrictionLaws` that they stand for."""

    slides: ClassVar[bool] = True


FrictionLaw.group = FrictionLaws
