"""What a case of the catalogue is: quantities with references, a measurement, and how every method is run on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

from vofem.bodies import Mass
from vofem.effects import Contact
from vofem.integrators import methods as built_in
from vofem.integrators.registry import method_named, methods
from vofem.result import Result
from vofem.scene import Scene
from vofem.simulate.simulation import simulate
from vofem.statics import Equilibrium, equilibrium
from vofem.studies.steady import Branch, PeriodicOrbit, continuation, periodic
from vofem.vibration import Modes, modes

#: Verdicts. "reported": beyond its tolerance, and a note of the run says so.
Verdict = Literal["passed", "reported", "refused", "stopped", "FAILED"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)
PASSED, REPORTED, REFUSED, STOPPED, FAILED = VERDICTS

#: The methods of this package for which every case says what is expected. Methods for one law only have
#: tests of their own.
DYNAMIC = tuple(method.name for method in built_in.BUILT_IN if not method.special)

EVENT_DRIVEN = built_in.EVENT_DRIVEN.name
CONSERVING = built_in.ENERGY_CONSERVING.name
ALPHA = built_in.GENERALIZED_ALPHA.name
CENTRAL = built_in.CENTRAL_DIFFERENCE.name

#: Further subjects of verification; the last two are methods for steady states.
_OTHERS = ("equilibrium", "modes", "shooting", "harmonic_balance")

#: Methods that find steady states.
SHOOTING, HARMONIC_BALANCE = _OTHERS[2:]


def subjects() -> tuple[str, ...]:
    """Return all that can be verified: methods of `simulate`, `equilibrium`, `modes`, methods of steady states."""
    return (*(method.name for method in methods() if not method.special), *_OTHERS)


@dataclass(frozen=True)
class Quantity:
    """A quantity with its right value."""

    name: str  #: Name of the quantity, with its unit in brackets.
    reference: float
    relative: bool = True  #: Whether errors count relative to the reference.
    #: The tolerance, for all methods or by method: a method that is not named is not compared. Without it the tolerance
    #: is that of the method.
    tolerance: float | Mapping[str, float] | None = None

    def error(self, got: float) -> float:
        """Return the error of a value."""
        difference = abs(got - self.reference)
        return difference / abs(self.reference) if self.relative else difference

    def within(self, method: str, usual: float) -> float | None:
        """Return the tolerance for a method, by default the usual one of that method; None where it is not compared."""
        if isinstance(self.tolerance, Mapping):
            return self.tolerance.get(method)
        return usual if self.tolerance is None else self.tolerance


@dataclass(frozen=True)
class How:
    """How a method is run on a case, and what is expected of it."""

    tolerance: float = 0.0  #: Tolerance of the quantities that have none of their own.
    options: Mapping[str, Any] = field(default_factory=dict)  #: Further arguments of `simulate`, such as dt.
    expected: Verdict = "passed"  #: But not "FAILED".
    says: str = ""  #: Regular expression that the error message, or one of the notes, must match.
    slow: bool = False  #: Left out in quick runs.
    may_refuse: bool = False  #: Whether the method may refuse the case instead, whatever is expected of it otherwise.


class Run:
    """The runs of one method for one case, with all their notes."""

    def __init__(self, method: str, options: Mapping[str, Any]) -> None:
        self.method = method
        self.options = options
        self.notes: list[str] = []

    def simulate(self, scene: Scene, t_end: float, **more: Any) -> Result:
        """Simulate with the method and its options."""
        result = simulate(scene, t_end, method=self.method, **{**self.options, **more})
        self.notes += result.notes
        return result

    def equilibrium(self, scene: Scene) -> Equilibrium:
        """Return the equilibrium at t = 0."""
        outcome = equilibrium(scene)
        self.notes += outcome.notes
        return outcome

    def modes(self, scene: Scene, count: int, closed: tuple[str, ...] = ()) -> Modes:
        """Return vibration modes."""
        return modes(scene, count, closed=closed)

    def periodic(self, scene: Scene, **more: Any) -> PeriodicOrbit:
        """Return a steady state by the method, with its options."""
        orbit = periodic(scene, method=self.method, **{**self.options, **more})
        self.notes += orbit.notes
        return orbit

    def continuation(self, build: Callable[[float], Scene], start: float, stop: float, **more: Any) -> Branch:
        """Return a branch of steady states by the method, with its options."""
        branch = continuation(build, start, stop, method=self.method, **{**self.options, **more})
        self.notes += branch.notes
        return branch


@dataclass(frozen=True, eq=False)
class Case:
    """A case of the catalogue."""

    number: int | None  #: Number of a hard case; None for a published one.
    name: str  #: Unique.
    source: str  #: Closed form, independent program, or test case and address of a publication.
    quantities: tuple[Quantity, ...]
    measure: Callable[[Run], Mapping[str, float]]  #: Takes a `Run`, returns values by the names of the quantities.
    how: Mapping[str, How]  #: By method; those that have nothing to do with the case are absent.

    @property
    def label(self) -> str:
        """Number and name."""
        return self.name if self.number is None else f"{self.number}. {self.name}"

    def hows(self) -> dict[str, How]:
        """Return how all methods are run, those that were registered from outside this package included.

        Of these the same is expected as of energy_conserving at its step or, without steps, of event_driven, except
        that they may refuse the case.
        """
        found = dict(self.how)
        for method in methods():
            like = self.how.get(counterpart(method.name))
            if method.name not in DYNAMIC and not method.special and like is not None:
                found[method.name] = replace(like, may_refuse=True)
        return found


def counterpart(method: str) -> str:
    """Return the method of this package whose tolerances hold for a method: of one of its own, itself."""
    if method in (*DYNAMIC, *_OTHERS):
        return method
    return CONSERVING if method_named(method).steps else EVENT_DRIVEN


def stepping(dt: float, tolerance: float = 0.0, **more: Any) -> dict[str, How]:
    """Return how all stepping methods are run where they need the same step and reach the same tolerance."""
    return {method: How(tolerance, {"dt": dt}, **more) for method in (CONSERVING, ALPHA, CENTRAL)}


def every(tolerance: float = 0.0, **more: Any) -> dict[str, How]:
    """Return how all methods are run that say of themselves how long their steps are."""
    return {method: How(tolerance, **more) for method in DYNAMIC}


def exact(tolerance: float = 0.0, **more: Any) -> dict[str, How]:
    """Return how event_driven is run."""
    return {EVENT_DRIVEN: How(tolerance, **more)}


def on_stop(
    mass: Mass, gap: float, stiffness: float, start: tuple[float, float] | None = None, *more: Any,
    side: Literal["below", "above"] = "above", damping: float = 0.0,
) -> Scene:  # fmt: skip
    """Return a mass before an elastic stop that is named "stop", with further effects, from a state in m and m/s."""
    stop = Contact(mass, gap=gap, stiffness=stiffness, damping=damping, side=side, acts_on="penetration", name="stop")
    return Scene([mass], [stop, *more], initial=None if start is None else {mass: start})
