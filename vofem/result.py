"""The result of a run: histories, counters, events and energies. Plots are in `vofem.io.plot`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import number
from vofem.arrays import Array
from vofem.assembly import Model
from vofem.cards import Shown, from_io
from vofem.errors import ArgumentError
from vofem.histories import Run, Table
from vofem.histories.impacts import window_of
from vofem.histories.table import joined
from vofem.histories.tables import history_columns, named_points
from vofem.histories.variables import ENERGIES, histories
from vofem.initial import StoredState
from vofem.integrators.base import ProbeSamples, Sensitivity, Solution, Truncation
from vofem.integrators.registry import advice
from vofem.laws import past_of
from vofem.scene import Scene
from vofem.system import CLOSED, OPEN, PINNED, Counters, State

_STATUS = {OPEN: "opens", CLOSED: "closes", PINNED: "is pinned"}


class Result(Shown, Run):
    """The outcome of `vofem.simulate`.

    Quantities are computed when they are first read. All arrays over time belong to `times`. Methods with an argument t
    accept other times within the run too. For ``event_driven`` the values there are exact. For a stepping method they
    are interpolated between neighbouring steps.

    Attributes
    ----------
    scene : Scene
        The scene that was simulated.
    method : str
        Name of the method that ran.
    times : ndarray, shape (n_times,)
        Times in s at which results are stored.
    counters : Counters
        Work done by the run.
    notes : list of str
        Sentences about the run that a user should read. The list is empty if there is nothing to say.
    recorded : ProbeSamples, optional
        Histories of the points that were named by ``probes=`` of `vofem.simulate`.
    t_start : float
        Time of the loads in s at which the run began. `times` count from there.
    start : State, optional
        State with which the run began, if it was not the scene's own initial state.
    compiled : bool
        Whether kernels ran as machine code (True) or as plain Python; see `vofem.simulate`.
    """

    def __init__(
        self,
        scene: Scene,
        method: str,
        solution: Solution,
        recorded: ProbeSamples | None = None,
        *,
        model: Model | None = None,
        t_start: float = 0.0,
        start: State | None = None,
        compiled: bool = True,
    ) -> None:
        super().__init__(scene, solution, model, t_start)
        self.method = method
        self.recorded = recorded
        self.start = start
        self.compiled = compiled

    def __repr__(self) -> str:
        count = len(self.notes)
        notes = f", {count} note{'s' * (count > 1)}: see .notes" if count else ""
        return (
            f"Result(method={self.method!r}, {self.times.size} times to {self.times[-1]:g} s, "
            f"{self.counters.steps} steps, {self.counters.events} contact events{notes})"
        )

    @property
    def counters(self) -> Counters:
        """Work done by the run."""
        return self.solution.counters

    @property
    def notes(self) -> list[str]:
        """What a user should know about the run."""
        return self.solution.notes

    @property
    def interrupted(self) -> bool:
        """Whether the run was ended by Ctrl-C before its end."""
        return any(note.startswith("interrupted at ") for note in self.notes)

    # -- the end of the run, sensitivity, truncation ----------------------------------------------

    def spring_state(self, name: str) -> Array | None:
        """Return the internal variables of a hysteretic spring at the last time, or None if there are none."""
        springs = self.solution.springs
        return None if springs is None else past_of(self.model.system.laws, springs.past, name)

    def as_start(self) -> StoredState:
        """Return the state at the last time, with which another run can start, without keeping this run in memory."""
        states = {body.name: self.state_of(body.name) for body in self.scene.bodies}
        system = self.model.system
        known = {name: self.spring_state(name) for group in system.recorded for name in group.names}
        springs = {name: state for name, state in known.items() if state is not None}
        return StoredState(states, springs, system.without_past, "Result")

    @property
    def sensitivity(self) -> Sensitivity:
        """How a small perturbation grows along an event_driven run: `times`, `growth`, `horizon(tolerance)`.

        Raises
        ------
        ArgumentError
            If the run used another method, or the scene has friction.
        """
        found = self.solution.sensitivity
        if found is None and self.model.system.sliders is not None:
            raise ArgumentError(
                f"{self.model.system.sliders.labels[0]} is in the scene, and runs with friction do not tell their "
                "sensitivity; compare the run with one whose initial state differs by 1e-10, say"
            )
        if found is None:
            raise ArgumentError(f"a run of {self.method} does not tell its sensitivity; use {advice(exact=True)}")
        return found

    @property
    def truncation(self) -> Truncation | None:
        """The number of Ritz vectors of an event_driven run and its estimated errors; None if all modes were used."""
        return self.solution.truncation

    # -- tables -----------------------------------------------------------------------------------

    def to_dataframe(self, points: Mapping[str, Any] | Iterable[Any] | None = None) -> Any:
        """Return histories as a `pandas.DataFrame` with one row for each of `times` and units in the column names.

        The columns are displacement and velocity of points, force and K_eq of contacts, force and slip speed of
        sliders, and energies.

        Parameters
        ----------
        points : dict of str to point, or points, optional
            Points whose motion is included. The default is the points of the contacts, or of other effects if there are
            no contacts, at most six points.

        Raises
        ------
        ArgumentError
            If an entry of `points` is not a point.
        """
        import pandas

        columns = history_columns(self, named_points("to_dataframe", self.scene, points))
        columns |= {f"{name} energy": (getattr(self.energy, name), "J") for name in ENERGIES}
        values = {f"{name} [{unit}]": part for name, (part, unit) in columns.items()}
        frame = pandas.DataFrame(values, index=pandas.Index(self.times, name="t [s]"))
        frame.attrs["notes"] = list(self.notes)
        return frame

    def to_xarray(self, points: Mapping[str, Any] | Iterable[Any] | None = None) -> Any:
        """Return histories as an `xarray.Dataset` over time, point and contact, with units as attributes.

        Its variables are displacement, velocity and acceleration of points; status, force, stiffness (K_eq), gap
        function and closed state of contacts; elongation, force and energies of hysteretic springs; energies; contact
        events; reactions of supports; and the motion of probes. A saved run holds the same variables in the group
        ``history``, with all degrees of freedom.

        Parameters
        ----------
        points
            The same as for `to_dataframe`.

        Raises
        ------
        ArgumentError
            If an entry of `points` is not a point.
        """
        import xarray

        found = histories(self, named_points("to_xarray", self.scene, points))
        variables = {name: (variable.dims, variable.at(), variable.attributes) for name, variable in found.items()}
        return xarray.Dataset(variables, attrs={"notes": "\n".join(self.notes)})

    def contact_events(self) -> Table:
        """Return all contact events in the order of time as a table: time in s, contact, and what it does."""
        events, names = self.solution.events, list(self.contacts)
        columns = {
            "time": (events.time, "s"),
            "contact": (np.array([names[k] for k in events.contact], dtype=str), ""),
            "event": (np.array([_STATUS[int(status)] for status in events.status], dtype=str), ""),
        }
        return Table(columns, "Contact events")

    def impacts(self, window: ArrayLike | None = None) -> Table:
        """Return the impacts of all contacts in the order of time as a table.

        The columns are those of `Impacts`, which ``contacts[...].impacts`` gives for one contact.

        Parameters
        ----------
        window : (float, float), optional
            Begin and end in s. Only impacts that begin between these times are returned.

        Raises
        ------
        ArgumentError
            If the window does not lie within the run.
        """
        begin, end = window_of("impacts", window, float(self.solution.t_end))
        table = joined((history.impacts for history in self.contacts.values()), "Impacts")
        if not table.rows:
            return table
        order = np.lexsort((table["contact"], table["closing"]))
        closing = table["closing"][order]
        return table.chosen(order[(closing >= begin) & (closing <= end)])

    def contact_statistics(self, window: ArrayLike | None = None) -> Table:
        """Return the statistics of all contacts as a table with one contact in each row.

        The columns are those of `ContactStatistics`, which ``contacts[...].statistics(...)`` gives for one contact.

        Parameters
        ----------
        window : (float, float), optional
            Begin and end of the window in s. The default is the whole run.

        Raises
        ------
        ArgumentError
            If the window does not lie within the run.
        """
        begin, end = window_of("contact_statistics", window, float(self.solution.t_end))
        found = (history.statistics((begin, end)) for history in self.contacts.values())
        return joined(found, f"Contacts from {begin:g} to {end:g} s")

    # -- frames and files -------------------------------------------------------------------------

    def frame(self, t: float, *, magnification: float = 1.0, points_per_element: int = 5) -> Any:
        """Return bodies and contacts at time t as a `pyvista.UnstructuredGrid`, with fields that can be drawn.

        Points are at rest; ``frame.warp_by_vector("deflection", factor=magnification)`` moves them. x runs along the
        beams and y points up. Every body has a plane z of its own, but for bodies that a joint ties; the points of a
        contact have the same x, and their distance is the gap.

        ===========  ==========================================================================
        point data   ``deflection`` (vector) and ``eta`` (its y) in m, ``velocity`` in m/s,
                     ``slope``, ``bending_moment`` in N m, ``shear_force`` in N (NaN where there
                     is no beam), what the `sections` of other bodies name, ``x``: the body's own
                     coordinate in m; bodies that move along their axis are displaced along x
        cell data    ``kind``: 0 beam, 1 mass, 2 contact, 3 the bar that shows a stop;
                     ``body``, ``element``, ``contact``: numbers from 0 in the order of the
                     scene, -1 for none; ``contact_state``: 0 open, 1 closed, 2 pinned, -1 no
                     contact; ``contact_force`` in N, positive pushes apart, and
                     ``contact_stiffness`` in N/m, NaN where there is no contact; in N m and
                     N m/rad of contacts that act on rotations
        field data   ``TimeValue`` in s, ``magnification``
        ===========  ==========================================================================

        Every element has its own points, so moments and shear forces jump at nodes and are averaged nowhere. A contact
        is a line from its point a to the stop, or to its point b.

        Parameters
        ----------
        t : float
            Time in s, within the run.
        magnification : float
            Factor by which gaps are drawn larger, so that bodies meet when a contact closes under a warp of the same
            factor. The data are never magnified.
        points_per_element : int
            Points of each element of a beam, from 2 to 1000.

        Returns
        -------
        pyvista.UnstructuredGrid

        Raises
        ------
        ArgumentError
            If t lies outside the run.

        Examples
        --------
        ``result.frame(0.5).warp_by_vector("deflection", factor=20).plot(scalars="bending_moment")``
        """
        t, end = number("frame: t", t), self.solution.t_end
        if not 0.0 <= t <= end * (1.0 + 1e-12):
            raise ArgumentError(f"frame: t is {t:g} s, expected a time of the run, 0 to {end:g} s")
        return from_io("frames")(self, magnification, points_per_element).at(min(t, end))

    def save(
        self,
        path: str | os.PathLike[str],
        *,
        overwrite: bool = False,
        frames: int | ArrayLike | None = None,
        magnification: float = 1.0,
    ) -> Path:
        """Write the run to one file, which ParaView and xarray can read and from which `vofem.load` restores the run.

        The file is written under a hidden name in the same folder, forced to disk
        and then renamed. So there is never an incomplete file of that name.

        Parameters
        ----------
        path : path
            Name of the file; it ends in .vtkhdf (or .h5, .hdf).
        overwrite : bool
            Whether a file of that name is replaced.
        frames : int or array_like, optional
            Frames for ParaView: how many of the run's times, or which times in s. The default is all times, but at most
            1000. Everything else is stored at all `times`.
        magnification : float
            Factor by which gaps are drawn larger in ParaView. Use the same factor as the scale factor of Warp By
            Vector, so that bodies meet their stops when contacts close. The data themselves are not magnified.

        Returns
        -------
        Path
            `path`.

        Raises
        ------
        ArgumentError
            If the suffix is another one, if frames lie outside the run, or if the scene holds
            objects of other packages that cannot be stored.
        OutputError
            If the file exists and is not to be overwritten, or cannot be written. What was there stays as it was.
        """
        return Path(from_io("run")(self, path, overwrite=overwrite, frames=frames, magnification=magnification))
