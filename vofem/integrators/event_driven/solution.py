"""The outcome of an event-driven run: linear segments, each known in closed form at any time."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator
from functools import cached_property, wraps
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vofem.blas import blas_threads
from vofem.integrators.base import (
    ContactSamples,
    Energies,
    Sensitivity,
    status_at,
)
from vofem.integrators.event_driven.load_table import LoadTable, load_table
from vofem.integrators.event_driven.modal_samples import ModalSamples
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.motion import Forcing, Motion, start_motion
from vofem.integrators.event_driven.panels import changes_on_panels
from vofem.integrators.event_driven.pinned import Reactions, may_pin, reactions, should_pin
from vofem.integrators.event_driven.record import Record
from vofem.integrators.event_driven.sampling import sample_segments
from vofem.integrators.event_driven.search import EventFunctions
from vofem.integrators.event_driven.segment import Segments
from vofem.integrators.event_driven.sensitivity import Perturbation
from vofem.integrators.event_driven.spectrum import Spectra, Spectrum
from vofem.integrators.event_driven.status_table import MOST_MODES, StatusTable
from vofem.integrators.registry import advice
from vofem.integrators.unclosed import never_closed, open_throughout
from vofem.kernels.mode import as_it_ran, compiled, kernels
from vofem.laws import initial_status
from vofem.system import CLOSED, OPEN, PINNED, Counters, Events, State, System
from vofem.time_functions import Piece, TimeFunction

if TYPE_CHECKING:
    from vofem.integrators.event_driven.energy import Loads, StatusForms

Array = NDArray[np.float64]
F = TypeVar("F", bound=Callable[..., Any])

#: Terms of a contact's coordinate over its size, from which on it is a difference of large numbers.
_CANCELLING = 8.0
Status = NDArray[np.int64]

#: Largest number of statuses for which the growth of a perturbation is computed in compiled code.
_MOST_SLOTS = 1000

#: With fewer events the growth of perturbations is computed only on request, because it would cost more than it is
#: worth.
_MANY_EVENTS = 30


#: Segments whose closed forms are kept, so that sampling a run starts from them: as many as hold so many numbers (one
#: has an overhead of about 150), but few where each may keep another eigensystem in memory, and only the last one in
#: systems of more modes than these.
_MOST_NUMBERS, _OVERHEAD, _MOST_MOTIONS, _FEW_MODES = 12_000_000, 150, 32, 300

#: Numbers that a closed form holds for each mode.
_EACH = 20

#: Change of the energy of a run without loads and dampers, divided by the largest energy, above which a note is
#: written.
_ENERGY = 0.01

#: Times whose energies are computed together.
_ROWS = 1024

#: Numbers of the last samples that are kept in modes.
_MOST_KEPT = 20_000_000

#: Number of times at which contacts that never close are checked.
_LOOKS = 257

#: A contact touches at the start if its gap function is below this share of its displacement and its gap.
_TOUCHING = 4.0 * float(np.finfo(float).eps)


def _gathered(system: System, space: ModalSpace) -> tuple[list[Any], Array]:
    """Return the functions of time of the loads, equal ones once, and for each the sum of its modal load vectors."""
    places: dict[Any, int] = {}
    functions: list[Any] = []
    owner = []
    for load in system.loads:
        function = load.function
        key = function if getattr(type(function), "__hash__", None) is not None else id(function)
        if key not in places:
            places[key] = len(functions)
            functions.append(function)
        owner.append(places[key])
    vectors = np.zeros((len(functions), space.size))
    for place, vector in zip(owner, space.loads, strict=True):
        vectors[place] += vector
    return functions, vectors


def _sums_of_squares(states: Array, weight: Array) -> Array:
    """Return the sums of weighted squares of states (n, n_times) whose times are rows in memory, shape (n_times,)."""
    sums = np.empty(states.shape[1])
    # A part at a time stays in fast memory.
    for k in range(0, sums.size, _ROWS):
        sums[k : k + _ROWS] = states.T[k : k + _ROWS] ** 2 @ weight
    return sums


def _evaluation(method: F) -> F:
    """Let a method of `EventSolution` call kernels as the run did, and use threads as it did."""

    @wraps(method)
    def call(self: EventSolution, *arguments: Any) -> Any:
        with kernels(compiled=self.compiled), blas_threads(self.space.size):
            return method(self, *arguments)

    return call  # type: ignore[return-value]


class EventSolution:
    """The run as a sequence of linear segments, each known in closed form."""

    continuous = True
    springs = None
    probes = None
    truncation = None

    def __init__(self, system: System, space: ModalSpace, t_end: float, times: Array, counters: Counters) -> None:
        self.t_end = t_end
        self.times = times
        self.counters = counters
        self.notes: list[str] = []
        self.system = system
        self.space = space
        self.was_cut = False
        # The samples that were computed last, and whether they are kept here too.
        self._sampled: tuple[Any, list[weakref.ref[Array]]] | None = None
        self._kept: tuple[Array, Array, Array] | None = None
        #: How the run was computed, and so how it is sampled.
        self.compiled = compiled()
        self._spectra = Spectra(space, system.contacts, counters, system.cache)
        self.record = Record(space.size, space.contacts.shape[0])
        # Gap functions at the end of the last segment, before an event there.
        self.gaps_now: Array | None = None
        self._initial = np.empty(0, dtype=np.int64)
        # Whether closed contacts exert a force at zero displacement, as under the penetration law.
        self._pushed = system.contacts is not None and bool(np.any(system.contacts.offset))
        # Counters count the work of the run, not that of sampling it later.
        self._motions: dict[int, Motion] = {}
        self.load_functions, self.load_vectors = _gathered(system, space)

    def __getstate__(self) -> dict[str, Any]:
        """Return the solution without its last samples, which can be computed again."""
        return {**self.__dict__, "_sampled": None, "_kept": None}

    @classmethod
    def restored(
        cls, system: System, space: ModalSpace, t_end: float, times: Array, counters: Counters, notes: list[str],
        segments: Segments, events: Events,
    ) -> EventSolution:  # fmt: skip
        """Return the solution of an earlier run; eigensystems are computed when a segment is first asked for."""
        # The modes of the file are those of all runs of this system.
        system.cache.get("modal space", None, lambda: space)
        solution = cls(system, space, t_end, times, Counters())
        solution.counters, solution.notes = counters, notes
        record = solution.record
        record.fill(segments, events.time, events.contact, events.status)
        solution._initial = events.initial
        return solution

    @cached_property
    def row_sizes(self) -> Array:
        """Bounds on the terms that the modal rows of the contacts are summed of, shape (n_contacts, n).

        The gap between bodies that move together is a difference of displacements, so its error is their rounding.
        """
        laws, shapes = self.system.contacts, self.space.shapes
        assert laws is not None
        return self.system.cache.get(
            "sizes of modal contact rows", None, lambda: np.asarray(abs(laws.rows) @ np.abs(shapes))
        )

    @property
    def modes(self) -> tuple[Array, Array]:
        """Squared frequencies (n,) and shapes (n, n) of the modes without contacts."""
        return self.space.stiffness, self.space.shapes

    @property
    def segments(self) -> Segments:
        """Begin and duration, contact status and modal state of every segment."""
        return self.record.as_segments()

    # -- stopping and going on --------------------------------------------------------------------

    def snapshot(self, t: float, status: Status, displacement: Array, velocity: Array) -> dict[str, Any]:
        """Return the state at the end of a segment, from which the run can continue, as plain data."""
        events = self.events
        return {
            "segments": self.segments,
            "log": np.column_stack([events.time, events.contact, events.status]).astype(float).reshape(-1, 3),
            "initial": self._initial,
            "now": (t, status, displacement, velocity),
            "gaps": self.gaps_now,
            "counters": self.counters,
        }

    def go_on(self, saved: dict[str, Any]) -> tuple[float, Status, Array, Array]:
        """Restore a snapshot of the same run; return the time and the state from which the run continues."""
        segments, log = Segments(*saved["segments"]), saved["log"]
        self.record.fill(segments, log[:, 0], log[:, 1].astype(np.int64), log[:, 2].astype(np.int64))
        self._initial = saved["initial"]
        for name, value in vars(saved["counters"]).items():
            setattr(self.counters, name, value)
        self.gaps_now = saved["gaps"]
        t, status, displacement, velocity = saved["now"]
        return t, status, displacement, velocity

    def cut(self, t: float) -> None:
        """End the run at time t, before its end."""
        self.notes.append(f"interrupted at t = {t:g} s of {self.t_end:g} s: what was computed until then is here")
        self.t_end = t
        self.times = self.times[self.times <= t]
        self.was_cut = True

    # -- recording --------------------------------------------------------------------------------

    def begin(self, start: State, displacement: Array, velocity: Array, fraction: float, t: float = 0.0) -> Status:
        """Determine, store and return the contact status at the start. A contact at rest at its gap may be pinned."""
        laws = self.system.contacts
        if laws is not None:
            rows = self.system.cache.get("magnitudes of contact rows", None, lambda: abs(laws.rows))
            size = rows @ np.abs(start.q)
            self._initial = initial_status(laws, start.q, start.v, size)
            self.counters.gap_evaluations += len(laws)
            size = np.abs(laws.gap) + size
            touching = np.abs(laws.rows @ start.q - laws.gap) <= 1e-12 * size
            for j in np.flatnonzero(touching & laws.jump):
                if should_pin(
                    self.space, laws, self._initial, int(j), (displacement, velocity), self.load(t), fraction
                ):
                    self._initial[j] = PINNED
        return self._initial

    def begin_at(self, status: Status, displacement: Array, touching: int | None = None) -> None:
        """Begin with a known status in a modal displacement; a contact that has just switched is at its gap."""
        self._initial = status
        laws = self.system.contacts
        if laws is not None and touching is not None:
            gaps = self.space.contacts @ displacement - laws.gap
            gaps[touching] = 0.0
            self.gaps_now = gaps

    def add_segment(self, t: float, status: Status, displacement: Array, velocity: Array) -> Motion:
        """Begin a segment at time t in a modal state.

        The displacement is corrected so that contacts that have just switched are exactly at their gaps. Otherwise a
        stiff contact would turn the rounding of the displacement into energy.
        """
        record = self.record
        if record.segments:
            switched = np.flatnonzero((status != record.status(record.segments - 1)) & (status != PINNED))
            if switched.size:
                displacement = self._at_gaps(switched, displacement)
        gaps = self.gaps_at(status, displacement)
        record.add(t, status, displacement, velocity)
        index = record.segments - 1
        record.buffers.gaps[index] = gaps
        self.counters.steps += 1
        return self.motion(index)

    def _at_gaps(self, switched: NDArray[np.int64], displacement: Array) -> Array:
        """Return the displacement nearest to a given one at which some contacts are at their gaps.

        If a contact's coordinate is a small difference of large modal displacements, it is not corrected, because the
        correction would change these displacements by its rounding.
        """
        assert self.system.contacts is not None
        rows, gap = self.space.contacts[switched], self.system.contacts.gap[switched]
        off = rows @ displacement - gap
        if np.any(np.abs(rows) @ np.abs(displacement) > _CANCELLING * (np.abs(gap) + np.abs(off))):
            return displacement
        if switched.size == 1:
            return np.asarray(displacement - rows[0] * (off[0] / (rows[0] @ rows[0])))
        # Two contacts at one point have one row.
        return np.asarray(displacement - np.linalg.lstsq(rows, off, rcond=None)[0])

    def end_segment(self, duration: float) -> tuple[Array, Array]:
        """End the last segment after a duration in s; return the modal state there, two arrays of shape (n,).

        The duration itself is stored, because the difference of the times at both ends has fewer digits.
        """
        index = self.record.segments - 1
        self.record.buffers.durations[index] = duration
        motion, (displacement, velocity) = self.motion(index), self._whole_changes(index)
        if self.system.contacts is not None:
            self.gaps_now = self.record.buffers.gaps[index] + self.space.contacts @ displacement
        return motion.displacement + displacement, motion.velocity + velocity

    def _whole_changes(self, index: int) -> tuple[Array, Array]:
        """Return by how much modal displacement and velocity change over a segment, each of shape (n,)."""
        displacement, velocity = self.motion(index).mode_changes(self.record.durations[index : index + 1])
        return displacement[:, 0], velocity[:, 0]

    def gap_functions(self, index: int) -> Array:
        """Return the gap functions s at the begin of a segment, shape (n_contacts,).

        They are computed as sums of changes and are therefore far more accurate than displacements. For a contact that
        has just closed or opened they are exactly 0.
        """
        return self.record.buffers.gaps[index]

    def gaps_at(self, status: Status, displacement: Array) -> Array:
        """Return the gap functions at the begin of the segment that comes next, shape (n_contacts,)."""
        if self.system.contacts is None:
            return np.zeros(0)
        changed = status != self.record.last_status if self.record.segments else None
        return self._gaps(status, displacement, self.gaps_now, changed)

    def _gaps(
        self, status: Status, displacement: Array, before: Array | None, changed: NDArray[np.bool_] | None
    ) -> Array:
        """Return the gap functions at the begin of a segment.

        Parameters
        ----------
        before : ndarray, shape (n_contacts,), optional
            Those at the end of the segment before; without them they are computed from the displacement.
        changed : ndarray of bool, shape (n_contacts,), optional
            Contacts that have just switched.
        """
        laws, rows = self.system.contacts, self.space.contacts
        assert laws is not None
        if before is None:
            gaps = np.asarray(rows @ displacement - laws.gap)
            gaps[np.abs(gaps) <= _TOUCHING * (np.abs(rows) @ np.abs(displacement) + np.abs(laws.gap))] = 0.0
        else:
            gaps = before.copy()
        if changed is not None:
            gaps[changed] = 0.0
        gaps[status == PINNED] = 0.0
        return gaps

    def event_functions(self, motion: Motion) -> tuple[EventFunctions, NDArray[np.int64], Status]:
        """Return the event functions of the last segment, the contact of each and the status it leads to.

        Open contacts are searched for ``s > 0``, closed ones for ``s < 0``,
        pinned ones for a reaction that leaves [0, K0 gap].
        """
        laws, index = self.system.contacts, self.record.segments - 1
        assert laws is not None
        spectrum, count = motion.spectrum, motion.omega.size
        status, gaps = self.record.status(index), self.gap_functions(index)
        functions, plain, leads, sign = self._plain_functions(status, spectrum, count)
        constant = functions.constant
        if functions.u.shape[1]:
            # Rounding from earlier segments. The search itself considers only the changes within this segment.
            constant = np.abs(constant) + self.row_sizes[plain] @ np.abs(motion.displacement)
        functions = EventFunctions(
            functions.w, functions.u, functions.w_size, functions.u_size, sign * gaps[plain], constant,
            functions.slope, functions.harmonic,
        )  # fmt: skip
        pinned = status == PINNED
        if not pinned.any():
            return functions, plain, leads
        held = np.flatnonzero(pinned)
        force = self._reactions(index)
        now = force.at(motion, np.zeros(1))[:, 0]
        w, u = spectrum.functions(force.displacement, force.velocity)
        w_size, u_size = spectrum.sizes(np.abs(force.displacement), np.abs(force.velocity))
        none = np.zeros((plain.size, u.shape[1]))
        u_plain, u_plain_size = (functions.u, functions.u_size) if functions.u.shape[1] else (none, none)
        jump = laws.stiffness[held] * laws.gap[held]
        functions = EventFunctions(
            np.vstack([functions.w, -w, w]),
            np.vstack([u_plain, -u, u]),
            np.vstack([functions.w_size, w_size, w_size]),
            np.vstack([u_plain_size, u_size, u_size]),
            np.concatenate([functions.start, -now, now - jump]),
            np.concatenate([functions.constant, force.constant, jump - force.constant]),
            np.concatenate([functions.slope, -force.slope, force.slope]),
            np.vstack([functions.harmonic, -force.harmonic, force.harmonic]),
        )
        leads = np.concatenate([leads, np.full(held.size, OPEN), np.full(held.size, CLOSED)])
        return functions, np.concatenate([plain, held, held]), leads

    def functions_of(self, status: Status) -> EventFunctions:
        """Return the event functions of a status without pinned contacts, as far as they do not depend on the state."""
        return self._plain_functions(status, self.spectrum_of(status), 0)[0]

    def _plain_functions(
        self, status: Status, spectrum: Spectrum, count: int
    ) -> tuple[EventFunctions, NDArray[np.int64], Status, Array]:
        """Return what `event_functions` does for contacts that are not pinned, the same whenever a status returns.

        And the signs of their gap functions.
        """
        known = spectrum.event_functions.get(count)
        if known is not None:
            return known
        laws = self.system.contacts
        if laws is None:
            none, empty = np.zeros(0), np.zeros((0, self.space.size))
            rest = EventFunctions(empty, empty, empty, empty, none, none, none, empty.astype(complex))
            return rest, np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), none
        plain = np.flatnonzero(status != PINNED)
        sign = np.where(status[plain] == CLOSED, -1.0, 1.0)
        rows = sign[:, None] * self.space.contacts[plain]
        level = sign * laws.gap[plain]
        if spectrum.real.shift is not None:
            level = level - rows @ spectrum.real.shift
        none = np.zeros(plain.size)
        functions = EventFunctions(
            *spectrum.rows(rows, self.row_sizes[plain]),
            none,
            level,
            none,
            np.zeros((plain.size, count), dtype=complex),
        )
        known = functions, plain, np.where(status[plain] == CLOSED, OPEN, CLOSED), sign
        spectrum.event_functions[count] = known
        return known

    def enter(
        self, t: float, status: Status, entered: dict[int, int], displacement: Array, velocity: Array, fraction: float
    ) -> Status:
        """Return the status after an event, chattering contacts pinned, and record it."""
        laws = self.system.contacts
        assert laws is not None
        after = status.copy()
        for contact, new in entered.items():
            after[contact] = new
        jumping = [j for j in entered if status[j] != PINNED and may_pin(self.space, laws, j, velocity, fraction)]
        if jumping:
            state, load = (displacement, velocity), self.load(t)
            for contact in jumping:
                if should_pin(self.space, laws, after, contact, state, load, fraction):
                    after[contact] = PINNED
        for contact in entered:
            if after[contact] != status[contact]:
                self.record.add_event(t, contact, int(after[contact]))
        self.counters.events += len(entered)
        return after

    def load(self, t: float) -> Array:
        """Return the modal load at time t, shape (n,)."""
        total = np.zeros(self.space.size)
        for vector, function in zip(self.load_vectors, self.load_functions, strict=True):
            total += vector * float(function(t))
        return total

    def conclude(self) -> None:
        """Write the notes. Notes that take long to compute are left out if the run was cut short."""
        if self.was_cut:
            return
        if "table" in self.__dict__ and self.table.lend():
            self._tables["last"] = self.table
        events, laws = self.events, self.system.contacts
        self._note_energy()
        if laws is not None and np.any(open_throughout(laws, events)):
            # At times that the run chooses, so that notes do not depend on the times at which results are stored.
            z, _ = self.modal(np.linspace(0.0, self.t_end, _LOOKS))
            self.notes += never_closed(laws, events, np.max(self.space.contacts @ z, axis=1))
        for j in np.unique(events.contact[events.status == PINNED]):
            assert laws is not None
            mine = events.contact == j
            self.notes.append(
                f"chatter: contact {laws.names[j]!r} came to rest at its gap (pinned) "
                f"{int(np.sum(events.status[mine] == PINNED))} times in {int(np.sum(mine))} events; there its reaction "
                "lies between 0 and K0*gap"
            )
        if events.time.size > _MANY_EVENTS:
            horizon = self.sensitivity.horizon()
            if horizon < self.t_end:
                self.notes.append(
                    f"chaos: a perturbation grows by 10^{self.sensitivity.growth[-1]:.1f} along this run, so rounding "
                    f"spoils pointwise values beyond t = {horizon:.4g} s; means and rms values may still be taken"
                )

    def _note_energy(self) -> None:
        """Write a note if the energy of a run without loads and dampers changes.

        For other runs the balance needs integrals over all segments, which cost up to a third of the run.
        """
        laws, events = self.system.contacts, self.events
        damped = self.system.damped or (laws is not None and bool(np.any(laws.damping > 0)))
        pinned = bool(np.any(events.status == PINNED) or np.any(events.initial == PINNED))
        if damped or pinned or self.system.loads:
            return
        segments = self.segments
        starts, z, v = segments.starts, segments.displacement.T, segments.velocity.T
        energy = 0.5 * np.sum(v**2 + self.space.stiffness[:, None] * z**2, axis=0)
        if laws is not None:
            gaps = segments.gaps
            assert gaps is not None
            energy += laws.closed_potential(gaps.T, segments.status.T)
        largest = float(np.max(energy))
        worst = int(np.argmax(np.abs(energy - energy[0])))
        if largest > 0.0 and abs(energy[worst] - energy[0]) > _ENERGY * largest:
            self.notes.append(
                f"energy: by t = {starts[worst]:.4g} s {abs(energy[worst] - energy[0]) / largest:.2g} of the largest "
                f"energy was {'lost' if energy[worst] < energy[0] else 'made out of nothing'} by rounding; make stiff "
                f"contacts softer, or choose {advice(conserves=True)} with a small dt"
            )

    @property
    def events(self) -> Events:
        """The contact events in order of time."""
        return self.record.log(self._initial)

    # -- segments ---------------------------------------------------------------------------------

    @property
    def segment_starts(self) -> Array:
        """Times at which the segments begin, shape (n_segments,)."""
        return self.record.starts

    def load_pieces(self, t: float) -> list[Piece]:
        """Return the closed form near time t of every load; loads with one function of time are one."""
        return [function.piece(t) for function in self.load_functions if isinstance(function, TimeFunction)]

    def spectrum_of(self, status: Status) -> Spectrum:
        """Return the eigensystem of a status that occurs in the run."""
        return self._spectra[status]

    @cached_property
    def table(self) -> StatusTable:
        """Eigensystems of the statuses as the compiled loops take them."""
        known = self._tables.get("last")
        earlier = None if known is None else known.continued(self.load_vectors, self.t_end)
        if earlier is not None:
            return earlier
        laws = self.system.contacts
        damped = self.system.damped or (laws is not None and bool(np.any(laws.damping > 0)))
        return StatusTable(self.load_vectors, self.space.contacts.shape[0], self.t_end, damped)

    @property
    def _tables(self) -> dict[str, StatusTable]:
        """The table of the last run of the system."""
        return self.system.cache.get("status table", None, dict)

    def slot(self, status: Status) -> int:
        """Return the slot of a status in `table`; -1 where a contact is pinned or modes are in clusters."""
        slot = self.table.slot(status)
        if slot >= 0 or np.any(status == PINNED):
            return slot
        spectrum = self.spectrum_of(status)
        if spectrum.plain is not None:
            return -1
        number = self.record.number(status)
        slot = self.table.recall(status, number, spectrum)
        if slot >= 0:
            return slot
        return self.table.enter(status, number, spectrum, self.functions_of(status), self.offset_force(status))

    def spectrum(self, index: int) -> Spectrum:
        """Return the eigensystem of a segment."""
        return self._spectra[self.record.status(index)]

    @as_it_ran
    def motion(self, index: int) -> Motion:
        """Return the closed form of the motion in a segment. The ones that were computed last are kept."""
        if index not in self._motions:
            status, (displacement, velocity) = self.record.status(index), self.record.state(index)
            spectrum = self._spectra[status]
            forcing = self.forcing(self.record.starts[index], status)
            if len(self._motions) >= self._most_motions():
                del self._motions[next(iter(self._motions))]
            self._motions[index] = start_motion(spectrum, displacement, velocity, forcing, self.t_end)
        return self._motions[index]

    def _most_motions(self) -> int:
        """Return how many closed forms of segments are kept."""
        size = self.space.size
        if size > _FEW_MODES:
            return 1
        # Eigensystems that `Spectra` keeps cost nothing more.
        return max(_MOST_NUMBERS // (_OVERHEAD + _EACH * size), 1) if self._spectra.all_kept else _MOST_MOTIONS

    def forcing(self, t: float, status: Status) -> Forcing:
        """Return the modal force of loads and of the offsets of closed contacts."""
        space, spectrum = self.space, self._spectra[status]
        constant, slope = np.zeros(space.size), np.zeros(space.size)
        harmonics: dict[float, NDArray[np.complex128]] = {}
        for vector, piece in zip(self.load_vectors, self.load_pieces(t), strict=True):
            if piece.constant:
                constant += piece.constant * vector
            if piece.slope:
                slope += piece.slope * vector
            for w, amplitude in piece.harmonics:
                wave = amplitude * vector
                harmonics[w] = harmonics[w] + wave if w in harmonics else wave
        if self._pushed:
            constant += self.offset_force(status)
        if spectrum.real.shift_force is not None:
            constant += spectrum.real.shift_force
        omega = np.array(list(harmonics))
        waves = np.empty((space.size, omega.size), dtype=complex)
        for h, wave in enumerate(harmonics.values()):
            waves[:, h] = wave
        return Forcing(omega, waves, constant, slope)

    def offset_force(self, status: Status) -> Array:
        """Return the modal force of closed contacts at zero displacement, shape (n,)."""
        laws = self.system.contacts
        if laws is None or not self._pushed:
            return np.zeros(self.space.size)
        return np.asarray((laws.stiffness * laws.offset * (status == CLOSED)) @ self.space.contacts)

    def visit(self, times: Array) -> list[tuple[int, NDArray[np.int64], Array]]:
        """Return (segment, indices into times, local times) for all segments that hold some of the times."""
        order = np.argsort(times, kind="stable")
        segment = np.searchsorted(self.segment_starts, times[order], side="right") - 1
        visited, first = np.unique(segment, return_index=True)
        groups = np.split(order, first[1:]) if times.size else []
        starts = self.segment_starts
        return [(int(index), mine, times[mine] - starts[index]) for index, mine in zip(visited, groups, strict=True)]

    # -- sampling ---------------------------------------------------------------------------------

    @_evaluation
    def modal(self, times: Array) -> tuple[Array, Array]:
        """Return modal displacements and velocities at any times, each of shape (n, n_times)."""
        z, v, _ = self._trajectory(times, gaps=False)
        return z, v

    def _trajectory(self, times: Array, *, gaps: bool = True) -> tuple[Array, Array, Array]:
        """Return `modal`, and the gap functions of the contacts, shape (n_contacts, n_times), where wanted.

        The last samples are kept, because motion, contacts and energies are usually computed at the same times. If they
        take much memory, they are used again only as long as a result holds them.
        """
        asked = times.tobytes(), gaps
        if self._sampled is not None and self._sampled[0] == asked:
            z, v, s = (part() for part in self._sampled[1])
            if z is not None and v is not None and s is not None:
                return z, v, s
        found = self._sampled_at(times, gaps)
        # A few times, as those of an energy at the start, do not take the place of many.
        if times.size > 1 or self._sampled is None:
            self._sampled = asked, [weakref.ref(part) for part in found]
            self._kept = found if 2 * self.space.size * times.size <= _MOST_KEPT else None
        return found

    def _sampled_at(self, times: Array, gaps: bool) -> tuple[Array, Array, Array]:
        # In memory each row holds one time.
        z, v = np.empty((times.size, self.space.size)).T, np.empty((times.size, self.space.size)).T
        gaps = gaps and self.system.contacts is not None
        s = np.empty((times.size, len(self.space.contacts) if gaps else 0)).T
        sampled = self._sample_compiled(times, z, v, s)
        if np.all(sampled):
            return z, v, s
        for index, mine, tau in self.visit(times):
            if sampled[self.record.status_numbers[index]]:
                continue
            motion = self.motion(index)
            displacement, velocity = motion.mode_changes(tau)
            if gaps:
                s[:, mine] = self.gap_functions(index)[:, None] + self.space.contacts @ displacement
            z[:, mine] = displacement + motion.displacement[:, None]
            v[:, mine] = velocity + motion.velocity[:, None]
        return z, v, s

    def _sample_compiled(self, times: Array, z: Array, v: Array, gaps: Array) -> NDArray[np.bool_]:
        """Fill in samples in compiled code; return for each status of the record whether its segments are done."""
        record, slots, loads = self.record, self._slots(), self._load_table
        none = np.zeros(len(record.statuses), dtype=bool)
        if loads is None or not np.any(slots >= 0) or not times.size:
            return none
        order = np.argsort(times, kind="stable")
        segments = np.searchsorted(record.starts, times[order], side="right") - 1
        sample_segments(
            self.table.arrays, slots, np.array(self.space.contacts), loads, record.buffers, self.t_end, segments,
            times[order] - record.starts[segments], order, z.T, v.T, gaps.T,
        )  # fmt: skip
        return slots >= 0

    @cached_property
    def _load_table(self) -> LoadTable | None:
        """The loads from the begin of the run to its end."""
        begin = float(self.record.starts[0])
        breaks = np.concatenate([[begin], *(function.breakpoints(self.t_end) for function in self.load_functions)])
        edges = np.append(np.unique(breaks[breaks >= begin]), self.t_end)
        return load_table(self.load_functions, edges) if self.t_end > begin else None

    @_evaluation
    def sample(self, times: Array) -> ModalSamples:
        """Return the motion at any times; the acceleration is that of the equation of motion."""
        z, v, s = self._trajectory(times)
        return ModalSamples(self.space.shapes, z, v, lambda: self._acceleration(times, z, v, s))

    @_evaluation
    def _acceleration(self, times: Array, z: Array, v: Array, s: Array) -> Array:
        space = self.space
        # A time is a row in memory, as in the samples.
        rows = -space.stiffness * z.T
        if np.any(space.damping):
            rows -= v.T * space.damping
        if space.coupling is not None:
            rows -= v.T @ space.coupling.T
        if self.load_functions:
            rows += np.column_stack([function(times) for function in self.load_functions]) @ self.load_vectors
        if self.system.contacts is not None:
            rows -= self._contact_force(times, v, s).T @ space.contacts
        return rows.T

    def _reactions(self, index: int) -> Reactions:
        """Return the reactions of the pinned contacts of a segment."""
        laws, status = self.system.contacts, self.record.status(index)
        assert laws is not None
        spectrum = self._spectra[status]
        forcing = self.forcing(self.record.starts[index], status)
        return reactions(self.space, laws, status, spectrum, forcing)

    def _contact_force(self, times: Array, v: Array, s: Array) -> Array:
        laws = self.system.contacts
        assert laws is not None
        force = laws.force(s, self.space.contacts @ v, status_at(self.events, times))
        if not any(np.any(status == PINNED) for status in self.record.statuses):
            return force
        for index, mine, tau in self.visit(times):
            held = np.flatnonzero(self.record.status(index) == PINNED)
            if held.size:
                # The interval's ends are roots, found to rounding.
                jump = (laws.stiffness[held] * laws.gap[held])[:, None]
                force[np.ix_(held, mine)] = np.clip(self._reactions(index).at(self.motion(index), tau), 0.0, jump)
        return force

    @_evaluation
    def contacts(self, times: Array) -> ContactSamples:
        """Return status, K_eq and force of the contacts at any times."""
        laws = self.system.contacts
        assert laws is not None
        _, v, s = self._trajectory(times)
        status = status_at(self.events, times)
        force = self._contact_force(times, v, s)
        stiffness = np.where(status == CLOSED, laws.stiffness[:, None], 0.0)
        gap = np.where(laws.gap > 0, laws.gap, 1.0)[:, None]
        return ContactSamples(status, np.where(status == PINNED, force / gap, stiffness), force)

    @_evaluation
    def elastic_force(self, contact: int, low: Array, high: Array, fractions: Array) -> Array | None:
        """Return the force of an undamped contact on panels in N, shape (n_fractions, n_panels).

        Parameters
        ----------
        contact : int
        low, high : ndarray, shape (n_panels,)
            Ends of each panel in s; no event happens within.
        fractions : ndarray, shape (n_fractions,)
            Places in a panel, from 0 to 1.

        Returns
        -------
        ndarray or None
            None if the contact is not closed, or if modes are coupled or at resonance. In these cases use `contacts`.
        """
        laws = self.system.contacts
        assert laws is not None
        gaps = np.empty((fractions.size, low.size))
        segments = np.searchsorted(self.segment_starts, 0.5 * (low + high), side="right") - 1
        for index in np.unique(segments).tolist():
            motion = self.motion(index)
            weight = motion.spectrum.real.down(self.space.contacts[contact])
            mine = np.flatnonzero(segments == index)
            tau = np.maximum(low[mine] - self.segment_starts[index], 0.0)
            changes = changes_on_panels(motion, weight, tau, (high - low)[mine], fractions)
            if changes is None or self.record.status(index)[contact] != CLOSED:
                return None
            gaps[:, mine] = self.gap_functions(index)[contact] + changes
        return np.asarray(laws.stiffness[contact] * (gaps + laws.gap[contact] - laws.offset[contact]))

    def _forms(self, index: int) -> StatusForms | None:
        """Return the forms of work and dissipation of a segment's status, which are kept with its eigensystem."""
        from vofem.integrators.event_driven.energy import StatusForms

        spectrum, status = self.spectrum(index), self.record.status(index)
        if spectrum.plain is not None:
            return None
        # Systems with other functions of time share eigensystems, but their loads may fall into other groups.
        kept, key = spectrum.energy_forms, (self.t_end, self.load_vectors.tobytes())
        forms = kept.get(key)
        if forms is None:
            push = self.offset_force(status)
            if spectrum.real.shift_force is not None:
                push = push + spectrum.real.shift_force
            forms = StatusForms(spectrum, self.load_vectors, push, self.t_end)
            if self.space.size <= _FEW_MODES:
                kept.clear()
                kept[key] = forms
        return forms

    def _driven(self, count: int) -> Iterator[tuple[NDArray[np.int64], Loads]]:
        """Yield the first segments in groups, and their loads."""
        from vofem.integrators.event_driven.energy import groups_of

        starts, whole = self.record.starts, self._load_table
        for first in range(0, count, count if whole is not None else _ROWS):
            mine = np.arange(first, min(first + (count if whole is not None else _ROWS), count))
            table = whole or load_table(self.load_functions, np.append(starts[mine], self.t_end))
            assert table is not None
            yield from groups_of(self.record, table, mine)

    @cached_property
    @_evaluation
    def sensitivity(self) -> Sensitivity:
        """Growth of a perturbation along the run, in closed form."""
        laws = self.system.contacts
        record, traveller = self.record, Perturbation(self.space, laws)
        growth = np.zeros(record.segments + 1)
        index, slots = 0, self._slots()
        while index < record.segments:
            done = traveller.follow(self.table.arrays, slots, record, index, growth) if slots.size else index
            if done > index:
                index = done
                continue
            status = record.status(index)
            traveller.drift(self._spectra[status], record.durations[index])
            if index + 1 < record.segments:
                after, (_, velocity) = record.status(index + 1), record.state(index + 1)
                changed = np.flatnonzero(after != status)
                if changed.size:
                    traveller.jump([(int(j), int(status[j]), int(after[j])) for j in changed], velocity)
            index += 1
            growth[index] = traveller.growth
        return Sensitivity(np.append(self.segment_starts, self.t_end), growth)

    def _slots(self) -> Status:
        """Return the slots in `table` of the statuses of the record, -1 for those without.

        Empty in plain Python and where the table cannot hold all of them.
        """
        statuses = self.record.statuses
        if not compiled() or self.space.size > MOST_MODES or len(statuses) > min(_MOST_SLOTS, self.table.capacity):
            return np.zeros(0, dtype=np.int64)
        return np.array([self.slot(status) for status in statuses], dtype=np.int64)

    @property
    def start_energy(self) -> float:
        """Kinetic, strain and contact energy at t = 0."""
        start = self.energies(np.zeros(1))
        return float(start.kinetic[0] + start.strain[0] + start.contact[0])

    @_evaluation
    def energies(self, times: Array) -> Energies:
        """Return energies, dissipation and work at any times, in closed form."""
        from vofem.integrators.event_driven.energy import work_and_dissipation

        system, space = self.system, self.space
        z, v, s = self._trajectory(times)
        contact, work, dissipated = np.zeros((3, times.size))
        damped, pinning = system.damped, None
        if system.contacts is not None:
            contact = system.contacts.closed_potential(s, status_at(self.events, times))
            damped = damped or bool(np.any(system.contacts.damping > 0))
            pinning = self._lost_in_pinning()
        if (damped or system.loads or pinning is not None) and times.size:
            visits = self.visit(times)
            work_and_dissipation(
                space, system.contacts, self.load_vectors, self.record, self._forms, self.motion,
                self._driven(visits[-1][0] + 1), visits, pinning, work, dissipated,
            )  # fmt: skip
        kinetic, strain = 0.5 * _sums_of_squares(v, np.ones(space.size)), 0.5 * _sums_of_squares(z, space.stiffness)
        return Energies(kinetic, strain, contact, dissipated, work)

    def _lost_in_pinning(self) -> Array | None:
        """Return the kinetic energy that pinning takes at the begin of every segment, J; None where nothing is pinned.

        It is the energy of the normal velocity at the moment of pinning, which `pinned` removes.
        """
        events = self.events
        if not (np.any(events.status == PINNED) or np.any(events.initial == PINNED)):
            return None
        lost = np.zeros(self.record.segments)
        for index in range(lost.size):
            held = self.space.contacts[self.record.status(index) == PINNED]
            if held.shape[0]:
                velocity = self.record.state(index)[1]
                speed = held @ velocity
                lost[index] = 0.5 * speed @ np.linalg.solve(held @ held.T, speed)
        return lost
