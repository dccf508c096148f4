"""The outcome of an event-driven run: linear segments, each known in closed form at any time."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator
from functools import cached_property, wraps
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.blas import blas_threads
from vofem.errors import ArgumentError
from vofem.integrators.base import (
    ContactSamples,
    Energies,
    Sensitivity,
    Truncation,
    status_at,
)
from vofem.integrators.event_driven.bounces import Bounces, bounces_of
from vofem.integrators.event_driven.exosystem import Exosystem, exosystem, gathered, pushes
from vofem.integrators.event_driven.modal_samples import ModalSamples
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.pinned import may_pin, should_pin
from vofem.integrators.event_driven.record import Record
from vofem.integrators.event_driven.regime import Regime, Regimes, drift_of, flat
from vofem.integrators.event_driven.segment import Segments
from vofem.integrators.event_driven.sensitivity import growth_along
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.integrators.event_driven.tangent import Passage, passage
from vofem.integrators.observer import interruption
from vofem.integrators.registry import advice
from vofem.integrators.unclosed import never_closed, open_throughout
from vofem.kernels.mode import compiled, kernels
from vofem.laws import initial_status
from vofem.system import CLOSED, OPEN, PINNED, ContactLaws, Counters, Events, State, System

if TYPE_CHECKING:
    from vofem.integrators.event_driven.sliders import Sliders

F = TypeVar("F", bound=Callable[..., Any])

#: Terms of a contact's coordinate over its size, from which on it is a difference of large numbers.
_CANCELLING = 8.0
Status = NDArray[np.int64]

#: With fewer events the growth of perturbations is computed only on request, because it would cost more than it is
#: worth.
_MANY_EVENTS = 30


#: Numbers of the states of blocks that are computed together.
_TOGETHER = 200_000

#: Change of the energy of a run without loads and dampers, divided by the largest energy, above which a note is
#: written.
_ENERGY = 0.01

#: Times whose energies are computed together.
_ROWS = 1024

#: Numbers of the last samples that are kept.
_MOST_KEPT = 20_000_000

#: Number of times at which contacts that never close are checked.
_LOOKS = 257

#: A contact touches at the start if its gap function is below this share of its displacement and its gap.
_TOUCHING = 4.0 * float(np.finfo(float).eps)


def _sums_of_squares(states: Array, weight: Array) -> Array:
    """Return the sums of weighted squares of states (n, n_times) whose times are rows in memory, shape (n_times,)."""
    sums = np.empty(states.shape[1])
    # A part at a time stays in fast memory. Energies of motions above 1e150 m or so are infinite.
    with np.errstate(over="ignore", invalid="ignore"):
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


class _Last:
    """Arrays over some times, those computed last; large ones only as long as others hold them."""

    def __init__(self) -> None:
        self._times = b""
        self._parts: list[weakref.ref[NDArray[Any]]] = []
        self._held: tuple[NDArray[Any], ...] | None = None

    def at(self, times: Array) -> Any:
        """Return the arrays at some times; None where they are not known."""
        if self._times != times.tobytes():
            return None
        found = tuple(part() for part in self._parts)
        return found if found and all(part is not None for part in found) else None

    def keep(self, times: Array, parts: tuple[NDArray[Any], ...]) -> None:
        """Take the place of the last ones."""
        # A few times, as those of an energy at the start, do not take the place of many.
        if times.size > 1 or not self._parts:
            self._times, self._parts = times.tobytes(), [weakref.ref(part) for part in parts]
            self._held = parts if sum(part.size for part in parts) <= _MOST_KEPT else None


class EventSolution:
    """The run as a sequence of linear segments, each known in closed form."""

    continuous = True
    springs = None
    probes = None
    #: What a run in Ritz vectors leaves out, and these vectors, shape (n, n_modes); None where all modes are kept.
    truncation: Truncation | None = None
    vectors: Array | None = None
    #: Time of the loads in s at which the run begins.
    since = 0.0
    #: Sliders, whose rows are the last ones of the contacts; None where there are none.
    sliders: Sliders | None = None

    def __init__(self, system: System, space: ModalSpace, t_end: float, times: Array, counters: Counters) -> None:
        self.t_end = t_end
        self.times = times
        self.counters = counters
        # Eigensystems of a restored run are no work of that run.
        self._counted = counters
        self.notes: list[str] = []
        #: The system that the run was given, and as the run sees it: with further rows where there are sliders.
        self.given = self.system = system
        self.space = space
        self.was_cut = False
        # What `modal` and `pressed` have returned last.
        self._moved, self._pressed = _Last(), _Last()
        #: How the run was computed, and so how it is sampled.
        self.compiled = compiled()
        self.record = Record(space.size, space.contacts.shape[0])
        # Gap functions at the end of the last segment, before an event there.
        self.gaps_now: Array | None = None
        self._initial = np.empty(0, dtype=np.int64)
        self._bounces: tuple[tuple[int, int], Bounces] | None = None
        self.load_functions, self.load_vectors = gathered(system.loads, space.loads)
        self.moving = None if system.contacts is None else system.contacts.moving
        if self.moving is not None:
            # Offsets of contacts are functions of time that push nothing by themselves.
            self.load_functions = [*self.load_functions, *self.moving.functions]
            none = np.zeros((len(self.moving.functions), space.size))
            self.load_vectors = np.concatenate([self.load_vectors, none])

    def __getstate__(self) -> dict[str, Any]:
        """Return the solution without its last samples, which can be computed again."""
        return {**self.__dict__, "_moved": _Last(), "_pressed": _Last()}

    @classmethod
    def restored(
        cls, system: System, space: ModalSpace, t_end: float, times: Array, counters: Counters, notes: list[str],
        segments: Segments, events: Events,
    ) -> EventSolution:  # fmt: skip
        """Return the solution of an earlier run; eigensystems are computed when a segment is first asked for."""
        # The modes of the file are those of all runs of this system.
        system.cache.get("modal space", None, lambda: space)
        solution = cls(system, space, t_end, times, Counters())
        # Answers count their work apart from that of the run.
        _ = solution.linear
        solution.counters, solution.notes = counters, notes
        solution._take_over(segments, events)
        solution.since = float(segments.starts[0])
        return solution

    @cached_property
    def linear(self) -> Regimes:
        """The linear pieces of all statuses."""
        return Regimes(self.system, self.space, self.load_vectors, self._counted)

    @property
    def row_sizes(self) -> Array:
        """Bounds on the terms that the modal rows of the contacts are summed of, shape (n_contacts, n)."""
        return self.linear.row_sizes

    @property
    def modes(self) -> tuple[Array, Array]:
        """Squared frequencies (n_modes,) and shapes (n, n_modes) of the modes without contacts."""
        return self.space.stiffness, self._shapes

    @cached_property
    def _shapes(self) -> Array:
        return self.space.shapes if self.vectors is None else self.vectors @ self.space.shapes

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
        log = saved["log"]
        events = Events(log[:, 0], log[:, 1].astype(np.int64), log[:, 2].astype(np.int64), saved["initial"])
        self._take_over(Segments(*saved["segments"]), events)
        for name, value in vars(saved["counters"]).items():
            setattr(self.counters, name, value)
        self.gaps_now = saved["gaps"]
        t, status, displacement, velocity = saved["now"]
        return t, status, displacement, velocity

    def _take_over(self, segments: Segments, events: Events) -> None:
        """Take over the segments and events of an earlier run."""
        self.record.fill(segments, events)
        self._initial = events.initial

    def cut(self, t: float) -> None:
        """End the run at time t, before its end."""
        self.notes.append(interruption(t, self.t_end))
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
            self._check_rigid(laws, start.q)
            self.counters.gap_evaluations += len(laws)
            size = np.abs(laws.gap) + size
            touching = np.abs(laws.coordinates(start.q[:, None], np.array([t]))[:, 0] - laws.gap) <= 1e-12 * size
            for j in np.flatnonzero(touching & laws.jump):
                if should_pin(
                    self.space, laws, self._initial, int(j), (displacement, velocity), self.load(t), fraction
                ):
                    self._initial[j] = PINNED
        return self._initial

    def _check_rigid(self, laws: ContactLaws, q: Array) -> None:
        """Open the rigid stops at the start, which bodies may touch but not penetrate; raise where one does."""
        if not laws.rigid.any():
            return
        inside = np.where(laws.rigid, laws.rows @ q - laws.gap, 0.0)
        inside[inside <= 1e-12 * (abs(laws.rows) @ np.abs(q) + np.abs(laws.gap))] = 0.0
        if inside.any():
            j = int(np.argmax(inside))
            raise ArgumentError(
                f"{laws.labels[j]}: at the start the body is {inside[j]:.4g} m inside the stop, which is rigid; change "
                "its gap or the initial displacement"
            )
        self._initial[laws.rigid] = OPEN

    @property
    def bounces(self) -> Bounces | None:
        """The impacts on rigid stops; None without such stops."""
        laws = self.system.contacts
        if laws is None or not laws.rigid.any():
            return None
        if self._bounces is None or self._bounces[0] != (self.record.events, self.record.segments):
            found = bounces_of(laws, self.space.contacts, self.record, self.events)
            self._bounces = (self.record.events, self.record.segments), found
        return self._bounces[1]

    def begin_with(self, status: Status) -> None:
        """Begin with a known status, shape (n_contacts,)."""
        self._initial = status

    def _offsets(self, times: Array) -> Array:
        """Return what is added to the contacts' coordinates at times, m, shape (n_contacts, n_times)."""
        return np.zeros((len(self.space.contacts), 1)) if self.moving is None else self.moving.at(times)

    def drift(self) -> Array:
        """Return the factors with which loads enter the contacts' coordinates, shape (kinds, contacts, loads or 0)."""
        kinds, c = len(self.exosystem.omega), len(self.space.contacts)
        if self.moving is None:
            return np.zeros((kinds, c, 0))
        parts = [drift_of(self.system.contacts, part, len(self.load_functions)) for part in self.exosystem.function]
        return np.array(parts)

    def at_gaps(self, switched: NDArray[np.int64], displacement: Array, t: float) -> Array:
        """Return the displacement nearest to a given one at which some contacts are at their gaps at a time in s.

        If a contact's coordinate is a small difference of large modal displacements, it is not corrected, because the
        correction would change these displacements by its rounding.
        """
        assert self.system.contacts is not None
        rows, gap = self.space.contacts[switched], self.system.contacts.gap[switched]
        off = rows @ displacement + self._offsets(np.array([t]))[switched, 0] - gap
        if np.any(np.abs(rows) @ np.abs(displacement) > _CANCELLING * (np.abs(gap) + np.abs(off))):
            return displacement
        if switched.size == 1:
            return np.asarray(displacement - rows[0] * (off[0] / (rows[0] @ rows[0])))
        # Two contacts at one point have one row.
        return np.asarray(displacement - np.linalg.lstsq(rows, off, rcond=None)[0])

    def gaps_at(self, status: Status, displacement: Array, t: float) -> Array:
        """Return the gap functions at the begin, in s, of the segment that comes next, shape (n_contacts,)."""
        if self.system.contacts is None:
            return np.zeros(0)
        changed = status != self.record.last_status if self.record.segments else None
        return self._gaps(status, displacement, self.gaps_now, changed, t)

    def _gaps(
        self, status: Status, displacement: Array, before: Array | None, changed: NDArray[np.bool_] | None, t: float
    ) -> Array:
        """Return the gap functions at the begin of a segment.

        `before` (shape (n_contacts,)): those at the end of the segment before; without them they are computed from the
        displacement.
        `changed` (shape (n_contacts,)): contacts that have just switched.
        `t`: time in s.
        """
        laws, rows = self.system.contacts, self.space.contacts
        assert laws is not None
        if before is None:
            gaps = np.asarray(rows @ displacement + self._offsets(np.array([t]))[:, 0] - laws.gap)
            gaps[np.abs(gaps) <= _TOUCHING * (np.abs(rows) @ np.abs(displacement) + np.abs(laws.gap))] = 0.0
        else:
            gaps = before.copy()
        if changed is not None:
            gaps[changed] = 0.0
        gaps[status == PINNED] = 0.0
        return gaps

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
        events, laws = self.events, self.system.contacts
        self._note_energy()
        if laws is not None and np.any(open_throughout(laws, events)):
            # At times that the run chooses, so that notes do not depend on the times at which results are stored.
            z, _ = self.modal(np.linspace(0.0, self.t_end, _LOOKS))
            offsets = self._offsets(np.linspace(0.0, self.t_end, _LOOKS))
            self.notes += never_closed(laws, events, np.max(self.space.contacts @ z + offsets, axis=1))
        for j in np.unique(events.contact[events.status == PINNED]):
            assert laws is not None
            mine = events.contact == j
            if laws.rigid[j]:
                self.notes += self._accumulated(int(j))
                continue
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

    def _accumulated(self, j: int) -> list[str]:
        """Return a note on a body that came to rest at a rigid stop after bounces that accumulate."""
        laws, events = self.system.contacts, self.events
        assert laws is not None
        mine = events.contact == j
        pinned = events.time[mine & (events.status == PINNED)]
        bounced = events.time[mine & (events.status == CLOSED)]
        if laws.restitution[j] == 0.0 or not bounced.size:
            return []
        first = pinned[0]
        return [
            f"impacts: the impacts of {laws.labels[j]} accumulate (Zeno) at t = {first:.9g} s, after "
            f"{int(np.sum(bounced <= first))} of them; from there the body rests at the stop"
            + ("" if pinned.size == 1 else f". So they do {pinned.size - 1} times more")
        ]

    def _note_energy(self) -> None:
        """Write a note if the energy of a run without loads and dampers changes.

        For other runs the balance needs integrals over all segments, which cost up to a third of the run.
        """
        laws, events = self.system.contacts, self.events
        damped = self.system.damped or (laws is not None and bool(np.any(laws.damping > 0)))
        pinned = bool(np.any(events.status == PINNED) or np.any(events.initial == PINNED))
        if damped or pinned or self.system.loads or self.bounces is not None:
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

    def spectrum(self, index: int) -> Spectrum:
        """Return the eigensystem of a segment."""
        return self.linear.spectra[self.record.status(index)]

    @cached_property
    def exosystem(self) -> Exosystem:
        """The loads from the begin of the run to its end."""
        breaks = np.concatenate([[self.since], *(load.breakpoints(self.t_end) for load in self.load_functions)])
        edges = np.append(np.unique(breaks[(breaks >= self.since) & (breaks < self.t_end)]), self.t_end)
        constant = self.given.sliders is not None or pushes(self.system.contacts)
        return exosystem(self.load_functions, edges, constant=constant)

    def regime(self, status: Status, kind: int) -> Regime:
        """Return the linear piece of a contact status under loads of a kind."""
        return self.linear.of(status, self.exosystem, kind)

    def loads_at(self, regime: Regime, times: Array, displacement: Array, gaps: Array) -> Array:
        """Return states of the loads (m, 2, e) at the beginnings of segments in modal displacements (m, n)."""
        return self.exosystem.at(times)

    def regimes(self, segments: NDArray[np.int64]) -> Iterator[tuple[Regime, NDArray[np.int64]]]:
        """Yield the linear pieces of some segments, each with the places in `segments` of those that have it."""
        record, loads = self.record, self.exosystem
        kind = loads.kind[loads.interval(record.starts[segments])]
        key = record.status_numbers[segments] * len(loads.omega) + kind
        order = np.argsort(key, kind="stable")
        for mine in np.split(order, np.flatnonzero(np.diff(key[order])) + 1) if order.size else ():
            yield self.regime(record.status(segments[mine[0]]), int(kind[mine[0]])), mine

    def begins(self, regime: Regime, segments: NDArray[np.int64]) -> Array:
        """Return the states of all blocks at the beginnings of some segments, shape (k, 2, M)."""
        parts, displacement = self.record.buffers, self.record.buffers.displacement[segments]
        w = self.loads_at(regime, self.record.starts[segments], displacement, parts.gaps[segments])
        return regime.begin(displacement, parts.velocity[segments], w)

    # -- sampling ---------------------------------------------------------------------------------

    @_evaluation
    def modal(self, times: Array) -> tuple[Array, Array]:
        """Return modal displacements and velocities at any times, each of shape (n, n_times).

        The last ones are kept, because motion and energies are usually computed at the same times.
        """
        found = self._moved.at(times)
        return self._both(times)[0] if found is None else found

    def moved(
        self, times: Array, segments: NDArray[np.int64] | None = None
    ) -> Iterator[tuple[Regime, NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], Array, Array]]:
        """Yield linear pieces, places of times within them, and by how much states have changed there.

        `segments` (shape (n_times,)): the segment of each time; by default the one in which it lies.
        Each place comes with numbers of segments (k,), which of these it belongs to (m,), the states of all blocks at
        their beginnings (k, 2, M), and the changes (m, 2, M).
        """
        starts, together = self.record.starts, max(_TOGETHER // max(self.space.size, 1), 1)
        if segments is None:
            segments = np.clip(np.searchsorted(starts, times, side="right") - 1, 0, None)
        for regime, group in self.regimes(segments):
            for mine in np.split(group, range(together, group.size, together)):
                used, own = np.unique(segments[mine], return_inverse=True)
                begins = self.begins(regime, used)
                yield regime, mine, used, own, begins, regime.changes(begins, own, times[mine] - starts[segments[mine]])

    def _begun(self, regime: Regime, segments: NDArray[np.int64], begins: Array) -> tuple[Array, Array]:
        """Return modal displacements and velocities at the beginnings of segments, each (k, n)."""
        if regime.held:
            return regime.to_modes(begins, shifted=True)
        return self.record.buffers.displacement[segments], self.record.buffers.velocity[segments]

    def status_at(self, times: Array) -> Status:
        """Return the status of all contacts at some times, shape (n_contacts, n_times)."""
        return status_at(self.events, times)

    @_evaluation
    def pressed(self, times: Array) -> tuple[Array, Array, Status]:
        """Return gap functions in m, forces in N and status of all contacts, each (n_contacts, n_times).

        They are rows over the states of blocks, so that no modes are computed. The last ones are kept.
        """
        found = self._pressed.at(times)
        return self._visit(times) if found is None else found

    def _both(self, times: Array) -> tuple[tuple[Array, Array], tuple[Array, Array, Status]]:
        """Return `modal` and `pressed`."""
        modes, pressed = self._moved.at(times), self._pressed.at(times)
        if modes is not None and pressed is not None:
            return modes, pressed
        # In memory each row holds one time.
        modes = (np.empty((times.size, self.space.size)).T, np.empty((times.size, self.space.size)).T)
        pressed = self._visit(times, modes)
        self._moved.keep(times, modes)
        return modes, pressed

    def _visit(self, times: Array, modes: tuple[Array, Array] | None = None) -> tuple[Array, Array, Status]:
        """Return `pressed`, and fill in modal displacements and velocities, each (n, n_times)."""
        laws, rows, record = self.system.contacts, self.space.contacts, self.record
        s, rates, held = np.empty((len(rows), times.size)), np.zeros((len(rows), times.size)), []
        damped = laws is not None and bool(np.any(laws.damping))
        for regime, mine, used, own, begins, moved in self.moved(times):
            first, rate = self._begun(regime, used, begins)
            if modes is not None:
                displacement, velocity = regime.to_modes(moved)
                modes[0].T[mine], modes[1].T[mine] = first[own] + displacement, rate[own] + velocity
            if laws is None:
                continue
            s[:, mine] = record.buffers.gaps[used].T[:, own] + regime.coordinates @ flat(moved).T
            if damped:
                speed = rows @ rate.T
                rates[:, mine] = speed[:, own] + regime.over_blocks(rows)[len(rows) :] @ flat(moved).T
            if regime.held:
                number = np.flatnonzero(record.status(int(used[0])) == PINNED)
                # The interval's ends are roots, found to rounding.
                jump = np.where(laws.rigid, np.inf, laws.stiffness * laws.gap)[number, None]
                held.append((number, mine, np.clip(regime.reactions @ flat(begins[own] + moved).T, 0.0, jump)))
            if regime.sliding is not None:
                number = np.arange(regime.sliding.sliders.first, len(laws))
                held.append((number, mine, regime.sliding.forces @ flat(begins[own] + moved).T))
        if self.moving is not None:
            rates = rates + self.moving.rate(times)
        status = np.zeros(s.shape, dtype=np.int64) if laws is None else self.status_at(times)
        force = rates if laws is None else laws.force(s, rates, status)
        for number, mine, values in held:
            force[np.ix_(number, mine)] = values
        self._pressed.keep(times, (s, force, status))
        return s, force, status

    @_evaluation
    def sample(self, times: Array) -> ModalSamples:
        """Return the motion at any times; the acceleration is that of the equation of motion."""
        (z, v), pressed = self._both(times)
        # Samples hold the forces, which contacts and energies at the same times need too.
        return ModalSamples(self._shapes, z, v, lambda: self.acceleration(times, z, v, pressed[1]))

    @_evaluation
    def acceleration(self, times: Array, z: Array, v: Array, force: Array) -> Array:
        """Return the modal acceleration at times, shape (n, n_times), of states and forces of the contacts there."""
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
            rows -= force.T @ space.contacts
        return rows.T

    def contacts(self, times: Array) -> ContactSamples:
        """Return status, K_eq and force of the contacts at any times."""
        laws = self.system.contacts
        assert laws is not None
        _, force, status = self.pressed(times)
        stiffness = np.where(status == CLOSED, laws.stiffness[:, None], 0.0)
        gap = np.where(laws.gap > 0, laws.gap, 1.0)[:, None]
        held = np.where(laws.rigid[:, None], np.inf, force / gap)
        own = slice(self.events.initial.size)
        return ContactSamples(status[own], np.where(status == PINNED, held, stiffness)[own], force[own])

    @cached_property
    @_evaluation
    def sensitivity(self) -> Sensitivity:
        """Growth of a perturbation along the run, in closed form."""
        return Sensitivity(np.append(self.segment_starts, self.t_end), growth_along(self))

    def bounced(self, index: int) -> int | None:
        """Return the rigid stop off which something bounces at the end of a segment, None where nothing does."""
        laws, parts, numbers = self.system.contacts, self.record.buffers, self.record.events_after(index)
        if laws is None or not numbers or parts.event_status[numbers[0]] != CLOSED:
            return None
        j = int(parts.event_contact[numbers[0]])
        return j if laws.rigid[j] else None

    def _jumps(self, index: int) -> bool:
        """Return whether forces or velocities may jump at the end of a segment: anything but releases does this."""
        before, after = self.record.status(index), self.record.status_after(index)
        return self.bounced(index) is not None or bool(np.any((before != after) & (before != PINNED)))

    def passage(self, index: int, end: tuple[Array, Array] | None = None) -> Passage | None:
        """Return what the events at the end of a segment do to small changes, None where nothing happens there.

        What a jump of force lets go of at once, after segments of no duration, is part of the events of the jump.
        `end`: modal state, each (n,), at the end of the last segment; events there count with it.
        """
        laws, record, numbers = self.system.contacts, self.record, self.record.events_after(index)
        inner = index + 1 < record.segments
        if laws is None or not numbers or not (inner or end is not None):
            return None
        t = float(record.starts[index] + record.durations[index])
        if inner:
            t, end = float(record.starts[index + 1]), record.state(index + 1)
        jumps, first, last = self._jumps(index), index, index
        while jumps and last + 1 < record.segments and record.still(last + 1) and not self._jumps(last + 1):
            if not record.events_after(last + 1):
                break
            last += 1
        while not jumps and first > 0 and record.still(first):
            first -= 1
            if self._jumps(first):
                return None
        assert end is not None
        struck = self.bounced(index)
        states = record.status(index), record.status_after(index), record.status_after(last)
        velocity = end[1] if struck is None else record.state(index)[1]
        # What is released after no time at which nothing else happens follows a jump of a load.
        fixed = not jumps and (record.still(first) or not record.events_after(first))
        return passage(
            self.space, laws, range(numbers.start, record.events_after(last).stop), states, end[0], velocity,
            self.load(t), struck=struck, fixed=fixed,
        )  # fmt: skip

    @property
    def start_energy(self) -> float:
        """Kinetic, strain and contact energy at t = 0."""
        start = self.energies(np.zeros(1))
        return float(start.kinetic[0] + start.strain[0] + start.contact[0] + start.dissipated[0])

    @_evaluation
    def energies(self, times: Array) -> Energies:
        """Return energies, dissipation and work at any times, in closed form."""
        from vofem.integrators.event_driven.energy import work_and_dissipation

        system, space = self.system, self.space
        z, v = self.modal(times)
        contact, work, dissipated = np.zeros((3, times.size))
        damped, pinning = system.damped, None
        if system.contacts is not None:
            s, _, status = self.pressed(times)
            contact = system.contacts.closed_potential(s, status)
            damped = damped or bool(np.any(system.contacts.damping > 0))
            pinning = self._lost_in_impacts()
        if (damped or system.loads or pinning is not None) and times.size:
            work, dissipated = work_and_dissipation(self.record, self.regimes, self.begins, times, pinning)
        kinetic, strain = 0.5 * _sums_of_squares(v, np.ones(space.size)), 0.5 * _sums_of_squares(z, space.stiffness)
        return Energies(kinetic, strain, contact, dissipated, work)

    def _lost_in_impacts(self) -> Array | None:
        """Return the kinetic energy that is lost at the begin of every segment, J; None where none is.

        Pinning takes the energy of the normal velocity, which `pinned` removes, and a rigid stop its part of it.
        """
        events, bounces = self.events, self.bounces
        if not (bounces is not None or np.any(events.status == PINNED) or np.any(events.initial == PINNED)):
            return None
        # Bounces at the very end begin no segment.
        lost = np.zeros(self.record.segments + 1)
        if bounces is not None:
            struck = events.status[bounces.event] == CLOSED
            np.add.at(lost, bounces.segment[struck], bounces.lost[struck])
        contacts = len(events.initial)
        for index in range(self.record.segments):
            number = np.flatnonzero(self.record.status(index) == PINNED)
            # A segment of no duration holds the state before a bounce, whose loss is known.
            if number.size and number[0] < contacts and self.record.durations[index] > 0.0:
                held = self.space.contacts[number]
                # Sliders that stick follow their belts and lose nothing.
                speed = np.where(number < contacts, held @ self.record.state(index)[1], 0.0)
                lost[index] += 0.5 * speed @ np.linalg.solve(held @ held.T, speed)
        return lost
