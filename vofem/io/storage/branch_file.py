"""Branches and loci of steady states in one file: states and multipliers of orbits, scenes as texts of scene files."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, astuple
from functools import cache, cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.polynomial import Polynomial

from vofem.arrays import Array
from vofem.errors import ArgumentError, ConvergenceError, MissingCallableError, SceneFileError
from vofem.files.hdf5 import BRANCH, LOCUS, checked_group, mark_format, writing
from vofem.files.whole import target
from vofem.io.scenes.scene_text import read_tables, scene_to_toml
from vofem.io.storage.tree import read_tree, write_tree
from vofem.parameters import changed
from vofem.parameters.place import Book
from vofem.scene import Scene
from vofem.studies.steady import Branch, BranchCounters, Locus, PeriodicOrbit, SpecialPoint
from vofem.studies.steady.condensed import condensed
from vofem.studies.steady.following.family import Family, Interval, problem_of
from vofem.studies.steady.following.follow import Follower
from vofem.studies.steady.harmonic.balance import harmonics_in
from vofem.studies.steady.orbit import OrbitSource, OrbitTruncation
from vofem.studies.steady.segments.near import signature_at
from vofem.studies.steady.segments.shooting import orbit_result
from vofem.studies.steady.segments.signature import CLOSES
from vofem.studies.steady.steady_state import as_guess
from vofem.system import State

SUFFIXES = (".h5", ".hdf")

#: Degree of polynomials by which numbers of scenes may depend on the parameter, and their relative rounding.
_DEGREE, _ROUNDING = 4, 1e-13

#: Relative difference below which two orbits are the same.
_SAME = 1e-8

_AGAIN = "follow the branch again with vofem.continuation"

#: Version of the format. It is increased when this version could not read the new files.
FORMAT = 4


def save(curve: Branch | Locus, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
    """Write a branch or a locus to one file; see `vofem.Branch.save`.

    That a scene has no text, such as one with Python functions, is noted in the file and at the curve.
    """
    goal = target(path, SUFFIXES)
    own: dict[str, Any]
    if isinstance(curve, Branch):
        own, listed = {"periods": int(curve.periods)}, list(curve.orbits)
    else:
        own, listed = {"kind": curve.kind, "contact": curve.contact}, []
    orbits = _orbits([*listed, *(point.orbit for point in curve.special)])
    notes = list(curve.notes)
    problem = next(filter(None, orbits["problems"]), "")
    if problem:
        why = " ".join(problem.split())
        notes.append(f"the file {goal.name} holds the numbers of orbits, but not their motion: {why}")
    record = {
        "values": curve.values,
        "special": [(s.kind, float(s.value), s.contact, float(s.place), float(s.other)) for s in curve.special],
        "counters": asdict(curve.counters),
        "notes": notes,
        "interrupted": curve.interrupted,
        "orbits": orbits,
        **own,
    }
    with writing(goal, overwrite=overwrite) as blocks:
        group = blocks.file.create_group(BRANCH if isinstance(curve, Branch) else LOCUS, track_order=True)
        mark_format(group, FORMAT)
        write_tree(group, record)
    curve.notes[:] = dict.fromkeys(notes)
    return goal


def _orbits(orbits: Sequence[PeriodicOrbit]) -> dict[str, Any]:
    """Return what is kept of orbits; those of one branch have the same numbers of unknowns and multipliers."""
    texts, problems = [], []
    for orbit in orbits:
        try:
            texts.append(scene_to_toml(orbit.scene, whole=True))
            problems.append("")
        except SceneFileError as error:
            texts.append("")
            problems.append(str(error))
    starts = [orbit.start for orbit in orbits if orbit.start is not None]
    known = len(starts) == len(orbits) > 0
    return {
        "scenes": texts,
        "problems": problems,
        "method": [orbit.method for orbit in orbits],
        **{name: np.array([getattr(orbit, name) for orbit in orbits])
           for name in ("omega", "periods", "residual", "autonomous")},
        "stable": [orbit.stable for orbit in orbits],
        "notes": [list(orbit.notes) for orbit in orbits],
        "multipliers": [orbit.multipliers for orbit in orbits],
        "truncation": [None if orbit.truncation is None else list(astuple(orbit.truncation)) for orbit in orbits],
        "unknowns": [orbit.unknowns for orbit in orbits],
        "q": np.array([start.q for start in starts]) if known else None,
        "v": np.array([start.v for start in starts]) if known else None,
    }  # fmt: skip


def read(file: h5py.File) -> Branch | Locus:
    """Return the branch or locus in a file that is open; see `vofem.load`."""
    record = read_tree(checked_group(file, (BRANCH, LOCUS), FORMAT, "a branch or a locus"))
    folder = Path(file.filename).parent
    kept = record["orbits"]
    orbits = [_orbit(kept, k, folder) for k in range(len(kept["method"]))]
    count = len(orbits) - len(record["special"])
    special = [
        SpecialPoint(kind, value, orbit, contact, place, other)
        for orbit, (kind, value, contact, place, other) in zip(orbits[count:], record["special"], strict=True)
    ]
    values: Any = record["values"]
    shared: dict[str, Any] = {name: record[name] for name in ("notes", "interrupted")}
    shared |= {"values": values, "special": special, "counters": BranchCounters(**record["counters"])}
    if LOCUS in file:
        return Locus(kind=record["kind"], contact=record["contact"], **shared)
    free = bool(np.any(kept["autonomous"]))
    source = None if free else _Loaded(kept, values, special, orbits[:count], folder)
    return Branch(orbits=orbits[:count], periods=record["periods"], _source=source, **shared)


def _orbit(kept: dict[str, Any], k: int, folder: Path) -> PeriodicOrbit:
    """Return orbit k of a file, whose scene is read when it is first needed."""
    periods, method = int(kept["periods"][k]), kept["method"][k]
    omega, unknowns = float(kept["omega"][k]), kept["unknowns"][k]
    left_out = kept["truncation"][k]
    truncation = None if left_out is None else OrbitTruncation(*left_out)
    start = None if kept["q"] is None else State(kept["q"][k], kept["v"][k])

    @cache
    def scene() -> Scene:
        return _scene(kept["scenes"][k], kept["problems"][k], folder)

    @cache
    def problem() -> Any:
        harmonics = harmonics_in(scene(), unknowns.size) if method == "harmonic_balance" else None
        found = problem_of("load", scene(), method, periods, period=2.0 * np.pi / omega, harmonics=harmonics)
        return as_guess(found, orbit)

    def result() -> Any:
        if start is None:
            return problem().orbit(unknowns, problem().evaluate(unknowns)).result
        duration = 2.0 * np.pi * periods / omega
        if truncation is None:
            return orbit_result(scene(), start, duration)
        few = condensed(scene().model.system, unknowns.size // 2, None)
        return orbit_result(scene(), start, duration, few, truncation.error)

    @cache
    def motion() -> Any:
        if start is None:
            return result().solution.motion
        chart, y = signature_at(problem(), problem().from_orbit(orbit))
        return chart.evaluate(problem(), y, derivative=False)

    orbit = PeriodicOrbit(
        OrbitSource(
            scene,
            motion,
            result,
            lambda: kept["multipliers"][k],
            stable=lambda: kept["stable"][k],
            truncation=lambda: truncation,
        ),
        method,
        omega,
        periods,
        residual=float(kept["residual"][k]),
        remarks=list(kept["notes"][k]),
        unknowns=unknowns,
        autonomous=bool(kept["autonomous"][k]),
        start=start,
    )
    return orbit


def _scene(text: str, problem: str, folder: Path, content: dict[str, Any] | None = None) -> Scene:
    """Return the scene of an orbit from its text, or from changed content of the same order."""
    if not text:
        raise MissingCallableError(
            f"the scene of this orbit could not be written to the file, so its motion is not known: {problem}; {_AGAIN}"
        )
    book = Book(folder)
    scene, _, _ = read_tables(tomllib.loads(text) if content is None else content, text, book)
    if book.problems or scene is None:
        raise SceneFileError("the scene of an orbit", book.problems)
    return scene


class _Loaded:
    """Finds further orbits of a branch from a file; see `branch.Source`.

    `kept`: what the file holds of the orbits.
    `values` has shape (n_points,).
    """

    def __init__(
        self,
        kept: dict[str, Any],
        values: Array,
        special: list[SpecialPoint],
        orbits: Sequence[PeriodicOrbit],
        folder: Path,
    ) -> None:
        self._kept, self._values, self._special, self._orbits, self._folder = kept, values, special, orbits, folder

    @cached_property
    def _numbers(self) -> dict[tuple[Any, ...], Polynomial]:
        """The numbers of the scenes that change, by their place in the tables, as polynomials in the parameter."""
        count = self._values.size
        texts = self._kept["scenes"][:count]
        if not all(texts):
            _scene("", next(p for p in self._kept["problems"] if p), self._folder)
        tables = [dict(_leaves(tomllib.loads(text), ())) for text in texts]
        found: dict[tuple[Any, ...], Polynomial] = {}
        for place in dict.fromkeys(place for table in tables for place in table):
            # A scene leaves a number out that is the default.
            known = [k for k, table in enumerate(tables) if place in table]
            entries = [tables[k][place] for k in known]
            if entries.count(entries[0]) == count:
                continue
            path = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place).lstrip(".")
            if any(isinstance(entry, bool) or not isinstance(entry, int | float) for entry in entries):
                raise ArgumentError(f"at: {path} of the scenes changes along the branch and is no number; {_AGAIN}")
            at, numbers = self._values[known], np.array(entries, dtype=float)
            highest = _DEGREE if len(known) == count else min(_DEGREE, len(known) - 2)
            for degree in range(1, highest + 1):
                fitted = Polynomial.fit(at, numbers, degree)
                if np.max(np.abs(fitted(at) - numbers)) <= _ROUNDING * np.max(np.abs(numbers)):
                    found[place] = fitted
                    break
            else:
                raise ArgumentError(
                    f"at: {path} of the scenes is no polynomial in the branch's parameter up to degree "
                    f"{_DEGREE}, so the file does not tell it between its orbits; {_AGAIN}"
                )
        return found

    def build(self, value: float) -> Scene:
        """Return the scene at a value of the parameter."""
        nearest = int(np.argmin(np.abs(self._values - value)))
        text = self._kept["scenes"][nearest]
        if self._values[nearest] == value:
            return _scene(text, self._kept["problems"][nearest], self._folder)
        numbers = {place: float(number(value)) for place, number in self._numbers.items()}
        return _scene(text, "", self._folder, changed(tomllib.loads(text), numbers))

    def at(self, value: float) -> list[PeriodicOrbit]:
        """Return all orbits at a value of the parameter, from their neighbours in the file."""
        points = [(float(k), self._values[k], orbit) for k, orbit in enumerate(self._orbits)]
        points += [(s.place, s.value, s.orbit) for s in self._special if s.kind in ("fold", "branch_point")]
        points.sort(key=lambda point: point[0])
        found: list[tuple[Array, PeriodicOrbit]] = []
        for (_, low, before), (_, high, after) in pairwise(points):
            if (low - value) * (high - value) > 0.0 or low == high:
                continue
            orbit = self._between(before, after, (value - low) / (high - low), value)
            unknowns = orbit.unknowns
            assert unknowns is not None
            if not any(np.linalg.norm(unknowns - one) <= _SAME * np.linalg.norm(one) for one, _ in found):
                found.append((unknowns, orbit))
        return [orbit for _, orbit in found]

    def _between(self, before: PeriodicOrbit, after: PeriodicOrbit, share: float, value: float) -> PeriodicOrbit:
        """Return the orbit at a value between two neighbours, by Newton's method from both of them."""
        nearest = before if share < 0.5 else after
        unknowns = nearest.unknowns
        harmonics = None
        if nearest.method == "harmonic_balance":
            assert unknowns is not None
            harmonics = harmonics_in(nearest.scene, unknowns.size)
        interval = Interval(float(self._values.min()), float(self._values.max()))
        family = Family("at", self.build, interval, nearest.method, nearest.periods, harmonics)
        problem = as_guess(family.at(value), nearest)
        family.begin_with(problem, value)
        ends = [problem.from_orbit(orbit) for orbit in (before, after)]
        guess = ends[0] + share * (ends[1] - ends[0])
        walker = Follower(family)
        for start in (guess, *ends):
            try:
                point = walker.begin(start, value)
                orbit = point.orbit()
            except ConvergenceError:
                continue
            if orbit.residual <= CLOSES:
                return orbit
        raise ConvergenceError(f"at: no orbit is found at {value:g} from the neighbours in the file; {_AGAIN}")

    def switch(self, special: SpecialPoint) -> Branch:
        """Refuse."""
        raise ArgumentError(f"switch: a file does not hold the equations of special points; {_AGAIN}")


def _leaves(table: Any, place: tuple[Any, ...]) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Yield places and values of all entries of nested tables and arrays."""
    entries: Any = table.items() if isinstance(table, dict) else enumerate(table) if isinstance(table, list) else None
    if entries is None:
        yield place, table
        return
    for key, entry in entries:
        yield from _leaves(entry, (*place, key))
