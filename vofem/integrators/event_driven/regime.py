"""A linear piece of a run: the blocks of one contact status and of its loads, and everything that is a row over them.

States of all blocks are arrays (2, M), displacements above velocities, loads before the blocks of the structure. From
a modal state (x, x') and the loads w, with the steady answers B of the blocks,

    y = into (V' (x - shift), V' x') - B w,    x = shift + V (out (y + B w)).

The columns of B belong to the values of the loads and, after them, to their rates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.blocks import Blocks, blocks_of, changes, row_changes
from vofem.integrators.event_driven.clusters import group_of
from vofem.integrators.event_driven.exosystem import CONSTANT
from vofem.integrators.event_driven.pinned import Reactions, reactions
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.system import CLOSED, OPEN, PINNED, ContactLaws

if TYPE_CHECKING:
    from vofem.integrators.event_driven.modal_space import ModalSpace
    from vofem.integrators.event_driven.sliders import Pushes, Sliders, SlidingPiece

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: A harmonic counts as resonant where the steady answer would exceed ten times the static one.
RESONANT = 0.1


class Answers(NamedTuple):
    """What the blocks of a status do under loads.

    Attributes
    ----------
    steady : ndarray, shape (2m, 2e)
        B.
    drive : ndarray, shape (2m, 2e)
        Inputs to the blocks that have no answer, by values and rates of the loads.
    apart : ndarray of bool, shape (m, e)
        Pairs of blocks and loads without a steady answer.
    """

    steady: Array
    drive: Array
    apart: NDArray[np.bool_]


def answers(
    spectrum: Spectrum, sources: Array, omega: Array, horizon: float, bend: Integers | None = None,
    rates: Array | None = None,
) -> Answers:  # fmt: skip
    """Return what the blocks of a status do under loads of some frequencies.

    Parameters
    ----------
    sources : ndarray, shape (n, e)
        Modal forces of the loads.
    omega : ndarray, shape (e,)
        Frequencies in rad/s, 0 for lines.
    bend : ndarray of int, shape (e,), optional
        See `Exosystem`.
    rates : ndarray, shape (n, e), optional
        Modal forces of the loads' rates.
    horizon : float
        Longest time in s for which a motion is computed. A block that is slower than that is treated as rigid.
    """
    m, e = spectrum.p.size, omega.size
    delta, p = spectrum.delta[:, None], spectrum.p[:, None]
    line, slow = omega == 0.0, p * horizon**2 < 1.0
    steady, drive = np.zeros((2 * m, 2 * e)), np.zeros((2 * m, 2 * e))
    force = spectrum.real.down(sources)
    rest, more = _static(spectrum, force, line, horizon, steady)
    if rates is not None:
        more = more + spectrum.real.down(rates)
    drive[:, :e], drive[:, e:] = spectrum.real_inputs(rest), spectrum.real_inputs(more)
    impedance = p - omega**2 + 2j * delta * omega
    apart = (slow & (omega * horizon < 1.0)) | (np.abs(impedance) < RESONANT * np.maximum(p, omega**2))
    plain = np.ones((m, 1), dtype=bool) if spectrum.plain is None else spectrum.plain[:, None] > 0.0
    answered = plain & ~apart
    _answer(drive, steady, spectrum, omega, answered, rates is not None)
    bent = np.flatnonzero(bend >= 0) if bend is not None else np.zeros(0, dtype=np.int64)
    if bent.size:
        # The answer to the rate of a line that is bent changes with the line's second derivative.
        assert bend is not None
        more, others = np.zeros((2 * m, 2 * bent.size)), np.zeros((2 * m, 2 * bent.size))
        more[:, : bent.size] = -steady[:, e + bent]
        known = answered[:, bend[bent]]
        _answer(more, others, spectrum, omega[bend[bent]], known, False)
        columns = np.concatenate([bend[bent], e + bend[bent]])
        steady[:, columns], drive[:, columns] = others, more
    drive[np.tile(answered, (2, 2))] = 0.0
    return Answers(steady, drive, apart)


def _answer(
    drive: Array, steady: Array, spectrum: Spectrum, omega: Array, answered: NDArray[np.bool_], braked: bool
) -> None:  # fmt: skip
    """Add the steady answers of blocks that have one to inputs by values and rates of loads, (2m, 2e), to `steady`.

    `answered` is of shape (m, e); `braked` says whether rates of harmonics are inputs too.
    """
    m, e = spectrum.p.size, omega.size
    delta, p, line = spectrum.delta[:, None], spectrum.p[:, None], omega == 0.0
    safe = np.where(answered, p - omega**2 + 2j * delta * omega, 1.0)
    g1, g2 = drive[:m, :e] * answered, drive[m:, :e] * answered
    h1, h2 = drive[:m, e:] * answered, drive[m:, e:] * answered
    w1, w2 = (g1 + 1j * omega * h1, g2 + 1j * omega * h2) if braked else (g1, g2)
    z = ((2.0 * delta + 1j * omega) * w1 + w2) / safe
    v = 1j * omega * z - w1
    steady[:m, :e] += z.real
    steady[m:, :e] += v.real
    # The rate of a harmonic is its imaginary part; a line that rises has the answer to its value, and one more.
    frequency = np.where(line, 1.0, omega)
    later = z.real - h1
    last = (h2 - 2.0 * delta * later - v.real) / np.where(line & answered, p, 1.0)
    steady[:m, e:] += np.where(line, last * answered, z.imag / frequency)
    steady[m:, e:] += np.where(line, later * answered, v.imag / frequency)


def _static(
    spectrum: Spectrum, force: Array, line: NDArray[np.bool_], horizon: float, steady: Array
) -> tuple[Array, Array]:
    """Add the static answers of complex modes to lines; return the forces left, by values and rates, each (m, e).

    The force of a stiff contact behind a gap is so large that its rounding would spoil slow blocks. Its static
    displacement is small and does not.
    """
    more = np.zeros_like(force)
    if spectrum.blocks is None or not line.any():
        return force, more
    assert spectrum.damping is not None
    p = spectrum.real.p[:, None]
    fast, nothing = p * horizon**2 >= 1.0, np.zeros_like(force)
    safe = np.where(fast, p, 1.0)
    rate = np.where(fast & line, force / safe, 0.0)
    braked = -spectrum.damping @ rate
    late = np.where(fast, braked / safe, 0.0)
    steady += spectrum.blocks.into @ np.block([[rate, late], [nothing, rate]])
    return np.where(fast & line, 0.0, force), np.where(fast, 0.0, braked)


class MovingStops(NamedTuple):
    """Contacts whose coordinates have an offset that depends on time, in one status.

    Attributes
    ----------
    rows : ndarray, shape (n_contacts, n)
        Modal rows.
    drift : ndarray, shape (n_contacts, e)
        Factors with which the loads enter the coordinates.
    stiffness, damping, offset : ndarray, shape (n_contacts,)
        Stiffness and damping are zero unless the contact is closed.
    """

    rows: Array
    drift: Array
    stiffness: Array
    damping: Array
    offset: Array


def drift_of(laws: ContactLaws | None, function: Integers, functions: int) -> Array | None:
    """Return the factors with which loads enter the coordinates of contacts, (n_contacts, e); None where none does.

    Parameters
    ----------
    function : ndarray of int, shape (e,)
        See `Exosystem`; the offsets of contacts are the last functions.
    functions : int
        Number of all functions.
    """
    if laws is None or laws.moving is None:
        return None
    weights = laws.moving.weights
    number = function - (functions - weights.shape[1])
    return np.where(number >= 0, weights[:, np.maximum(number, 0)], 0.0)


def moving_stops(
    space: ModalSpace, laws: ContactLaws | None, status: Integers, function: Integers, functions: int
) -> MovingStops | None:
    """Return the contacts that bases move in a status; see `drift_of`."""
    drift = drift_of(laws, function, functions)
    if drift is None:
        return None
    assert laws is not None
    closed = status == CLOSED
    return MovingStops(
        space.contacts, drift, np.where(closed, laws.stiffness, 0.0), np.where(closed, laws.damping, 0.0), laws.offset
    )


@dataclass(frozen=True)
class Regime:
    """A contact status under loads of one kind.

    Attributes
    ----------
    spectrum : Spectrum
    answers : Answers
    blocks : Blocks
    levels : ndarray of int
        Numbers of blocks at which the frequency has grown by another factor; the last is all blocks.
    mixed : bool
        Whether rows have velocities of the blocks of the structure.
    rows, sizes : ndarray, shape (k, 2, M)
        Event functions as rows over the blocks, and bounds on their terms. They are negative until an event.
    sign : ndarray, shape (k,)
        Sign of the gap function that an event function is; 0 for reactions, which are their rows at any time.
    level : ndarray, shape (k,)
        Size of the constants in the event functions.
    owner, leads : ndarray of int, shape (k,)
        The contact of each event function, and the status to which it leads.
    coordinates : ndarray, shape (n_contacts, 2M)
        The contacts' coordinates, but for their shift, as rows.
    reactions : Reactions, optional
        Reactions of the pinned contacts; None where none is pinned.
    vectors : ndarray, shape (n_functions, n)
        Modal load vectors.
    function : ndarray of int, shape (e,)
        The function that each load is a part of.
    horizon : float
        Longest time in s for which a motion is computed.
    stops : MovingStops, optional
        Contacts that the motion of bases moves; None where there are none.
    bend : ndarray of int, shape (e,)
        See `Exosystem`.
    sliding : SlidingPiece, optional
        Sliders; None where there are none.
    """

    spectrum: Spectrum
    answers: Answers
    blocks: Blocks
    levels: Integers
    mixed: bool
    rows: Array
    sizes: Array
    sign: Array
    level: Array
    owner: Integers
    leads: Integers
    coordinates: Array
    reactions: Reactions | None
    vectors: Array
    function: Integers
    horizon: float
    stops: MovingStops | None
    bend: Integers
    sliding: SlidingPiece | None = None

    @property
    def loads(self) -> int:
        """Number of loads e."""
        return int(self.answers.apart.shape[1])

    @property
    def held(self) -> bool:
        """Whether contacts are pinned."""
        return self.reactions is not None

    @cached_property
    def load_rows(self) -> Array:
        """The power of the loads as rows over the structure's blocks, by their values and rates, shape (2e, 2m)."""
        loads, function = self.loads, self.function
        rows = np.zeros((2 * loads, 2 * self.spectrum.p.size))
        mine = np.flatnonzero(function >= 0)
        rows[mine] = self.velocities(self.vectors[function[mine]])
        return rows

    def velocities(self, rows: Array) -> Array:
        """Return modal rows (k, n) that take velocities as rows over the structure's blocks, shape (k, 2m)."""
        spectrum, m = self.spectrum, self.spectrum.p.size
        local = np.asarray(spectrum.real.down(rows.T)).T
        if spectrum.blocks is None:
            return np.concatenate([np.zeros((len(local), m)), local], axis=1)
        return np.asarray(local @ spectrum.blocks.out[m:])

    @cached_property
    def power(self) -> Array:
        """The power of the dampers as a quadratic form of the structure's blocks, (2m, 2m), or its diagonal, (2m,)."""
        spectrum = self.spectrum
        m = spectrum.p.size
        if spectrum.blocks is None:
            return np.concatenate([np.zeros(m), 2.0 * spectrum.delta])
        assert spectrum.damping is not None
        out = spectrum.blocks.out[m:]
        return np.asarray(out.T @ spectrum.damping @ out)

    @cached_property
    def kept(self) -> dict[str, Any]:
        """What others have computed for the piece."""
        return {}

    def begin(self, displacement: Array, velocity: Array, w: Array) -> Array:
        """Return the states of all blocks, shape (k, 2, M), of modal states (k, n) under loads (k, 2, e)."""
        if self.sliding is not None:
            carried = self.sliding.pushes.carried.T
            displacement, velocity = displacement - w[:, 0] @ carried, velocity - w[:, 1] @ carried
        y = np.concatenate(self.spectrum.to_blocks(displacement.T, velocity.T)).T
        y = y - flat(w) @ self.answers.steady.T
        return np.concatenate([w, y.reshape(len(y), 2, self.spectrum.p.size)], axis=2)

    def to_modes(self, states: Array, *, shifted: bool = False) -> tuple[Array, Array]:
        """Return modal displacements and velocities, each (k, n), of states (k, 2, M) or of changes of states."""
        e, m = self.loads, self.spectrum.p.size
        y = flat(states[:, :, e:]) + flat(states[:, :, :e]) @ self.answers.steady.T
        x, rate = self.spectrum.to_modes(y[:, :m].T, y[:, m:].T, shifted=shifted)
        if self.sliding is not None:
            carried = self.sliding.pushes.carried
            return (x + carried @ states[:, 0, :e].T).T, (rate + carried @ states[:, 1, :e].T).T
        return x.T, rate.T

    def over_blocks(self, rows: Array) -> Array:
        """Return modal rows (k, n) of displacements and then those of velocities as rows over all blocks, (2k, 2M)."""
        key = f"rows {rows.tobytes().hex()}"
        if key not in self.kept:
            own = rows if self.spectrum.real.modes is None else rows @ self.spectrum.real.modes
            nothing = np.zeros_like(own)
            w, u = self.spectrum.functions(np.concatenate([own, nothing]), np.concatenate([nothing, own]))
            self.kept[key] = flat(_over_all(w, u, self.answers.steady))
        found: Array = self.kept[key]
        return found

    def changes(self, starts: Array, own: Integers, tau: Array) -> Array:
        """Return by how much states have changed, shape (n_times, 2, M); see `blocks.changes`."""
        return changes(self.blocks, starts, own, tau)


@dataclass(frozen=True)
class Motion:
    """The motion of a segment.

    Attributes
    ----------
    regime : Regime
    displacement, velocity : ndarray, shape (n,)
        Modal state at tau = 0, pinned contacts at their gaps.
    start : ndarray, shape (2, M)
        States of all blocks at tau = 0.
    """

    regime: Regime
    displacement: Array
    velocity: Array
    start: Array

    @property
    def spectrum(self) -> Spectrum:
        """The eigensystem of the status."""
        return self.regime.spectrum

    def changes(self, tau: Array) -> Array:
        """Return by how much the states of all blocks have changed at some times, shape (n_times, 2, M)."""
        return self.regime.changes(self.start[None], np.zeros(tau.size, dtype=np.int64), np.asarray(tau, dtype=float))

    def mode_changes(self, tau: Array) -> tuple[Array, Array]:
        """Return by how much modal displacements and velocities have changed, each of shape (n, n_times)."""
        displacement, velocity = self.regime.to_modes(self.changes(tau))
        return displacement.T, velocity.T

    def sampled(self, rows: Array, low: float, high: float, count: int) -> tuple[Array, Array, Array]:
        """Return times, at least so many equal steps, and modal rows (k, n) of displacements and velocities there."""
        blocks, over = self.regime.blocks, self.regime.over_blocks(rows)
        fine = max(int(np.sqrt(count)), 1) if blocks.group is None else 1
        tau = np.linspace(low, high, -(-count // fine) * fine + 1)
        changes = flat(self.changes(tau[::fine]))
        values = over @ changes.T
        if fine > 1:
            # Each of these times begins a few steps over which the rows change.
            later = row_changes(blocks, over.reshape(len(over), *self.start.shape), tau[:fine] - low)
            more = (changes + self.start.ravel()) @ later.reshape(-1, changes.shape[1]).T
            values = values[:, :, None] + more.reshape(len(changes), fine, len(over)).transpose(2, 0, 1)
            values = values.reshape(len(over), -1)[:, : tau.size]
        begin = np.concatenate([rows @ self.displacement, rows @ self.velocity])
        displacement, velocity = np.split(values + begin[:, None], 2)
        return tau, displacement, velocity

    def reactions(self, tau: Array) -> Array:
        """Return the reactions of the pinned contacts at some times, shape (k, n_times)."""
        assert self.regime.reactions is not None
        states = self.start + self.changes(tau)
        return np.asarray(self.regime.reactions.row @ flat(states).T)

    def modes(self, tau: Array) -> tuple[Array, Array]:
        """Return modal displacements and velocities, each of shape (n, n_times)."""
        displacement, velocity = self.mode_changes(tau)
        return displacement + self.displacement[:, None], velocity + self.velocity[:, None]


def start_motion(regime: Regime, displacement: Array, velocity: Array, w: Array) -> Motion:
    """Return the motion that starts from a modal state, each (n,), with values and rates (2, e) of the loads."""
    start = regime.begin(displacement[None], velocity[None], w[None])
    if regime.held:
        displacement, velocity = (part[0] for part in regime.to_modes(start, shifted=True))
    return Motion(regime, displacement, velocity, start[0])


def regime_of(
    spectrum: Spectrum, space: ModalSpace, laws: ContactLaws | None, status: Integers, row_sizes: Array,
    vectors: Array, load: tuple[Integers, Array, Integers], horizon: float, sliders: Sliders | None = None,
) -> Regime:  # fmt: skip
    """Return a contact status under loads.

    Parameters
    ----------
    row_sizes : ndarray, shape (n_contacts, n)
        Bounds on the terms that the modal rows of the contacts are summed of.
    vectors : ndarray, shape (n_functions, n)
        Modal load vectors.
    load : (ndarray of int, ndarray, ndarray of int)
        Functions and frequencies of the loads, and what bends them, see `Exosystem`.
    horizon : float
        Longest time in s for which a motion is computed.
    sliders : Sliders, optional
        Those that are the last rows of `space.contacts`.
    """
    function, omega, bend = load
    m, e, n = spectrum.p.size, omega.size, space.size
    sources, stops = np.zeros((n, e)), moving_stops(space, laws, status, function, vectors.shape[0])
    sources[:, function >= 0] = vectors[function[function >= 0]].T
    if laws is not None and CONSTANT in function[:1]:
        push = (laws.stiffness * laws.offset * (status == CLOSED)) @ space.contacts
        sources[:, 0] = push if spectrum.real.shift_force is None else push + spectrum.real.shift_force
    rates = None
    if stops is not None:
        sources -= stops.rows.T @ (stops.stiffness[:, None] * stops.drift)
        rates = -stops.rows.T @ (stops.damping[:, None] * stops.drift)
    pushes = None
    if sliders is not None:
        assert laws is not None
        pushes = sliders.pushes(space, laws, status, spectrum, function, omega, bend)
        sources, rates = sources + pushes.sources, pushes.rates
    found = answers(spectrum, sources, omega, horizon, bend, rates)
    driven = found.drive.reshape(2, m, 2, e)
    members = np.zeros(m, dtype=bool) if spectrum.plain is None else spectrum.plain == 0.0
    pair = np.argwhere(np.any(driven, axis=(0, 2)) & ~members[:, None])
    gain = np.ascontiguousarray(driven[:, pair[:, 0], :, pair[:, 1]].reshape(len(pair), 4))
    bent = np.flatnonzero(bend >= 0)
    pairs = np.concatenate([
        np.column_stack([bent, bend[bent], np.full(bent.size, -2)]),
        np.column_stack([e + pair[:, 0], pair[:, 1], bend[pair[:, 1]]]),
    ])  # fmt: skip
    gain = np.concatenate([np.tile([0.0, 0.0, 1.0, 0.0], (bent.size, 1)), gain])
    clusters = () if spectrum.blocks is None else spectrum.blocks.clusters
    blocks = blocks_of(
        np.concatenate([np.zeros(e), spectrum.delta]), np.concatenate([omega**2, spectrum.p]),
        pairs, gain, group_of(clusters, found.drive, omega, bend, horizon),
    )  # fmt: skip
    none = np.zeros(0, dtype=np.int64)
    parts = spectrum.rows(space.contacts, row_sizes)
    w, u, w_size, u_size = (part if part.shape[1] else np.zeros((len(space.contacts), m)) for part in parts)
    coordinates = _over_all(w, u, found.steady)
    if stops is not None:
        coordinates[:, 0, :e] += stops.drift
    if pushes is not None:
        assert sliders is not None
        coordinates[:, 0, :e] += space.contacts @ pushes.carried
        coordinates[sliders.first :, 0, :e] -= pushes.anchors
    sizes = np.abs(coordinates)
    sizes[:, 0, e:], sizes[:, 1, e:] = w_size, u_size
    plain = np.flatnonzero(status != PINNED) if laws is not None else none
    sign = np.where(status[plain] == CLOSED, -1.0, 1.0)
    rows = [sign[:, None, None] * coordinates[plain]]
    level = none.astype(float) if laws is None else laws.gap[plain]
    held = np.flatnonzero(status == PINNED) if laws is not None else none
    force, all_sizes, yields = None, [sizes[plain]], none
    if laws is not None and held.size:
        if spectrum.real.shift is not None:
            level = level - space.contacts[plain] @ spectrum.real.shift
        force = reactions(space, laws, status, spectrum, sources)
        w, u = spectrum.functions(force.displacement, force.velocity)
        own = _over_all(w, u, found.steady)
        own[:, 0, :e] += force.loads
        if pushes is not None:
            held_rows = space.contacts[held]
            own[:, 0, :e] += pushes.reaction
            own[:, 1, :e] += np.linalg.solve(held_rows @ held_rows.T, held_rows @ pushes.rates)
        own_sizes = np.abs(own)
        own_sizes[:, 0, e:], own_sizes[:, 1, e:] = spectrum.sizes(np.abs(force.displacement), np.abs(force.velocity))
        # The reaction of a rigid stop has no upper limit.
        limited = ~laws.rigid[held]
        yields, jump = held[limited], (laws.stiffness[held] * laws.gap[held])[limited]
        above = own[limited]
        above[:, 0, 0] -= jump
        rows += [-own, above]
        all_sizes += [own_sizes, own_sizes[limited]]
        level = np.concatenate([level, np.zeros(held.size), jump])
        force = force._replace(row=flat(own))
    whole = np.concatenate(rows)
    regime = Regime(
        spectrum, found, blocks, e + spectrum.levels, bool(np.any(whole[:, 1, e:])), whole,
        np.concatenate(all_sizes), np.concatenate([sign, np.zeros(held.size + yields.size)]), np.abs(level),
        np.concatenate([plain, held, yields]),
        np.concatenate([np.where(sign < 0.0, OPEN, CLOSED), np.full(held.size, OPEN), np.full(yields.size, CLOSED)]),
        flat(coordinates), force, vectors, function, horizon, stops, bend,
    )  # fmt: skip
    if sliders is None or pushes is None or laws is None:
        return regime
    return _with_sliders(regime, sliders, pushes, space, laws, status, coordinates, sizes)


def _with_sliders(
    regime: Regime, sliders: Sliders, pushes: Pushes, space: ModalSpace, laws: ContactLaws, status: Integers,
    coordinates: Array, sizes: Array,
) -> Regime:  # fmt: skip
    """Return a linear piece in which sliders have the event functions of their statuses."""
    from vofem.integrators.event_driven.sliders import SlidingPiece

    spectrum, e, first = regime.spectrum, regime.loads, sliders.first
    rows = space.contacts[first:]
    modal = rows if spectrum.real.modes is None else rows @ spectrum.real.modes
    bounds = np.abs(rows) if spectrum.real.modes is None else np.abs(rows) @ np.abs(spectrum.real.modes)
    w, u = spectrum.functions(np.zeros_like(modal), modal)
    speeds = _over_all(w, u, regime.answers.steady)
    speeds[:, 1, :e] += rows @ pushes.carried - pushes.anchors
    speed_sizes = np.abs(speeds)
    speed_sizes[:, 0, e:], speed_sizes[:, 1, e:] = spectrum.sizes(np.zeros_like(bounds), bounds)
    held, reaction = np.flatnonzero(status == PINNED), None
    if regime.reactions is not None:
        own = regime.reactions.row.reshape(held.size, 2, -1)
        # Bounds of the reactions are those of their functions.
        reaction = own, np.array([regime.sizes[(regime.owner == j) & (regime.sign == 0.0)][0] for j in held])
    exits = sliders.exits(status, pushes, coordinates, (speeds, speed_sizes), reaction, sizes)
    signs, own_status = sliders.signs(status), status[first:]
    forces = np.zeros((len(sliders), 2, coordinates.shape[2]))
    forces[:, 0, 0] = signs * sliders.limit
    for j in range(len(sliders)):
        if own_status[j] == CLOSED:
            forces[j] = sliders.stiffness[j] * coordinates[first + j]
            if spectrum.real.shift is not None:
                forces[j, 0, 0] += sliders.stiffness[j] * (rows[j] @ spectrum.real.shift)
        elif own_status[j] == PINNED:
            assert reaction is not None
            forces[j] = reaction[0][held.tolist().index(first + j)]
    kept = regime.owner < first
    whole = np.concatenate([regime.rows[kept], exits.rows])
    dampers = np.where(status == CLOSED, laws.damping, 0.0)
    return replace(
        regime,
        rows=whole,
        sizes=np.concatenate([regime.sizes[kept], exits.sizes]),
        sign=np.concatenate([regime.sign[kept], np.zeros(len(exits.owner))]),
        level=np.concatenate([regime.level[kept], exits.level]),
        owner=np.concatenate([regime.owner[kept], exits.owner]),
        leads=np.concatenate([regime.leads[kept], exits.leads]),
        mixed=bool(np.any(whole[:, 1, e:])),
        sliding=SlidingPiece(sliders, status, pushes, flat(forces), flat(speeds), space, dampers),
    )


def flat(states: Array) -> Array:
    """Return states (k, 2, m) as rows (k, 2m)."""
    return states.reshape(states.shape[0], states.shape[1] * states.shape[2])


def _over_all(w: Array, u: Array, steady: Array) -> Array:
    """Return rows over all blocks, shape (k, 2, M), from rows ``W z + U v`` over the structure's, each (k, m)."""
    k, e = w.shape[0], steady.shape[1] // 2
    own = np.stack([w, u], axis=1)
    loads = (np.concatenate([w, u], axis=1) @ steady).reshape(k, 2, e)
    return np.concatenate([loads, own], axis=2)
