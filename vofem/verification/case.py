"""Cases of the catalogue: quantities with references, how every method is run on them, and how runs are judged."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any, Literal, get_args

from vofem._validate import choice, flag
from vofem.bodies import Mass
from vofem.effects import Contact
from vofem.errors import ArgumentError, SingularSystemError, VofemError
from vofem.integrators import methods as built_in
from vofem.integrators.registry import method_named, methods
from vofem.result import Result
from vofem.scene import Scene
from vofem.simulate.simulation import simulate
from vofem.statics import Equilibrium, equilibrium
from vofem.studies.steady import Branch, PeriodicOrbit, continuation, periodic

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


def absolute(reference: float, tolerance: float | Mapping[str, float] | None = None) -> Quantity:
    """Return a quantity, to be named by `case`, whose errors do not count relative to the reference."""
    return Quantity("", reference, False, tolerance)


def case(
    number: int | None, name: str, source: str, right: Mapping[str, float | Quantity], how: Mapping[str, How]
) -> Callable[[Callable[[Run], Iterable[float]]], Case]:
    """Make a case of a function that measures its quantities in their order.

    `right`: the right values of the quantities by their names; the errors of plain numbers are relative.
    """
    quantities = tuple(
        replace(value, name=key) if isinstance(value, Quantity) else Quantity(key, value)
        for key, value in right.items()
    )

    def make(measure: Callable[[Run], Iterable[float]]) -> Case:
        return Case(number, name, source, quantities, lambda run: dict(zip(right, measure(run), strict=True)), how)

    return make


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


@dataclass(frozen=True)
class Measured:
    """One quantity of an outcome; error and tolerance are relative where the quantity says so."""

    quantity: Quantity
    got: float
    error: float
    tolerance: float

    @property
    def good(self) -> bool:
        """Whether the error is within the tolerance; NaN is not."""
        return self.error <= self.tolerance


@dataclass(frozen=True)
class Outcome:
    """What one method made of one case."""

    case: Case
    method: str
    verdict: str  #: PASSED, REPORTED, REFUSED, STOPPED or FAILED.
    measured: tuple[Measured, ...]  #: Empty where the run ended with an error.
    message: str  #: Of the error, or the note that was asked for, or why it failed.
    seconds: float

    @property
    def worst(self) -> Measured | None:
        """The quantity whose error is largest beside its tolerance."""

        def share(m: Measured) -> float:
            if m.error == 0.0:
                return 0.0
            ratio = m.error / m.tolerance if m.tolerance else float("inf")
            return ratio if ratio == ratio else float("inf")

        return max(self.measured, key=share, default=None)


def select(cases: Iterable[Case], pattern: str | None) -> tuple[Case, ...]:
    """Return the cases whose number is a pattern, or whose label, number or source matches it.

    `pattern`: a number, a part of the name, or a pattern with * and ?; all cases where not given.
    Raises `ArgumentError` if no case matches.
    """
    cases = tuple(cases)
    if pattern is None:
        return cases
    wanted = pattern.lower()
    if wanted.isdigit():
        found = tuple(case for case in cases if case.number == int(wanted))
    else:
        glob = wanted if any(c in wanted for c in "*?[") else f"*{wanted}*"
        found = tuple(c for c in cases if fnmatchcase(c.label.lower(), glob) or fnmatchcase(c.source.lower(), glob))
    if not found:
        raise ArgumentError(
            f"verify: no case matches {pattern!r}, expected a number of a hard case, 1 to "
            f"{max(case.number or 0 for case in cases)}, or a part of a name, such as 'grazing' or 'code_aster'"
        )
    return found


def verify(cases: Iterable[Case], method: str | None = None, quick: bool = False) -> Iterator[Outcome]:
    """Run cases with every method that they name, or with one, and yield the outcomes.

    `method`: one of `case.subjects`.
    `quick`: whether slow runs are left out.
    Raises `ArgumentError` for an unknown method, and where no run is left.
    """
    quick = flag("verify: quick", quick)
    if method is not None:
        choice("verify: method", method, subjects())
    runs = [
        (case, name, how)
        for case in cases
        for name, how in case.hows().items()
        if method in (None, name) and not (quick and how.slow)
    ]
    if not runs:
        raise ArgumentError(
            "verify: no run is left of the cases that were chosen; leave out the method, the case or quick"
        )
    return (judge(*run) for run in runs)


def judge(case: Case, method: str, how: How) -> Outcome:
    """Run one method on one case."""
    run = Run(method, how.options)
    begin = time.perf_counter()
    try:
        values = case.measure(run)
    except VofemError as error:
        # Wrong arguments, scenes and steps, and structures that nothing holds, are found before the first step.
        ended = REFUSED if isinstance(error, (ArgumentError, SingularSystemError)) else STOPPED
        return Outcome(case, method, *_of_error(case, method, how, ended, str(error)), time.perf_counter() - begin)
    except Exception as error:
        message = f"{type(error).__name__}: {error}"
        return Outcome(case, method, FAILED, (), message, time.perf_counter() - begin)
    seconds = time.perf_counter() - begin
    measured = tuple(_measure(case, method, how, values))
    verdict, message = _of_values(how, measured, run.notes)
    return Outcome(case, method, verdict, measured, message, seconds)


def _of_error(case: Case, method: str, how: How, verdict: str, message: str) -> tuple[str, tuple[Measured, ...], str]:
    if verdict == REFUSED and how.may_refuse:
        return verdict, (), message
    if how.expected != verdict:
        return FAILED, (), f"{verdict}, expected {how.expected}: {message}"
    if not re.search(how.says, message):
        return FAILED, (), f"{verdict}, but the message says nothing of {how.says!r}: {message}"
    named = re.findall(r"method='(\w+)'", message)
    able = {name for name in DYNAMIC if name in case.how and case.how[name].expected in (PASSED, REPORTED)}
    if verdict == REFUSED and named and able and not able & set(named):
        return FAILED, (), f"refused, but no method that the message names passes: {message}"
    if verdict == REFUSED and method in DYNAMIC and able and not named:
        return FAILED, (), f"refused, but the message names no method that passes: {message}"
    return verdict, (), message


def _of_values(how: How, measured: tuple[Measured, ...], notes: list[str]) -> tuple[str, str]:
    if how.expected not in (PASSED, REPORTED):
        return FAILED, f"ran to its end, expected {how.expected}"
    note = next((note for note in notes if re.search(how.says, note)), None) if how.says else ""
    good = all(m.good for m in measured)
    if good and how.expected == REPORTED:
        return PASSED, note or ""
    if note is None:
        return FAILED, f"no note says {how.says!r}; there are {notes}"
    if good:
        return PASSED, note
    return (REPORTED, note) if how.expected == REPORTED else (FAILED, "beyond its tolerance")


def _measure(case: Case, method: str, how: How, values: Mapping[str, float]) -> Iterator[Measured]:
    for quantity in case.quantities:
        tolerance = quantity.within(counterpart(method), how.tolerance)
        if tolerance is not None:
            got = float(values[quantity.name])
            yield Measured(quantity, got, quantity.error(got), tolerance)
