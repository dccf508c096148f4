"""The group ``history`` of a saved run: its histories as a netCDF-4 file, written in blocks and read back.

``xarray.open_dataset(path, group="history", engine="h5netcdf")`` reads it. It holds the variables of
`vofem.Result.to_xarray`, for all points that the scene names, and the degrees of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import h5netcdf
import h5py
import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.files.hdf5 import FILTERS, Blocks, block_slices, chunks, texts_of
from vofem.histories import Energy
from vofem.histories.tables import named_points, points_of_interest
from vofem.histories.variables import ENERGIES, MOTION, Variable, histories
from vofem.integrators.base import ContactSamples, ProbeSamples, Samples
from vofem.result import Result
from vofem.system import Events


@dataclass(frozen=True)
class History:
    """The arrays that are read back."""

    times: Array  #: Shape (n_times,).
    samples: Samples
    contacts: ContactSamples | None
    energy: Energy
    events: Events
    recorded: ProbeSamples | None


def write_history(blocks: Blocks, result: Result) -> None:
    """Write degrees of freedom, points, contacts, springs, energies, events, reactions and probes of a run."""
    points = named_points("save", result.scene, points_of_interest(result.scene))
    found = histories(result, points) | _degrees_of_freedom(result)
    sizes = {variable.dims[0]: len(variable.at()) for variable in found.values() if len(variable.dims) == 1}
    with h5netcdf.File(blocks.file, "a") as file:
        group = file.create_group("history")
        group.attrs["title"] = f"run of vofem by {result.method}, {result.times.size} times"
        group.attrs["notes"] = "\n".join(result.notes)
        group.attrs["energy_at_start"] = result.energy.start
        group.dimensions = sizes
        for name, variable in found.items():
            _write(blocks, group, name, variable, tuple(sizes[dimension] for dimension in variable.dims))


def _write(blocks: Blocks, group: Any, name: str, variable: Variable, shape: tuple[int, ...]) -> None:
    """Write a variable, a block of rows after the other."""
    kind = variable.at(slice(0, 1)).dtype
    text, truth = kind.kind == "U", kind.kind == "b"
    dtype = h5py.string_dtype() if text else np.dtype(np.int8) if truth else kind
    filters = {} if text or not all(shape) else {"chunks": chunks(shape, dtype.itemsize), **FILTERS}
    written = group.create_variable(name, variable.dims, dtype, **filters)
    # netCDF knows no truth values; xarray reads them by this attribute.
    written.attrs.update(variable.attributes | ({"dtype": "bool"} if truth else {}))
    for rows in block_slices(shape[0], kind.itemsize * int(np.prod(shape[1:]))) if all(shape) else ():
        values = variable.at(rows)
        written[rows] = texts_of(values) if text else values.astype(dtype, copy=False)
        blocks.flush()


def _degrees_of_freedom(result: Result) -> dict[str, Variable]:
    bodies, free = result.scene.bodies, result.model.free
    known = [body.degrees_of_freedom for body in bodies]
    # The unknowns of point masses that travel come after those of the bodies.
    riders = np.full(result.model.size - sum(body.size for body in bodies), np.nan)
    names = np.repeat([*(body.name for body in bodies), ""], [*(body.size for body in bodies), riders.size])
    rotation = np.concatenate([*(part.rotation for part in known), np.zeros(riders.size)])
    place = {"units": "m", "long_name": "place of the node; NaN for a mass"}
    kind = {"long_name": "0 displacement in m, 1 slope"}
    body = {"long_name": "name of the body; empty for a point mass that travels"}
    found = {
        "dof_body": Variable(("dof",), names[free], body),
        "dof_x": Variable(("dof",), np.concatenate([*(part.x for part in known), riders])[free], place),
        "dof_kind": Variable(("dof",), rotation[free].astype(np.int64), kind),
    }
    for name, words in (("q", "degrees of freedom"), ("v", "their rates"), ("a", "their second rates")):
        values = getattr(result.samples, name)
        # The order in memory, on which the last bits of later sums depend.
        order = {"fortran": int(values.flags.f_contiguous and not values.flags.c_contiguous)}
        found[name] = Variable(("time", "dof"), values.T, {"long_name": words} | order)
    return found


def read_history(group: h5py.Group) -> History:
    """Return the arrays of a history that a result needs."""
    contacts, initial = None, np.empty(0, dtype=np.int64)
    if "contact" in group:
        contacts = ContactSamples(*(_columns(group[f"contact_{name}"]) for name in ("status", "stiffness", "force")))
        initial = group["contact_initial_status"][()]
    recorded = None
    if "recorded" in group:
        names = tuple(text.decode() for text in group["recorded"][()])
        motion = (_columns(group[f"recorded_{name}"]) for name, _, _ in MOTION)
        recorded = ProbeSamples(names, group["recorded_time"][()], *motion)
    energies = {name: group[f"{name}_energy"][()] for name in ENERGIES}
    events = {name: group[f"event_{name}"][()] for name in ("time", "contact", "status")}
    return History(
        times=group["time"][()],
        samples=Samples(*(_columns(group[name]) for name in ("q", "v", "a"))),
        contacts=contacts,
        energy=Energy(**energies, start=float(group.attrs["energy_at_start"][0])),
        events=Events(**events, initial=initial),
        recorded=recorded,
    )


def _columns(dataset: h5py.Dataset) -> NDArray:
    """Return values of shape (n, n_times) from a dataset (n_times, n), in the order in memory that they had."""
    order: Any = "F" if dataset.attrs.get("fortran") else "C"
    values = np.empty(dataset.shape[::-1], dtype=dataset.dtype, order=order)
    for rows in block_slices(dataset.shape[0], dataset.shape[1] * dataset.dtype.itemsize) if values.size else ():
        values[:, rows] = dataset[rows].T
    return values
