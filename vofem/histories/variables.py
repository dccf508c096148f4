"""The histories of a run as named variables with units, for xarray and for files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.bodies.base import Body
from vofem.effects.two_points import units_of
from vofem.histories.run import Run
from vofem.lookup import rows_over
from vofem.system import CLOSED

#: All rows of a variable.
ALL = slice(None)

#: For every quantity of a point: its name, its name in `Samples`, its unit.
MOTION = (("displacement", "q", "m"), ("velocity", "v", "m/s"), ("acceleration", "a", "m/s^2"))

ENERGIES = ("kinetic", "strain", "contact", "dissipated", "work")


@dataclass(frozen=True)
class Variable:
    """One variable; its first dimension is time, or what it is counted by."""

    dims: tuple[str, ...]  #: Names of the dimensions.
    source: NDArray | Callable[[slice], NDArray]  #: The values, or a function that returns those of a slice of rows.
    attributes: dict[str, Any] = field(default_factory=dict)  #: Unit and description, as netCDF calls them.
    each: Sequence[str] = ()  #: The units of the columns, where they may differ.

    def unit(self, k: int) -> str:
        """Return the unit of a column."""
        return str(self.each[k] if self.each else self.attributes.get("units", ""))

    def at(self, rows: slice = ALL) -> NDArray:
        """Return the values of some rows."""
        return self.source(rows) if callable(self.source) else self.source[rows]


def motion_and_contacts(run: Run, points: dict[str, Any]) -> dict[str, Variable]:
    """Return the motion of some points and the histories of contacts and of sliders."""
    found = (_motion(run, points) if points else {}) | (_contacts(run) if run.contacts else {})
    return found | (_frictions(run) if run.frictions else {})


def histories(run: Run, points: dict[str, Any]) -> dict[str, Variable]:
    """Return everything along a run, with the motion of some points, by the names of xarray and of files."""
    events = run.solution.events
    found = {"time": Variable(("time",), run.times, {"units": "s", "long_name": "time"})}
    found |= motion_and_contacts(run, points)
    if run.springs:
        found |= _springs(run)
    for name in ENERGIES:
        found[f"{name}_energy"] = Variable(("time",), getattr(run.energy, name), {"units": "J"})
    for name, values, words in (
        ("time", events.time, {"units": "s"}),
        ("contact", events.contact, {"long_name": "number of the contact"}),
        ("status", events.status, {"long_name": "status entered: 0 open, 1 closed, 2 pinned"}),
    ):
        found[f"event_{name}"] = Variable(("event",), values, words)
    return found | _reactions(run) | _recorded(run)


def _motion(run: Run, points: dict[str, Any]) -> dict[str, Variable]:
    rows = rows_over(run.model, run.scene.bodies, points.values())
    found = {"point": Variable(("point",), np.array(list(points)))}

    def moved(part: slice, name: str, of: str) -> NDArray:
        if part == ALL:
            # The run computes what these points need only.
            return np.stack([getattr(run, name)(point) for point in points.values()], axis=1)
        return np.asarray(rows @ getattr(run.samples, of)[:, part]).T

    for name, of, unit in MOTION:
        found[name] = Variable(("time", "point"), partial(moved, name=name, of=of), {"units": unit})
    return found


def _contacts(run: Run) -> dict[str, Variable]:
    samples, laws = run.contact_samples, run.model.system.contacts
    assert laws is not None
    units = [contact.units for contact in run.contacts.values()]
    force, stiffness, length = (
        _common([getattr(u, what) for u in units]) for what in ("force", "stiffness", "coordinate")
    )

    def gap_function(part: slice) -> NDArray:
        if part == ALL:
            return np.stack([laws.gap_function(run.samples, k, run.times) for k in range(len(laws))], axis=1)
        return laws.coordinates(run.samples.q[:, part], run.times[part]).T - laws.gap

    over = ("time", "contact")
    return {
        "contact": Variable(("contact",), np.array(list(run.contacts))),
        "force_unit": Variable(("contact",), np.array([u.force for u in units]), {"long_name": "unit of the force"}),
        "contact_initial_status": Variable(("contact",), run.solution.events.initial),
        "contact_status": Variable(over, samples.status.T, {"long_name": "0 open, 1 closed, 2 pinned"}),
        "contact_closed": Variable(over, lambda part: samples.status.T[part] == CLOSED),
        "contact_stiffness": Variable(
            over, samples.stiffness.T, {"units": stiffness, "long_name": "K_eq"}, [u.stiffness for u in units]
        ),
        "contact_force": Variable(
            over,
            samples.force.T,
            {"units": force, "long_name": "positive pushes the bodies apart"},
            [u.force for u in units],
        ),
        "contact_gap_function": Variable(over, gap_function, {"units": length, "long_name": "penetration"}),
    }


def _frictions(run: Run) -> dict[str, Variable]:
    sliders = list(run.frictions.values())
    forces, speeds = [one.units.force for one in sliders], [f"{one.units.coordinate}/s" for one in sliders]
    status = {"long_name": "0 sticks, 1 slides with a positive slip speed, -1 with a negative one"}
    found = {"friction": Variable(("friction",), np.array([one.name for one in sliders]))}
    for what, words, each in (
        ("force", {"units": _common(forces), "long_name": "positive with the slip speed; -force acts on a"}, forces),
        ("slip_speed", {"units": _common(speeds)}, speeds),
        ("status", status, ()),
        ("dissipated", {"units": "J"}, ()),
    ):
        values = np.stack([getattr(one, what) for one in sliders], axis=1)
        found[f"friction_{what}"] = Variable(("time", "friction"), values, words, each)
    return found


def _springs(run: Run) -> dict[str, Variable]:
    springs = list(run.springs.values())
    units = [units_of(run.scene.effects, label) for group in run.model.system.recorded for label in group.labels]
    found = {
        "spring": Variable(("spring",), np.array([spring.name for spring in springs])),
        "spring_unit": Variable(("spring",), np.array([u.force for u in units]), {"long_name": "unit of the force"}),
    }
    for what, unit in (
        ("elongation", _common([u.coordinate for u in units])),
        ("force", _common([u.force for u in units])),
        ("stored", "J"),
        ("dissipated", "J"),
    ):
        values = np.stack([getattr(spring, what) for spring in springs], axis=1)
        found[f"spring_{what}"] = Variable(("time", "spring"), values, {"units": unit})
    return found


def _reactions(run: Run) -> dict[str, Variable]:
    held = [(body, x) for body in run.scene.bodies for x in _supported_places(body)]
    if not held:
        return {}
    parts = [run.reaction(body, x) for body, x in held]
    over = ("time", "support")
    return {
        "support": Variable(("support",), np.array([f"{body.name}@{x!r}" for body, x in held])),
        "reaction_force": Variable(over, np.stack([part.force for part in parts], axis=1), {"units": "N"}),
        "reaction_moment": Variable(over, np.stack([part.moment for part in parts], axis=1), {"units": "N m"}),
    }


def _supported_places(body: Body) -> list[float]:
    """Return the places of supports in m, ascending."""
    x = body.degrees_of_freedom.x[body.matrices().supported]
    return [float(place) for place in np.unique(x[~np.isnan(x)])]


def _recorded(run: Run) -> dict[str, Variable]:
    """Return what was recorded at every step, which has times of its own."""
    record = run.recorded
    if record is None:
        return {}
    found = {
        "recorded_time": Variable(("recorded_time",), record.times, {"units": "s", "long_name": "time of every step"}),
        "recorded": Variable(("recorded",), np.array(record.names), {"long_name": "points recorded at every step"}),
    }
    for name, of, unit in MOTION:
        values = getattr(record, of).T
        found[f"recorded_{name}"] = Variable(("recorded_time", "recorded"), values, {"units": unit})
    return found


def _common(units: Sequence[str]) -> str:
    """Return the unit of several things, or those that occur where it depends on the thing."""
    return " or ".join(dict.fromkeys(units))
