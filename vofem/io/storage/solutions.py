"""The solution of an integrator in a file: all data of a `Result` except for the samples of the history."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import h5py

from vofem.errors import ArgumentError
from vofem.files.hdf5 import Blocks
from vofem.histories import Energy
from vofem.integrators.base import Energies, Samples, Solution
from vofem.integrators.event_driven.segment import Segments
from vofem.integrators.stepped import SteppedSolution
from vofem.io.storage.blocks import write_rows
from vofem.io.storage.tree import read_array, write_array
from vofem.result import Result
from vofem.system import Events

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
    from vofem.integrators.event_driven.lifted import TruncatedSolution

    if isinstance(solution, TruncatedSolution):
        kept = ["vectors", "truncation", "tolerance", "beams"]
        lifted = {name: getattr(solution, name) for name in kept}
        return {"kind": "truncated", "reduced": solution_record(solution.reduced), **lifted}
    if not isinstance(solution, EventSolution):
        raise ArgumentError(
            f"save: this result holds a {type(solution).__name__}, for which files of runs have no place; expected the "
            "result of vofem.simulate, or of an orbit by shooting. An orbit by harmonic balance is saved with its "
            "branch, vofem.continuation(...).save('branch.h5'), or as a run that starts from it: "
            "vofem.simulate(scene, orbit.period, initial=orbit).save(...)"
        )
    names = ("space", "t_end", "counters", "notes")
    record = {"kind": "event_driven", "system": solution.given, **{name: getattr(solution, name) for name in names}}
    # Growth of disturbances that was not computed before saving is computed when it is asked for.
    return record | {"sensitivity": solution.__dict__.get("sensitivity")}


def write_segments(blocks: Blocks, group: h5py.Group, solution: Any) -> None:
    """Write begin, duration, state and gap functions of every segment of an event-driven run."""
    segments = solution.segments
    write_array(group, "starts", segments.starts)
    write_array(group, "durations", segments.durations)
    for name in ("status", "displacement", "velocity", "gaps"):
        write_rows(blocks, group, name, getattr(segments, name))


def restored_solution(
    record: dict[str, Any], group: h5py.Group, samples: Samples, energy: Energy, events: Events, times: Any
) -> Solution:
    """Return the solution from its record and the data that are stored separately."""
    kind = record.pop("kind")
    if kind == "stepped":
        parts = (energy.kinetic, energy.strain, energy.contact, energy.dissipated, energy.work)
        return SteppedSolution(**record, times=times, samples=samples, stored=Energies(*parts), events=events)
    from vofem.integrators.event_driven import EventSolution

    if kind == "truncated":
        from vofem.integrators.event_driven.lifted import TruncatedSolution

        reduced: Any = restored_solution(record.pop("reduced"), group, samples, energy, events, times)
        return TruncatedSolution(reduced, times=times, **record)
    sensitivity = record.pop("sensitivity")
    rows = group["segments"]
    segments = Segments(**{name: read_array(rows[name]) for name in Segments._fields})
    kind_of: type[EventSolution] = EventSolution
    if record["system"].sliders is not None:
        from vofem.integrators.event_driven.sliding import SlidingSolution as kind_of  # noqa: N813
    solution = kind_of.restored(**record, times=times, segments=segments, events=events)
    if sensitivity is not None:
        solution.__dict__["sensitivity"] = sensitivity
    return solution


def has_segments(result: Result) -> bool:
    """Return whether a run is a sequence of segments."""
    return not isinstance(result.solution, SteppedSolution)
