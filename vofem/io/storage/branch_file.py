"""Branches and loci of steady states in one file: states and multipliers of orbits, scenes as texts of scene files."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import asdict, astuple
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from vofem.errors import MissingCallableError, SceneFileError
from vofem.files.hdf5 import check_format, mark_format, writing
from vofem.files.whole import target
from vofem.io.scenes.reader import read_tables
from vofem.io.scenes.writer import scene_to_toml
from vofem.io.storage.tree import read_tree, write_tree
from vofem.parameters.place import Book
from vofem.scene import Scene
from vofem.studies.steady import Branch, BranchCounters, Locus, PeriodicOrbit, SpecialPoint
from vofem.studies.steady.branch import Orbits
from vofem.studies.steady.condensed import condensed, condensed_result
from vofem.studies.steady.harmonic_balance import harmonics_in
from vofem.studies.steady.methods import problem_of
from vofem.studies.steady.orbit import OrbitTruncation
from vofem.studies.steady.shooting import orbit_result
from vofem.system import State

SUFFIXES = (".h5", ".hdf")

#: Names of the groups by which a file is known to hold a branch or a locus, and not a run.
GROUP, LOCUS = "vofem_branch", "vofem_locus"

#: Version of the format. It is increased when this version could not read the new files.
FORMAT = 3


def save(branch: Branch, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
    """Write a branch to one file; see `vofem.Branch.save`."""
    goal = target(path, SUFFIXES)
    special = branch.special
    every = [*branch.orbits, *(point.orbit for point in special)]
    record = {
        "values": branch.values,
        "special": _special(special),
        "counters": asdict(branch.counters),
        "notes": list(branch.notes),
        "periods": int(branch.periods),
        "interrupted": branch.interrupted,
        "orbits": _orbits(every, goal.parent),
    }
    return _written(goal, GROUP, record, overwrite)


def save_locus(locus: Locus, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
    """Write a locus to one file; see `vofem.Locus.save`."""
    goal = target(path, SUFFIXES)
    record = {
        "values": locus.values,
        "kind": locus.kind,
        "contact": locus.contact,
        "special": _special(locus.special),
        "counters": asdict(locus.counters),
        "notes": list(locus.notes),
        "interrupted": locus.interrupted,
        "orbits": _orbits([point.orbit for point in locus.special], goal.parent),
    }
    return _written(goal, LOCUS, record, overwrite)


def holds(file: h5py.File) -> str:
    """Return what a file that is open holds: "branch", "locus", or nothing of the two."""
    return "branch" if GROUP in file else "locus" if LOCUS in file else ""


def _written(goal: Path, group: str, record: dict[str, Any], overwrite: bool) -> Path:
    with writing(goal, overwrite=overwrite) as blocks:
        own = blocks.file.create_group(group, track_order=True)
        mark_format(own, FORMAT)
        write_tree(own, record)
    return goal


def _special(points: Sequence[SpecialPoint]) -> list[Any]:
    return [(s.kind, float(s.value), s.contact, float(s.place), float(s.other)) for s in points]


def _orbits(orbits: Sequence[PeriodicOrbit], folder: Path) -> dict[str, Any]:
    """Return what is kept of orbits; those of one branch have the same numbers of unknowns and multipliers."""
    texts, problems = [], []
    for orbit in orbits:
        try:
            texts.append(scene_to_toml(orbit.scene, folder=folder))
            problems.append("")
        except SceneFileError as error:
            texts.append("")
            problems.append(str(error))
    known = [orbit.multipliers is not None for orbit in orbits]
    starts = [orbit.start is not None for orbit in orbits]
    return {
        "scenes": texts,
        "problems": problems,
        "method": [orbit.method for orbit in orbits],
        "omega": np.array([orbit.omega for orbit in orbits]),
        "periods": np.array([orbit.periods for orbit in orbits]),
        "residual": np.array([orbit.residual for orbit in orbits]),
        "autonomous": np.array([orbit.autonomous for orbit in orbits]),
        "stable": [orbit.stable for orbit in orbits],
        "notes": [list(orbit.notes) for orbit in orbits],
        "multipliers": np.array([orbit.multipliers for orbit in orbits]) if all(known) and known else None,
        "truncation": [None if orbit.truncation is None else list(astuple(orbit.truncation)) for orbit in orbits],
        "unknowns": [orbit.unknowns for orbit in orbits],
        "q": np.array([orbit.start.q for orbit in orbits if orbit.start]) if all(starts) and starts else None,
        "v": np.array([orbit.start.v for orbit in orbits if orbit.start]) if all(starts) and starts else None,
    }


def read(file: h5py.File) -> Branch | Locus:
    """Return the branch or locus in a file that is open; see `vofem.load`."""
    own = file[GROUP if GROUP in file else LOCUS]
    check_format(own, FORMAT)
    record = read_tree(own)
    folder = Path(file.filename).parent
    kept = record["orbits"]
    makers = [_maker(kept, k, folder) for k in range(len(kept["method"]))]
    count = len(makers) - len(record["special"])
    special = [
        SpecialPoint(kind, value, makers[count + k](), contact, place, other)
        for k, (kind, value, contact, place, other) in enumerate(record["special"])
    ]
    if GROUP not in file:
        return Locus(
            record["values"],
            record["kind"],
            special,
            BranchCounters(**record["counters"]),
            contact=record["contact"],
            notes=record["notes"],
            interrupted=record["interrupted"],
        )
    return Branch(
        record["values"],
        Orbits(makers[:count]),
        special,
        BranchCounters(**record["counters"]),
        notes=record["notes"],
        periods=record["periods"],
        interrupted=record.get("interrupted", False),
    )


def _maker(kept: dict[str, Any], k: int, folder: Path) -> Callable[[], PeriodicOrbit]:
    def make() -> PeriodicOrbit:
        periods, method = int(kept["periods"][k]), kept["method"][k]
        omega, unknowns = float(kept["omega"][k]), kept["unknowns"][k]
        left_out = kept["truncation"][k]
        truncation = None if left_out is None else OrbitTruncation(*left_out)
        start = None if kept["q"] is None else State(kept["q"][k], kept["v"][k])

        @cache
        def scene() -> Scene:
            return _scene(kept["scenes"][k], kept["problems"][k], folder)

        def result() -> Any:
            if start is not None:
                duration = 2.0 * np.pi * periods / omega
                if truncation is None:
                    return orbit_result(scene(), start, duration)
                few = condensed(scene().model.system, unknowns.size // 2, None)
                return condensed_result(scene(), few, start, duration, truncation.error)
            harmonics = harmonics_in(scene(), unknowns.size) if method == "harmonic_balance" else None
            period = 2.0 * np.pi / omega
            problem = problem_of("load", scene(), method, periods, period=period, harmonics=harmonics)
            return problem.orbit(unknowns, problem.evaluate(unknowns)).result

        return PeriodicOrbit(
            scene,
            method,
            omega,
            periods,
            multipliers=None if kept["multipliers"] is None else kept["multipliers"][k],
            residual=float(kept["residual"][k]),
            result=result,
            truncation=truncation,
            notes=tuple(kept["notes"][k]),
            unknowns=unknowns,
            autonomous=bool(kept["autonomous"][k]),
            start=start,
            stable=kept["stable"][k],
        )

    return make


def _scene(text: str, problem: str, folder: Path) -> Scene:
    """Return the scene of an orbit from its text."""
    if not text:
        raise MissingCallableError(
            f"the scene of this orbit could not be written to the file, so its motion is not known: {problem}; follow "
            "the branch again with vofem.continuation"
        )
    book = Book(folder)
    scene, _, _ = read_tables(tomllib.loads(text), text, book)
    if book.problems or scene is None:
        raise SceneFileError("the scene of an orbit", book.problems)
    return scene
