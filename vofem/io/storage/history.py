"""The group ``history`` of a saved run: arrays over time in the form of a netCDF-4 file.

Dimensions are HDF5 dimension scales, so ``xarray.open_dataset(path,
group="history", engine="h5netcdf")`` and the netCDF library read it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from vofem.bodies.base import Body, Point
from vofem.effects.two_points import Units, units_of
from vofem.files.hdf5 import FILTERS, Blocks
from vofem.histories import Energy
from vofem.integrators.base import ContactSamples, ProbeSamples, Samples
from vofem.io.run_pictures import points_of_interest
from vofem.io.storage.blocks import read_columns, stream_columns, write_columns
from vofem.io.storage.tree import read_array
from vofem.lookup import rows_over
from vofem.result import Result
from vofem.system import Events

Array = NDArray[np.float64]

#: For every quantity of a point: its name in the file, its name in `Samples`, its unit.
_MOTION = (("displacement", "q", "m"), ("velocity", "v", "m s-1"), ("acceleration", "a", "m s-2"))

_ENERGIES = ("kinetic", "strain", "contact", "dissipated", "work")


@dataclass(frozen=True)
class History:
    """The arrays that are read back.

    Attributes
    ----------
    times : ndarray, shape (n_times,)
    samples : Samples
    contacts : ContactSamples or None
    energy : Energy
    events : Events
    recorded : ProbeSamples or None
    """

    times: Array
    samples: Samples
    contacts: ContactSamples | None
    energy: Energy
    events: Events
    recorded: ProbeSamples | None


class _Group:
    """A group in which every variable has named dimensions."""

    def __init__(self, blocks: Blocks, group: h5py.Group) -> None:
        self._blocks = blocks
        self._group = group
        self._scales: dict[str, h5py.Dataset] = {}

    def dimension(self, name: str, size: int) -> None:
        """Declare a dimension without coordinates."""
        # netCDF recognises a dimension without coordinates by this name and number.
        scale = self._group.create_dataset(name, shape=(size,), dtype=">f4")
        self._declare(name, scale, f"This is a netCDF dimension but not a netCDF variable.{size:10d}")

    def coordinate(self, name: str, values: Any, **attributes: str) -> None:
        """Write a dimension and its coordinates, numbers or strings."""
        if isinstance(values, np.ndarray):
            filters = FILTERS if values.size else {}
            scale = self._group.create_dataset(name, data=values, **filters)
        else:
            scale = self._group.create_dataset(name, data=_texts(values), dtype=h5py.string_dtype())
        self._declare(name, scale, name)
        scale.attrs.update(attributes)

    def _declare(self, name: str, scale: h5py.Dataset, label: str) -> None:
        scale.make_scale(label)
        scale.attrs["_Netcdf4Dimid"] = np.int32(len(self._scales))
        self._scales[name] = scale

    def series(self, name: str, dimension: str, values: NDArray, along: str = "time", **attributes: str) -> None:
        """Write values of shape (n, n_times) with the dimensions time, or another of times, and a further one."""
        self._attach(write_columns(self._blocks, self._group, name, values), (along, dimension), attributes)

    def products(
        self, name: str, dimension: str, rows: Any, values: NDArray, less: NDArray | None = None, **attributes: str
    ) -> None:
        """Write ``rows @ values - less`` for values of shape (n, n_times), a block of times after the other."""
        shape = rows.shape[0], values.shape[1]
        constant = 0.0 if less is None else less[:, None]
        dataset = stream_columns(
            self._blocks, self._group, name, shape, np.float64, lambda part: rows @ values[:, part] - constant
        )
        self._attach(dataset, ("time", dimension), attributes)

    def variable(self, name: str, dimension: str, values: Any, **attributes: str) -> None:
        """Write numbers or strings along one dimension."""
        if isinstance(values, np.ndarray):
            dataset = self._group.create_dataset(name, data=values, **(FILTERS if values.size else {}))
        else:
            dataset = self._group.create_dataset(name, data=_texts(values), dtype=h5py.string_dtype())
        self._attach(dataset, (dimension,), attributes)

    def _attach(self, dataset: h5py.Dataset, dimensions: tuple[str, ...], attributes: dict[str, str]) -> None:
        for axis, name in enumerate(dimensions):
            dataset.dims[axis].attach_scale(self._scales[name])
        dataset.attrs.update(attributes)
        self._blocks.flush()


def _texts(values: Sequence[str]) -> Any:
    """Return strings for HDF5, without characters that are no valid text."""
    return np.array([text.encode("utf-8", "replace").replace(b"\0", b"?") for text in values], dtype=object)


def write_history(blocks: Blocks, group: h5py.Group, result: Result) -> None:
    """Write degrees of freedom, contacts, events, energies, reactions and probes of a run."""
    file = _Group(blocks, group)
    group.attrs["title"] = f"run of vofem by {result.method}, {result.times.size} times"
    file.coordinate("time", result.times, units="s", long_name="time")
    _degrees_of_freedom(file, result)
    _probes(file, result)
    if result.recorded is not None:
        _recorded(file, result.recorded)
    _energies(file, result, group)
    if result.model.system.contacts is not None:
        _contacts(file, result)
    if result.springs:
        _springs(file, result)
    events = result.solution.events
    file.dimension("event", events.time.size)
    file.variable("event_time", "event", events.time, units="s")
    file.variable("event_contact", "event", events.contact, long_name="number of the contact")
    file.variable("event_status", "event", events.status, long_name="status entered: 0 open, 1 closed, 2 pinned")
    _reactions(file, result)


def _springs(file: _Group, result: Result) -> None:
    springs = list(result.springs.values())
    file.coordinate("spring", [spring.name for spring in springs], long_name="hysteretic spring")
    units = [units_of(result.scene.effects, spring.name) for spring in springs]
    for what, unit in (
        ("elongation", _common([u.coordinate for u in units])),
        ("force", _common([u.force for u in units])),
        ("stored", "J"),
        ("dissipated", "J"),
    ):
        values = np.array([getattr(spring, what) for spring in springs])
        file.series(f"spring_{what}", "spring", values, units=unit)
    file.variable("spring_unit", "spring", [u.force for u in units], long_name="unit of the force")


def _common(units: Sequence[str]) -> str:
    """Return the unit of several things, or those that occur where it depends on the thing."""
    return " or ".join(dict.fromkeys(units))


def _degrees_of_freedom(file: _Group, result: Result) -> None:
    names, x, kinds = [], [], []
    for body in result.scene.bodies:
        known = body.degrees_of_freedom
        names += [body.name] * body.size
        x.append(known.x)
        kinds.append(known.rotation.astype(np.int64))
    free = result.model.free
    file.dimension("dof", free.size)
    file.variable("dof_body", "dof", [names[k] for k in free])
    file.variable("dof_x", "dof", np.concatenate(x)[free], units="m", long_name="place of the node; NaN for a mass")
    file.variable("dof_kind", "dof", np.concatenate(kinds)[free], long_name="0 displacement in m, 1 slope")
    for name, words in (("q", "degrees of freedom"), ("v", "their rates"), ("a", "their second rates")):
        file.series(name, "dof", getattr(result.samples, name), long_name=words)


def _probes(file: _Group, result: Result) -> None:
    points: tuple[Point, ...] = points_of_interest(result.scene)
    file.coordinate("probe", [point.name for point in points], long_name="points that the scene names")
    rows = rows_over(result.model, result.scene.bodies, points)
    for name, of, unit in _MOTION:
        # The methods of the result are not used here, because they compute the whole field of a body at once.
        file.products(f"probe_{name}", "probe", rows, getattr(result.samples, of), units=unit)


def _recorded(file: _Group, record: ProbeSamples) -> None:
    """Write what was recorded at every step: it has times of its own."""
    file.coordinate("recorded_time", record.times, units="s", long_name="time of every step")
    file.coordinate("recorded", list(record.names), long_name="points recorded at every step")
    for name, of, unit in _MOTION:
        file.series(f"recorded_{name}", "recorded", getattr(record, of), "recorded_time", units=unit)


def _energies(file: _Group, result: Result, group: h5py.Group) -> None:
    for name in _ENERGIES:
        file.variable(f"energy_{name}", "time", getattr(result.energy, name), units="J")
    group["energy_kinetic"].attrs["total_at_start"] = result.energy.start


def _contacts(file: _Group, result: Result) -> None:
    samples = result.contact_samples
    file.coordinate("contact", list(result.contacts))
    units = [units_of(result.scene.effects, name) for name in result.contacts]
    file.variable("contact_initial_status", "contact", result.solution.events.initial)
    file.series("contact_status", "contact", samples.status, long_name="0 open, 1 closed, 2 pinned")
    file.series(
        "contact_stiffness", "contact", samples.stiffness, units=_common([_inverse(u) for u in units]), long_name="K_eq"
    )
    force = _common([u.force for u in units])
    file.series("contact_force", "contact", samples.force, units=force, long_name="positive pushes the bodies apart")
    file.variable("contact_unit", "contact", [u.force for u in units], long_name="unit of the force")
    laws = result.model.system.contacts
    assert laws is not None
    file.products(
        "contact_gap_function",
        "contact",
        laws.rows,
        result.samples.q,
        laws.gap,
        units=_common([u.coordinate for u in units]),
        long_name="penetration",
    )


def _inverse(units: Units) -> str:
    """Return the unit of a stiffness as netCDF files spell it."""
    return units.stiffness.replace("/m", " m-1").replace("/rad", " rad-1")


def _reactions(file: _Group, result: Result) -> None:
    held = [(body, x) for body in result.scene.bodies for x in _supported_places(body)]
    if not held:
        return
    file.coordinate("support", [f"{body.name}@{x!r}" for body, x in held])
    found = [result.reaction(body, x) for body, x in held]
    file.series("reaction_force", "support", np.stack([part.force for part in found]), units="N")
    file.series("reaction_moment", "support", np.stack([part.moment for part in found]), units="N m")


def _supported_places(body: Body) -> list[float]:
    """Return the places of supports in m, ascending."""
    x = body.degrees_of_freedom.x[body.matrices().supported]
    return [float(place) for place in np.unique(x[~np.isnan(x)])]


def read_history(group: h5py.Group) -> History:
    """Return the arrays of a history that a result needs."""
    contacts, initial = None, np.empty(0, dtype=np.int64)
    if "contact" in group:
        names = tuple(field.name for field in fields(ContactSamples))
        contacts = ContactSamples(*(read_columns(group[f"contact_{name}"]) for name in names))
        initial = read_array(group["contact_initial_status"])
    energies = {name: read_array(group[f"energy_{name}"]) for name in _ENERGIES}
    start = float(group["energy_kinetic"].attrs["total_at_start"])
    events = {name: read_array(group[f"event_{name}"]) for name in ("time", "contact", "status")}
    return History(
        times=read_array(group["time"]),
        samples=Samples(*(read_columns(group[name]) for name in ("q", "v", "a"))),
        contacts=contacts,
        energy=Energy(**energies, start=start),
        events=Events(**events, initial=initial),
        recorded=_read_recorded(group),
    )


def _read_recorded(group: h5py.Group) -> ProbeSamples | None:
    if "recorded" not in group:
        return None
    names = tuple(text.decode() for text in group["recorded"][()])
    motion = (read_columns(group[f"recorded_{name}"]) for name, _, _ in _MOTION)
    return ProbeSamples(names, read_array(group["recorded_time"]), *motion)
