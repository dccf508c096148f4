"""Runs cases of the catalogue and compares the results with the references."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase

from vofem._validate import nearest, one_of
from vofem.errors import ArgumentError, SingularSystemError, VofemError
from vofem.verification.case import (
    DYNAMIC,
    FAILED,
    PASSED,
    REFUSED,
    REPORTED,
    STOPPED,
    Case,
    How,
    Quantity,
    Run,
    counterpart,
    subjects,
)


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
    Raises `ArgumentError` for an unknown method.
    """
    known = subjects()
    if method is not None and method not in known:
        raise ArgumentError(f"verify: method is {method!r}, expected {one_of(known)}{nearest(method, known)}")
    return _outcomes(tuple(cases), method, quick)


def _outcomes(cases: tuple[Case, ...], method: str | None, quick: bool) -> Iterator[Outcome]:
    for case in cases:
        for name, how in case.hows().items():
            if method in (None, name) and not (quick and how.slow):
                yield judge(case, name, how)


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
