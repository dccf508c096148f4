"""A run as one file for ParaView, for xarray, and for `load`, which returns the `Result`.

====================  ==========================================================================
group of the file     what is in it
====================  ==========================================================================
``VTKHDF``            the fields on the grid, see `vtkhdf`
``history``           all degrees of freedom, contacts, energies, events, probes, see `history`
``vofem``             scene and solution as `load` needs them, see `records`; the scene as
                      TOML where it can be said so
====================  ==========================================================================
"""

from __future__ import annotations

import os
from dataclasses import fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from vofem._validate import array, number
from vofem.errors import ArgumentError, SceneFileError
from vofem.files.hdf5 import RUN, Blocks, checked_group, mark_format, write_rows, writing
from vofem.files.whole import refuse_existing, target, try_to_write
from vofem.histories.variables import ENERGIES
from vofem.integrators.base import Energies, Solution
from vofem.integrators.event_driven.segment import Segments
from vofem.integrators.stepped import SteppedSolution
from vofem.io.scenes.scene_text import scene_to_toml
from vofem.io.storage.history import History, read_history, write_history
from vofem.io.storage.records import decode, encoder, restored_scene, scene_record
from vofem.io.storage.tree import read_array, read_tree, write_array, write_text, write_tree
from vofem.io.storage.vtkhdf import frame_times, write_fields
from vofem.kernels.mode import kernels
from vofem.result import Result
from vofem.scene import Scene
from vofem.simulate.plan import model_at

#: Fields that the group `history` holds; the caller puts them back.
_ELSEWHERE = ("times", "samples", "stored", "events", "probes")


def solution_record(solution: Solution) -> dict[str, Any]:
    """Return a solution as nested data, without what is stored in the history or as rows of segments.

    Raises `ArgumentError` for a solution of another kind.
    """
    if isinstance(solution, SteppedSolution):
        kept = [field.name for field in fields(solution) if field.name not in _ELSEWHERE]
        return {"kind": "stepped", **{name: getattr(solution, name) for name in kept}}
    from vofem.integrators.event_driven import EventSolution

    if not isinstance(solution, EventSolution):
        raise ArgumentError(
            f"save: this result holds a {type(solution).__name__}, for which files of runs have no place; expected the "
            "result of vofem.simulate, or of an orbit by shooting. An orbit by harmonic balance is saved with its "
            "branch, vofem.continuation(...).save('branch.h5'), or as a run that starts from it: "
            "vofem.simulate(scene, orbit.period, initial=orbit).save(...)"
        )
    names = ("space", "t_end", "counters", "notes", "vectors", "truncation")
    record = {"kind": "event_driven", "system": solution.given, **{name: getattr(solution, name) for name in names}}
    # Growth of disturbances that was not computed before saving is computed when it is asked for.
    return record | {"sensitivity": solution.__dict__.get("sensitivity")}


def write_segments(blocks: Blocks, group: h5py.Group, solution: Any) -> None:
    """Write begin, duration, state and gap functions of every segment of an event-driven run."""
    segments = solution.segments
    write_array(group, "starts", segments.starts)
    write_array(group, "durations", segments.durations)
    write_array(group, "logged", segments.logged)
    for name in ("status", "displacement", "velocity", "gaps"):
        write_rows(blocks, group, name, getattr(segments, name))


def restored_solution(record: dict[str, Any], group: h5py.Group, history: History) -> Solution:
    """Return the solution from its record and the data that are stored separately."""
    times, events = history.times, history.events
    if record.pop("kind") == "stepped":
        stored = Energies(*(getattr(history.energy, name) for name in ENERGIES))
        return SteppedSolution(**record, times=times, samples=history.samples, stored=stored, events=events)
    from vofem.integrators.event_driven import EventSolution

    sensitivity, vectors, truncation = (record.pop(name) for name in ("sensitivity", "vectors", "truncation"))
    rows = group["segments"]
    segments = Segments(**{name: read_array(rows[name]) for name in Segments._fields})
    kind_of: type[EventSolution] = EventSolution
    if record["system"].sliders is not None:
        from vofem.integrators.event_driven.sliding import SlidingSolution as kind_of  # noqa: N813
    solution = kind_of.restored(**record, times=times, segments=segments, events=events)
    solution.vectors, solution.truncation = vectors, truncation
    if sensitivity is not None:
        solution.__dict__["sensitivity"] = sensitivity
    return solution


SUFFIXES = (".vtkhdf", ".h5", ".hdf")

#: Version of the format. It is increased when this version could not read the new files.
FORMAT = 5


def save(
    result: Result,
    path: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    frames: Any = None,
    magnification: float = 1.0,
) -> Path:
    """Write a run to one file; see `vofem.Result.save`."""
    if not isinstance(result, Result):
        raise ArgumentError(f"save: expected the Result of vofem.simulate, found {result!r}")
    goal = target(path, SUFFIXES)
    times = _frames(result, frames)
    magnification = number("save: magnification", magnification, positive=True)
    with writing(goal, overwrite=overwrite) as blocks:
        file = blocks.file
        # netCDF requires that groups keep the order in which their members were made.
        own = file.create_group(RUN, track_order=True)
        mark_format(own, FORMAT)
        own.attrs["method"] = result.method
        own.attrs["compiled"] = result.compiled
        _write_toml(own, result, goal)
        solution, used = solution_record(result.solution), result.t_start + result.times
        if result.solution.truncation is None:
            # `load` assembles the scene again, and shifts its loads by t_start.
            solution["system"] = None
        record = {
            "scene": scene_record(result.scene, result.samples.q, used),
            "solution": solution,
            "t_start": result.t_start,
            "start": result.start,
        }
        write_tree(own.create_group("run"), record, encoder(used))
        if not isinstance(result.solution, SteppedSolution):
            write_segments(blocks, own.create_group("segments"), result.solution)
        write_history(blocks, result)
        write_fields(blocks, file.create_group("VTKHDF"), result, times, magnification)
    return goal


def check_target(path: str | os.PathLike[str], overwrite: bool) -> None:
    """Raise the errors that `save` would raise for this name, before a long run begins.

    Raises `ArgumentError` for another suffix.
    Raises `OutputError` if the folder is missing or cannot be written, or the file exists and is not to be overwritten.
    """
    goal = target(path, SUFFIXES)
    if not overwrite:
        refuse_existing(goal)
    try_to_write(goal)


def _frames(result: Result, frames: Any) -> Any:
    if frames is None:
        return frame_times(result.times)
    if isinstance(frames, (int, np.integer)) and not isinstance(frames, bool):
        if frames < 1:
            raise ArgumentError(f"save: frames is {frames!r}, expected a number of 1 or more, or times in s")
        return frame_times(result.times, int(frames))
    chosen = np.unique(array("save: frames", frames))
    end = result.solution.t_end
    if not chosen.size or chosen[0] < 0.0 or chosen[-1] > end:
        raise ArgumentError(f"save: frames is {frames!r}, expected a number, or times from 0 to {end:g} s")
    return chosen


def _write_toml(group: h5py.Group, result: Result, goal: Path) -> None:
    """Write the scene as a scene file, or why it has none; for people, `load` does not need it."""
    try:
        text = scene_to_toml(result.scene, folder=goal.parent)
    except SceneFileError as error:
        text = "\n".join(f"# {line}" for line in str(error).splitlines()) + "\n"
    write_text(group, "scene.toml", text)


def read(file: h5py.File, scene: Scene | None = None) -> Result:
    """Return the Result that `Result.save` has written to a file that is open; see `vofem.load`."""
    own = checked_group(file, (RUN,), FORMAT, "a run that Result.save has written")
    history = read_history(file["history"])
    record = read_tree(own["run"], decode)
    scene, t_start = restored_scene(record["scene"], scene, "load", "file"), record["t_start"]
    model = model_at(scene.model, t_start)
    if record["solution"]["system"] is None:
        record["solution"]["system"] = model.system
    compiled = bool(own.attrs["compiled"])
    with kernels(compiled=compiled):
        solution = restored_solution(record["solution"], own, history)
    result = Result(
        scene, str(own.attrs["method"]), solution, history.recorded, model=model, t_start=t_start,
        start=record["start"], compiled=compiled,
    )  # fmt: skip
    # Samples in Ritz vectors are computed anew: sums in another order differ from the history in the last bits.
    if solution.truncation is None:
        result.__dict__["samples"] = history.samples
    result.__dict__["energy"] = history.energy
    if history.contacts is not None:
        result.__dict__["contact_samples"] = history.contacts
    return result
