"""What a scene file says beside its scene: how to run it, and what to write."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import choice, one_of
from vofem.arrays import Array
from vofem.effects.kinds import AtPoint
from vofem.errors import ArgumentError
from vofem.integrators.registry import method_named, method_names
from vofem.parameters import Choice, Count, Kind, Name, Numbers, Real, declared, rule
from vofem.parameters.declared import keys_of, made_of, read, read_values, write, write_inside
from vofem.parameters.place import INVALID, Book, Invalid, Place
from vofem.simulate.methods import option_names


@declared(frozen=True)
class UniformTimes:
    """`count` times from start to stop, both included."""

    start: Annotated[float, Real("s", "First time.", least=0)]
    stop: Annotated[float, Real("s", "Last time.", above=0.0)]
    count: Annotated[int, Count("Number of times.")]

    @rule("stop", "start")
    def _stops_after_start(self) -> None:
        if self.stop < self.start:
            raise ArgumentError(f"stop is {self.stop:g} s, expected a time not before start = {self.start:g} s")

    def array(self) -> Array:
        """Return the times, shape (count,)."""
        return np.linspace(self.start, self.stop, self.count)


@dataclass(frozen=True)
class Times(Kind):
    """Times as { start, stop, count } or an array."""

    text: str = ""

    shown = "UniformTimes or array_like"
    expected = "a table { start = ..., stop = ..., count = ... } or an array of times"

    def read(self, value: Any, place: Place) -> Any:
        """Return `UniformTimes` or an array that does not decrease."""
        if isinstance(value, dict):
            return read(UniformTimes, value, place)
        if not isinstance(value, list) or not value:
            return place.expected(self.expected, value)
        times = Numbers(each=Real(least=0)).read(value, place)
        if not isinstance(times, Invalid) and np.any(np.diff(times) < 0):
            k = int(np.argmax(np.diff(times) < 0))
            return place.report(
                f"expected times that do not decrease, found {float(times[k])!r} followed by {float(times[k + 1])!r}"
            )
        return times

    def write(self, value: Any, book: Book) -> Any:
        """Return the table or the array."""
        return write_inside(value, book) if isinstance(value, UniformTimes) else Numbers().write(value, book)


@dataclass(frozen=True)
class OneOrMore(Kind):
    """One value of a kind, or an array of them; gives a tuple."""

    each: Kind
    text: str = ""

    @property
    def shown(self) -> str:  # type: ignore[override]
        """A tuple."""
        return f"tuple of {self.each.shown}"

    @property
    def expected(self) -> str:  # type: ignore[override]
        """What one is."""
        return f"{self.each.expected}, or an array of these"

    def read(self, value: Any, place: Place) -> Any:
        """Return a tuple."""
        if not isinstance(value, list):
            part = self.each.read(value, place)
            return part if isinstance(part, Invalid) else (part,)
        parts = tuple(self.each.read(part, place.index(k)) for k, part in enumerate(value))
        return INVALID if any(isinstance(part, Invalid) for part in parts) else parts

    def write(self, value: Any, book: Book) -> Any:
        """Return an array, or the value where it is one; nothing where there is none."""
        parts = [self.each.write(part, book) for part in value]
        return parts[0] if len(parts) == 1 else parts


@dataclass(frozen=True)
class MethodName(Kind):
    """The name of a method, or "auto"."""

    text: str = ""

    shown = "str"

    @property
    def expected(self) -> str:  # type: ignore[override]
        """The methods that there are."""
        return one_of(("auto", *method_names()))

    def check(self, what: str, value: Any) -> str:
        """Return the name."""
        return choice(what, value, ("auto", *method_names()))


@dataclass(frozen=True)
class KeyPath(Name):
    """The path of a key that holds a number; what stands there is checked with the whole file."""

    expected = "the path of a key, such as 'point_load[0].f.sine.omega'"


@dataclass(frozen=True)
class Options(Kind):
    """Options of a method: numbers, whole where they are written so."""

    text: str = ""

    shown = "dict"


@declared(frozen=True, eq=False)
class RunSettings:
    """The arguments of `vofem.simulate` beside the scene."""

    t_end: Annotated[float, Real("s", "Duration of the run.", above=0.0)]
    method: Annotated[str, MethodName('Name of a method; "auto" chooses one.')] = "auto"
    dt: Annotated[float | None, Real("s", "Step size of a stepping method.", above=0.0)] = None
    times: Annotated[UniformTimes | ArrayLike | None, Times("Times in s at which results are stored.")] = None
    options: Annotated[Any, Options("Options of the method.")] = None
    probes: Annotated[tuple[Any, ...], OneOrMore(AtPoint(), "Points whose motion is recorded at every step.")] = ()
    t_start: Annotated[float, Real("s", "Time of the loads at which the run begins.", least=0)] = 0.0

    @rule("times", "t_end")
    def _times_within_the_run(self) -> None:
        times = self.times
        given = () if times is None else times
        last = given.stop if isinstance(given, UniformTimes) else np.max(given, initial=0.0)
        if last > self.t_end * (1.0 + 1e-12):
            raise ArgumentError(f"times reaches to {last:g} s, beyond t_end = {self.t_end:g} s")

    @rule("options", "method")
    def _options_of_the_method(self) -> None:
        object.__setattr__(self, "options", dict(self.options or {}))
        for name in self.options:
            _check_option(name, self.method)

    @rule("dt", "method")
    def _method_has_a_step(self) -> None:
        if self.dt is not None and self.method != "auto" and not method_named(self.method).steps:
            raise ArgumentError(f"dt has no meaning for {self.method}, which has no step; remove it, or change method")

    def arguments(self) -> dict[str, Any]:
        """Return keyword arguments for `vofem.simulate`."""
        times = self.times.array() if isinstance(self.times, UniformTimes) else self.times
        given = {"t_end": self.t_end, "method": self.method, "dt": self.dt, "times": times}
        return {**given, "probes": self.probes or None, "t_start": self.t_start, **self.options}


def run_keys() -> tuple[str, ...]:
    """Return the keys of ``[run]``: those of the settings, and the options of all methods that there are."""
    return (*(name for name in keys_of(RunSettings) if name != "options"), *option_names())


def _check_option(name: str, method: str) -> None:
    """Raise `ArgumentError` if a method has no such option."""
    if name not in option_names(method):
        raise ArgumentError(f"{name} is no option of the method {method!r}; remove it, or change method")


def read_run(table: dict[str, Any], place: Place) -> Any:
    """Return the settings of a table; or report all of its faults and return `INVALID`."""
    values, bad = read_values(RunSettings, table, place, run_keys(), {"options": {}})
    if values is None:
        return INVALID
    for name in set(option_names()) & set(table):
        value = Real().read(table[name], place.key(name))
        try:
            _check_option(name, values.get("method", "auto"))
        except ArgumentError as error:
            value = INVALID if "method" in bad else place.key(name).report(str(error))
        if isinstance(value, Invalid):
            bad.add(name)
        else:
            values["options"][name] = table[name] if isinstance(table[name], int) else value
    return made_of(RunSettings, values, bad, place)


def write_run(run: RunSettings, place: Place) -> dict[str, Any]:
    """Return the table of settings without default values."""
    table = write(run, place)
    options = table.pop("options", {})
    return table | {name: v.item() if isinstance(v, np.generic) else v for name, v in options.items()}


@declared(frozen=True)
class OutputSettings:
    """What `vofem run` draws and writes."""

    history: Annotated[
        tuple[Any, ...], OneOrMore(AtPoint(), "Points whose motion is written and drawn. Without it points are chosen.")
    ] = ()
    pictures: Annotated[
        tuple[float, ...], OneOrMore(Real(least=0), "Times of side views in s. Without it a time is chosen.")
    ] = ()


@declared(frozen=True)
class RespondSettings:
    """The curve of steady states that `vofem respond` computes."""

    parameter: Annotated[
        tuple[str, ...],
        OneOrMore(
            KeyPath(),
            "Paths of keys whose numbers are the parameter, such as ``point_load[0].f.sine.omega``. Entries of arrays "
            "are counted from 0.",
        ),
    ]
    point: Annotated[Any, AtPoint("Point whose amplitude is drawn. Without it one is chosen.")] = None
    periods: Annotated[int, Count("Number of periods of the loads that an orbit takes.")] = 1
    method: Annotated[str, Choice(("auto", "shooting", "harmonic_balance"), "Method of `vofem.continuation`.")] = "auto"
    harmonics: Annotated[int | None, Count("Number of harmonics for harmonic balance.")] = None
