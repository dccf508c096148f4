"""What a scene file says beside its scene: how to run it, and what to write."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem.errors import ArgumentError
from vofem.integrators.registry import method_named, method_names
from vofem.io.scenes.entry import Entry
from vofem.io.scenes.kinds import NOT_NEGATIVE, NUMBER, POSITIVE, Choice, Count, Numbers
from vofem.io.scenes.parts import PointByName
from vofem.io.scenes.place import INVALID, Book, Invalid, Place
from vofem.simulate.methods import option_names

Array = NDArray[np.float64]


@dataclass(frozen=True)
class UniformTimes:
    """`count` times from start to stop, both included, in s."""

    start: float
    stop: float
    count: int

    def __post_init__(self) -> None:
        if self.stop < self.start:
            raise ArgumentError(f"stop is {self.stop:g} s, expected a time not before start = {self.start:g} s")

    def array(self) -> Array:
        """Return the times, shape (count,)."""
        return np.linspace(self.start, self.stop, self.count)


@dataclass(frozen=True, eq=False)
class RunSettings:
    """The arguments of `vofem.simulate` beside the scene.

    Attributes
    ----------
    t_end : float
        Duration of the run in s.
    method : str
        Name of a method; "auto" chooses one.
    dt : float, optional
        Step size in s of a stepping method.
    times : UniformTimes or array_like, optional
        Times in s at which results are stored.
    options : dict
        Options of the method.
    probes : tuple of points
        Points whose motion is recorded at every step.
    t_start : float
        Time of the loads in s at which the run begins.
    """

    t_end: float
    method: str = "auto"
    dt: float | None = None
    times: UniformTimes | ArrayLike | None = None
    options: dict[str, Any] = field(default_factory=dict)
    probes: tuple[Any, ...] = ()
    t_start: float = 0.0

    def arguments(self) -> dict[str, Any]:
        """Return keyword arguments for `vofem.simulate`."""
        times = self.times.array() if isinstance(self.times, UniformTimes) else self.times
        given = {"t_end": self.t_end, "method": self.method, "dt": self.dt, "times": times}
        return {**given, "probes": self.probes or None, "t_start": self.t_start, **self.options}


@dataclass(frozen=True)
class OutputSettings:
    """What `vofem run` draws and writes.

    Attributes
    ----------
    history : tuple of points
        Points whose motion is written and drawn. Without it points are chosen.
    pictures : tuple of float
        Times of side views in s. Without it a time is chosen.
    """

    history: tuple[Any, ...] = ()
    pictures: tuple[float, ...] = ()


@dataclass(frozen=True)
class RespondSettings:
    """The curve of steady states that `vofem respond` computes.

    Attributes
    ----------
    parameter : tuple of str
        Paths of keys whose numbers are the parameter, such as ``point_load[0].f.sine.omega``. Entries of arrays are
        counted from 0.
    point : point, optional
        Point whose amplitude is drawn. Without it one is chosen.
    periods : int
        Number of periods of the loads that an orbit takes.
    method : str
        Method of `vofem.continuation`.
    harmonics : int, optional
        Number of harmonics for harmonic balance.
    """

    parameter: tuple[str, ...]
    point: Any = None
    periods: int = 1
    method: str = "auto"
    harmonics: int | None = None


class Path:
    """The path of a key that holds a number."""

    expected = "the path of a key, such as 'point_load[0].f.sine.omega'"
    stand_ins = ()

    def read(self, value: Any, place: Place) -> Any:
        """Return the path; what stands there is checked with the whole file."""
        return value if isinstance(value, str) and value else place.expected(self.expected, value)

    def write(self, value: Any, book: Book) -> Any:
        """Return the path."""
        return value


class Times:
    """Times as { start, stop, count } or an array."""

    expected = "a table { start = ..., stop = ..., count = ... } or an array of times"
    stand_ins = ()

    def read(self, value: Any, place: Place) -> Any:
        """Return `UniformTimes` or an array that does not decrease."""
        if isinstance(value, dict):
            return _UNIFORM.read(value, place)
        times = Numbers(self.expected, NOT_NEGATIVE).read(value, place)
        if not isinstance(times, Invalid) and np.any(np.diff(times) < 0):
            k = int(np.argmax(np.diff(times) < 0))
            return place.report(f"expected times that do not decrease, found {times[k]!r} followed by {times[k + 1]!r}")
        return times

    def write(self, value: Any, book: Book) -> Any:
        """Return the table or the array."""
        return _UNIFORM.write_inside(value, book) if isinstance(value, UniformTimes) else Numbers().write(value, book)


@dataclass(frozen=True)
class OneOrMore:
    """One value of a kind, or an array of them; gives a tuple."""

    each: Any
    stand_ins: ClassVar[tuple[Any, ...]] = ((),)

    @property
    def expected(self) -> str:
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
        """Return an array, or the value where it is one."""
        parts = [self.each.write(part, book) for part in value]
        return parts[0] if len(parts) == 1 else parts


class Option:
    """An option of a method: a number, whole where it is written so."""

    expected = "a number"
    stand_ins = (1,)

    def read(self, value: Any, place: Place) -> Any:
        """Return an int or a float; the method checks the rest."""
        number = NUMBER.read(value, place)
        return value if isinstance(value, int) and not isinstance(number, Invalid) else number

    def write(self, value: Any, book: Book) -> Any:
        """Return an int or a float."""
        return value.item() if isinstance(value, np.generic) else value


def _run(
    t_end: float, method: str = "auto", dt: Any = None, times: Any = None, probes: Any = (), t_start: float = 0.0,
    **options: Any,
) -> RunSettings:  # fmt: skip
    last = times.stop if isinstance(times, UniformTimes) else times[-1] if times else 0.0
    if last > t_end * (1.0 + 1e-12):
        raise ArgumentError(f"times reaches to {last:g} s, beyond t_end = {t_end:g} s")
    for name in options:
        if name not in option_names(method):
            raise ArgumentError(f"{name} is no option of the method {method!r}; remove it, or change method")
    if dt is not None and method != "auto" and not method_named(method).steps:
        raise ArgumentError(f"dt has no meaning for {method}, which has no step; remove it, or change method")
    return RunSettings(t_end, method, dt, times, options, probes, t_start)


def _run_values(run: RunSettings) -> dict[str, Any]:
    given = {"t_end": run.t_end, "method": run.method, "dt": run.dt, "times": run.times, "probes": run.probes}
    return {**given, "t_start": run.t_start, **run.options}


_UNIFORM = Entry("times", UniformTimes, {"start": NOT_NEGATIVE, "stop": POSITIVE, "count": Count()})


def run_entry() -> Entry:
    """Return how ``[run]`` stands in a scene file, for the methods that there are."""
    return Entry(
        "run",
        RunSettings,
        {
            "t_end": POSITIVE,
            "method": Choice(("auto", *method_names())),
            "dt": POSITIVE,
            "times": Times(),
            "probes": OneOrMore(PointByName()),
            "t_start": NOT_NEGATIVE,
            **{name: Option() for name in option_names()},
        },
        build=_run,
        values=_run_values,
        optional=option_names(),
    )


OUTPUT = Entry("output", OutputSettings, {"history": OneOrMore(PointByName()), "pictures": OneOrMore(NOT_NEGATIVE)})

#: How ``[respond]`` stands in a scene file.
RESPOND = Entry(
    "respond",
    RespondSettings,
    {
        "parameter": OneOrMore(Path()),
        "point": PointByName(),
        "periods": Count(),
        "method": Choice(("auto", "shooting", "harmonic_balance")),
        "harmonics": Count(),
    },
)
