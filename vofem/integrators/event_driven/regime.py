"""A linear piece of a run: the blocks of one contact status and of its loads, and everything that is a row over them.

States of all blocks are arrays (2, M), displacements above velocities, loads before the blocks of the structure. From
a modal state (x, x') and the loads w, with the steady answers B of the blocks,

    y = into (V' (x - shift), V' x') - B w,    x = shift + V (out (y + B w)).

The columns of B belong to the values of the loads and, after them, to their rates.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.blocks import Blocks, blocks_of, changes
from vofem.integrators.event_driven.clusters import group_of
from vofem.integrators.event_driven.exosystem import Exosystem, Kind
from vofem.integrators.event_driven.spectrum import Spectra, Spectrum
from vofem.integrators.event_driven.unloaded import Exits, Unloaded
from vofem.system import CLOSED, PINNED, ContactLaws, Counters, System

if TYPE_CHECKING:
    from vofem.integrators.event_driven.modal_space import ModalSpace
    from vofem.integrators.event_driven.sliders import Pushes, Sliders, SlidingPiece

Integers = NDArray[np.int64]

#: Linear pieces that are kept with an eigensystem, and only one in systems of more modes than these.
_MOST_REGIMES, _FEW_MODES = 8, 300

#: A harmonic counts as resonant where the steady answer would exceed ten times the static one.
RESONANT = 0.1


class Answers(NamedTuple):
    """What the blocks of a status do under loads."""

    steady: Array  #: B, shape (2m, 2e).
    drive: Array  #: Inputs to the blocks that have no answer, by values and rates of the loads, shape (2m, 2e).
    apart: NDArray[np.bool_]  #: Pairs of blocks and loads without a steady answer, shape (m, e).


def answers(base: Unloaded, kind: Kind, horizon: float, pushes: Pushes | None = None) -> Answers:
    """Return what the blocks of a status do under loads of some frequencies.

    `horizon`: longest time in s for which a motion is computed. A block that is slower than that is treated as rigid.
    `pushes`: what sliders add to the loads.
    """
    spectrum, found = base.spectrum, answers_to_lines(base, kind, horizon, pushes)
    blocks = spectrum.delta, spectrum.p, spectrum.plain
    return add_waves(found, blocks, wave_inputs(base, kind, pushes), kind, horizon)


def answers_to_lines(base: Unloaded, kind: Kind, horizon: float, pushes: Pushes | None = None) -> Answers:
    """Return the answers of a status to the lines of a kind; they are zero for harmonics.

    They depend on no frequency and are kept with the status, but for those with sliders.
    """
    key, lines, down = (horizon, kind.layout), kind.lines, base.spectrum.real.down
    found: Answers | None = base.lines.get(key) if pushes is None else None
    if found is not None:
        return found
    # The second derivatives that bend lines stand before all waves.
    forces, rates = _columns(base.local, kind.function[lines] + 1)
    if pushes is not None:
        forces, rates = forces + down(pushes.sources[:, lines]), down(pushes.rates[:, lines])
    own = _to_lines(base.spectrum, forces, rates, kind.bend[lines], horizon)
    m, e = base.spectrum.p.size, kind.omega.size
    found = Answers(np.zeros((2 * m, 2 * e)), np.zeros((2 * m, 2 * e)), np.zeros((m, e), dtype=bool))
    both = np.append(lines, e + lines)
    found.steady[:, both], found.drive[:, both], found.apart[:, lines] = own
    if pushes is None:
        base.lines[key] = found
    return found


def wave_inputs(base: Unloaded, kind: Kind, pushes: Pushes | None = None) -> tuple[Array, Array | None]:
    """Return the inputs to the blocks of a status by values and rates of the harmonics, each (2m, waves)."""
    waves, spectrum = kind.waves, base.spectrum
    values, rates = _columns(base.inputs, kind.function[waves] + 1)
    if pushes is None:
        return values, rates
    values = values + spectrum.real_inputs(spectrum.real.down(pushes.sources[:, waves]))
    return values, spectrum.real_inputs(spectrum.real.down(pushes.rates[:, waves]))


def _columns(parts: tuple[Array, Array | None], function: Integers) -> tuple[Array, Array | None]:
    """Return the columns of some functions, counted from the constant 1."""
    values, rates = parts
    return values[:, function], None if rates is None else rates[:, function]


def add_waves(
    found: Answers, blocks: tuple[Array, Array, Array | None], inputs: tuple[Array, Array | None], kind: Kind,
    horizon: float,
) -> Answers:  # fmt: skip
    """Return answers to lines together with those to harmonics. All arrays may have a leading axis for statuses.

    `blocks`: delta, p and plain of the blocks; see `Spectrum`.
    `inputs`: by values and rates of the harmonics, shape (2m, waves).
    """
    waves = kind.waves
    if not waves.size:
        return found
    (delta, p, plain), (values, rates), omega, e = blocks, inputs, kind.omega[waves], kind.omega.size
    steady, drive, apart = found.steady.copy(), found.drive, found.apart.copy()
    m, square, turns = p.shape[-1], omega**2, 1j * omega
    p, twice = p[..., None], 2.0 * delta[..., None]
    impedance = p - square + twice * turns
    alone = np.abs(impedance) < RESONANT * np.maximum(p, square)
    if (slow := omega * horizon < 1.0).any():
        alone |= (p * horizon**2 < 1.0) & slow
    driven = alone if plain is None else alone | (plain[..., None] == 0.0)
    both = values if rates is None else values + turns * rates
    if driven.any():
        impedance[driven] = 1.0
        left = np.concatenate([driven, driven], axis=-2)
        drive = drive.copy()
        drive[..., waves] = values * left
        if rates is not None:
            drive[..., e + waves] = rates * left
        both = both * ~left
    first, second = both[..., :m, :], both[..., m:, :]
    z = ((twice + turns) * first + second) / impedance
    answer = np.concatenate([z, turns * z - first], axis=-2)
    # The rate of a harmonic is its imaginary part.
    steady[..., waves], steady[..., e + waves], apart[..., waves] = answer.real, answer.imag / omega, alone
    return Answers(steady, drive, apart)


def coupled(drive: Array, plain: Array | None, bend: Integers) -> tuple[Integers, Array]:
    """Return `pair` and `gain` of `Blocks` for inputs to blocks that have no answer, shape (2m, 2e).

    `plain` (shape (m,)): see `Spectrum`.
    `bend` (shape (e,)): see `Exosystem`.
    """
    if bend.max(initial=-1) < 0 and not drive.any():
        return np.zeros((0, 3), dtype=np.int64), np.zeros((0, 4))
    e, bent = bend.size, np.flatnonzero(bend >= 0)
    driven = drive.reshape(2, len(drive) // 2, 2, e)
    own = np.argwhere(np.any(driven, axis=(0, 2)) & (True if plain is None else plain[:, None] != 0.0))
    gain = driven[:, own[:, 0], :, own[:, 1]].reshape(len(own), 4)
    pair = np.concatenate([
        np.column_stack([bent, bend[bent], np.full(bent.size, -2)]),
        np.column_stack([e + own[:, 0], own[:, 1], bend[own[:, 1]]]),
    ])  # fmt: skip
    return pair, np.concatenate([np.tile([0.0, 0.0, 1.0, 0.0], (bent.size, 1)), gain])


def _to_lines(spectrum: Spectrum, forces: Array, rates: Array | None, bend: Integers, horizon: float) -> Answers:
    """Return what blocks do under lines, given the forces on real modes by their values and rates, each (m, e)."""
    m, e = forces.shape
    p = spectrum.p[:, None]
    steady, drive = np.zeros((2 * m, 2 * e)), np.zeros((2 * m, 2 * e))
    rest, more = _static(spectrum, forces, horizon, steady)
    if rates is not None:
        more = more + rates
    drive[:, :e], drive[:, e:] = spectrum.real_inputs(rest), spectrum.real_inputs(more)
    slow = p * horizon**2 < 1.0
    answered = ~slow if spectrum.plain is None else (spectrum.plain[:, None] > 0.0) & ~slow
    known = np.tile(answered, (2, 1))
    steady += _static_of_blocks(spectrum, drive * known, answered)
    bent = np.flatnonzero(bend >= 0)
    if bent.size:
        # The answer to the rate of a line that is bent changes with the line's second derivative.
        more = np.zeros((2 * m, 2 * bent.size))
        more[:, : bent.size] = -steady[:, e + bent]
        columns = np.concatenate([bend[bent], e + bend[bent]])
        steady[:, columns], drive[:, columns] = _static_of_blocks(spectrum, more * known, answered), more
    drive[known[:, 0]] = 0.0
    return Answers(steady, drive, np.repeat(slow, e, axis=1))


def _static_of_blocks(spectrum: Spectrum, inputs: Array, answered: NDArray[np.bool_]) -> Array:
    """Return the answers (2m, 2e) of blocks to inputs by values and rates of lines, which are zero for some, (m, 1)."""
    e = inputs.shape[1] // 2
    delta, safe = spectrum.delta[:, None], np.where(answered, spectrum.p[:, None], 1.0)
    (g1, g2), (h1, h2) = (np.split(part, 2) for part in (inputs[:, :e], inputs[:, e:]))
    z = (2.0 * delta * g1 + g2) / safe
    # A line that rises has the answer to its value, and one more.
    later = z - h1
    return np.block([[z, (h2 - 2.0 * delta * later + g1) / safe], [-g1, later]])


def _static(spectrum: Spectrum, force: Array, horizon: float, steady: Array) -> tuple[Array, Array]:
    """Add the static answers of complex modes to lines; return the forces left, by values and rates, each (m, e).

    The force of a stiff contact behind a gap is so large that its rounding would spoil slow blocks. Its static
    displacement is small and does not.
    """
    nothing = np.zeros_like(force)
    if spectrum.blocks is None:
        return force, nothing
    assert spectrum.damping is not None
    p = spectrum.real.p[:, None]
    fast = p * horizon**2 >= 1.0
    safe = np.where(fast, p, 1.0)
    rate = np.where(fast, force / safe, 0.0)
    braked = -spectrum.damping @ rate
    late = np.where(fast, braked / safe, 0.0)
    steady += spectrum.blocks.into @ np.block([[rate, late], [nothing, rate]])
    return np.where(fast, 0.0, force), np.where(fast, 0.0, braked)


class MovingStops(NamedTuple):
    """Contacts whose coordinates have an offset that depends on time, in one status."""

    rows: Array  #: Modal rows, shape (n_contacts, n).
    drift: Array  #: Factors with which the loads enter the coordinates, shape (n_contacts, e).
    #: `stiffness`, `damping`, `offset`: stiffness and damping are zero unless the contact is closed, shape
    #: (n_contacts,).
    stiffness: Array
    damping: Array
    offset: Array


def drift_of(laws: ContactLaws | None, function: Integers, functions: int) -> Array | None:
    """Return the factors with which loads enter the coordinates of contacts, (n_contacts, e); None where none does.

    `function` (shape (e,)): see `Exosystem`; the offsets of contacts are the last functions.
    `functions`: number of all functions.
    """
    if laws is None or laws.moving is None:
        return None
    weights = laws.moving.weights
    number = function - (functions - weights.shape[1])
    return np.where(number >= 0, weights[:, np.maximum(number, 0)], 0.0)


@dataclass(frozen=True)
class Regime:
    """A contact status under loads of one kind."""

    base: Unloaded  #: The status itself.
    kind: Kind  #: The loads.
    answers: Answers
    blocks: Blocks
    horizon: float  #: Longest time in s for which a motion is computed.
    stops: MovingStops | None = None  #: Contacts that the motion of bases moves; None where there are none.
    sliders: Sliders | None = None  #: Those that are the last rows of the contacts.
    pushes: Pushes | None = None  #: What they add to the loads.

    @property
    def spectrum(self) -> Spectrum:
        """The eigensystem of the status."""
        return self.base.spectrum

    @property
    def levels(self) -> Integers:
        """Numbers of blocks at which the frequency has grown by another factor; the last is all blocks."""
        return self.loads + self.spectrum.levels

    @property
    def loads(self) -> int:
        """Number of loads e."""
        return int(self.answers.apart.shape[1])

    @property
    def held(self) -> bool:
        """Whether contacts are pinned."""
        return self.base.quantities.reactions is not None

    @cached_property
    def _quantities(self) -> Array:
        """Coordinates of the contacts, without their shift, and reactions as rows, shape (c + pinned, 2, M)."""
        base, e = self.base, self.loads
        own = base.quantities.rows
        k, c = len(own), len(base.space.contacts)
        loads = (flat(own) @ self.answers.steady).reshape(k, 2, e)
        if self.stops is not None:
            loads[:c, 0] += self.stops.drift
        if self.pushes is not None:
            assert self.sliders is not None
            loads[:c, 0] += base.space.contacts @ self.pushes.carried
            loads[self.sliders.first : c, 0] -= self.pushes.anchors
        force = base.quantities.reactions
        if force is not None:
            (values, rates), column = base.forces, self.kind.function + 1
            loads[c:, 0] += force.share @ values[:, column]
            loads[c:, 0, 0] -= force.shift
            if self.pushes is not None:
                loads[c:, 0] += self.pushes.reaction + force.share @ self.pushes.sources
                loads[c:, 1] += force.share @ self.pushes.rates
            elif rates is not None:
                loads[c:, 1] += force.share @ rates[:, column]
        return np.concatenate([loads, own], axis=2)

    @cached_property
    def coordinates(self) -> Array:
        """The contacts' coordinates, but for their shift, as rows, shape (n_contacts, 2M)."""
        return flat(self._quantities[: len(self.base.space.contacts)])

    @cached_property
    def reactions(self) -> Array:
        """The reactions of the pinned contacts as rows, shape (k, 2M)."""
        return flat(self._quantities[len(self.base.space.contacts) :])

    @cached_property
    def _sizes(self) -> Array:
        """Bounds on the terms of `_quantities`."""
        return np.concatenate([np.abs(self._quantities[:, :, : self.loads]), self.base.quantities.sizes], axis=2)

    @cached_property
    def exits(self) -> Exits:
        """The event functions."""
        of, exits, e = self.base.quantities, self.base.exits, self.loads
        loads = of.factor[:, None, None] * self._quantities[of.number, :, :e]
        if of.upper.any():
            loads[:, 0, 0] -= of.upper
        exits = exits._replace(
            rows=np.concatenate([loads, exits.rows], axis=2),
            sizes=np.concatenate([self._sizes[of.number, :, :e], exits.sizes], axis=2),
        )
        return exits if self.sliding is None else _with_sliders(self, exits)

    @cached_property
    def mixed(self) -> bool:
        """Whether exits have velocities of the blocks of the structure."""
        return bool(np.any(self.exits.rows[:, 1, self.loads :]))

    @cached_property
    def sliding(self) -> SlidingPiece | None:
        """Sliders; None where there are none."""
        return None if self.sliders is None else _sliding(self)

    @cached_property
    def load_rows(self) -> Array:
        """The power of the loads as rows over the structure's blocks, by their values and rates, shape (2e, 2m)."""
        loads, function = self.loads, self.kind.function
        rows = np.zeros((2 * loads, 2 * self.spectrum.p.size))
        mine = np.flatnonzero(function >= 0)
        rows[mine] = self.velocities(self.base.vectors[function[mine]])
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
        """What others have computed for the piece, places of arrays in memory among it."""
        return {}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "kept"}

    def begin(self, displacement: Array, velocity: Array, w: Array) -> Array:
        """Return the states of all blocks, shape (k, 2, M), of modal states (k, n) under loads (k, 2, e)."""
        if self.pushes is not None:
            carried = self.pushes.carried.T
            displacement, velocity = displacement - w[:, 0] @ carried, velocity - w[:, 1] @ carried
        y = np.concatenate(self.spectrum.to_blocks(displacement.T, velocity.T)).T
        y = y - flat(w) @ self.answers.steady.T
        return np.concatenate([w, y.reshape(len(y), 2, self.spectrum.p.size)], axis=2)

    def to_modes(self, states: Array, *, shifted: bool = False) -> tuple[Array, Array]:
        """Return modal displacements and velocities, each (k, n), of states (k, 2, M) or of changes of states."""
        e, m = self.loads, self.spectrum.p.size
        y = flat(states[:, :, e:]) + flat(states[:, :, :e]) @ self.answers.steady.T
        x, rate = self.spectrum.to_modes(y[:, :m].T, y[:, m:].T, shifted=shifted)
        if self.pushes is not None:
            carried = self.pushes.carried
            return (x + carried @ states[:, 0, :e].T).T, (rate + carried @ states[:, 1, :e].T).T
        return x.T, rate.T

    def over_blocks(self, rows: Array) -> Array:
        """Return modal rows (k, n) of displacements and then those of velocities as rows over all blocks, (2k, 2M)."""
        key = f"rows {rows.tobytes().hex()}"
        if key not in self.kept:
            own = rows if self.spectrum.real.modes is None else rows @ self.spectrum.real.modes
            nothing = np.zeros_like(own)
            w, u = self.spectrum.functions(np.concatenate([own, nothing]), np.concatenate([nothing, own]))
            every = _over_all(w, u, self.answers.steady)
            if self.pushes is not None:
                along, k, e = rows @ self.pushes.carried, len(rows), self.loads
                every[:k, 0, :e] += along
                every[k:, 1, :e] += along
            self.kept[key] = flat(every)
        found: Array = self.kept[key]
        return found

    def changes(self, starts: Array, own: Integers, tau: Array) -> Array:
        """Return by how much states have changed, shape (n_times, 2, M); see `blocks.changes`."""
        return changes(self.blocks, starts, own, tau)


@dataclass(frozen=True)
class Motion:
    """The motions of k segments of one status."""

    regime: Regime
    #: `displacement`, `velocity`: modal states at tau = 0, pinned contacts at their gaps, shape (k, n).
    displacement: Array
    velocity: Array
    starts: Array  #: States of all blocks at tau = 0, shape (k, 2, M).

    @property
    def spectrum(self) -> Spectrum:
        """The eigensystem of the status."""
        return self.regime.spectrum

    def reactions(self, tau: Array) -> Array:
        """Return the reactions of the pinned contacts at some times in the first segment, shape (pinned, n_times)."""
        states = self.starts[0] + self.regime.changes(self.starts, np.zeros(tau.size, dtype=np.int64), tau)
        return np.asarray(self.regime.reactions @ flat(states).T)

    def modes(self, own: Integers, tau: Array) -> tuple[Array, Array]:
        """Return modal displacements and velocities, each (n, n_times), at times in these segments, each (n_times,)."""
        displacement, velocity = self.regime.to_modes(self.regime.changes(self.starts, own, tau))
        return (displacement + self.displacement[own]).T, (velocity + self.velocity[own]).T


def start_motion(regime: Regime, displacement: Array, velocity: Array, w: Array) -> Motion:
    """Return the motions that start from modal states, each (k, n), with values and rates (k, 2, e) of the loads."""
    starts = regime.begin(displacement, velocity, w)
    if regime.held:
        displacement, velocity = regime.to_modes(starts, shifted=True)
    return Motion(regime, displacement, velocity, starts)


def regime_of(base: Unloaded, kind: Kind, horizon: float, sliders: Sliders | None = None) -> Regime:
    """Return a contact status under loads.

    `horizon`: longest time in s for which a motion is computed.
    `sliders`: those that are the last rows of the contacts.
    """
    spectrum, function, omega, bend = base.spectrum, kind.function, kind.omega, kind.bend
    stops, pushes = None, None
    drift = drift_of(base.laws, function, len(base.vectors))
    if drift is not None:
        assert base.laws is not None
        closed = base.status == CLOSED
        stops = MovingStops(
            base.space.contacts, drift, np.where(closed, base.laws.stiffness, 0.0),
            np.where(closed, base.laws.damping, 0.0), base.laws.offset,
        )  # fmt: skip
    if sliders is not None:
        assert base.laws is not None
        pushes = sliders.pushes(base.space, base.laws, base.status, spectrum, function, omega, bend)
    found = answers(base, kind, horizon, pushes)
    pair, gain = coupled(found.drive, spectrum.plain, bend)
    clusters = () if spectrum.blocks is None else spectrum.blocks.clusters
    group = group_of(clusters, found.drive, omega, bend, horizon)
    blocks = blocks_of(np.concatenate([kind.of, base.of], axis=1), pair, gain, group)
    return Regime(base, kind, found, blocks, horizon, stops, sliders, pushes)


def _sliding(regime: Regime) -> SlidingPiece:
    """Return what is asked of the sliders of a linear piece."""
    from vofem.integrators.event_driven.sliders import SlidingPiece

    base, sliders, pushes = regime.base, regime.sliders, regime.pushes
    space, status, laws, spectrum = base.space, base.status, base.laws, base.spectrum
    assert sliders is not None
    assert pushes is not None
    assert laws is not None
    e, first, rows = regime.loads, sliders.first, space.contacts[sliders.first :]
    speeds = regime.over_blocks(rows)[len(rows) :].reshape(len(rows), 2, -1).copy()
    speeds[:, 1, :e] -= pushes.anchors
    signs, own_status, held = sliders.signs(status), status[first:], np.flatnonzero(status == PINNED).tolist()
    forces = np.zeros((len(sliders), speeds.shape[1] * speeds.shape[2]))
    forces[:, 0] = signs * sliders.limit
    for j in range(len(sliders)):
        if own_status[j] == CLOSED:
            forces[j] = sliders.stiffness[j] * regime.coordinates[first + j]
            if spectrum.real.shift is not None:
                forces[j, 0] += sliders.stiffness[j] * (rows[j] @ spectrum.real.shift)
        elif own_status[j] == PINNED:
            forces[j] = regime.reactions[held.index(first + j)]
    dampers = np.where(status == CLOSED, laws.damping, 0.0)
    return SlidingPiece(sliders, status, pushes, forces, flat(speeds), space, dampers)


def _with_sliders(regime: Regime, exits: Exits) -> Exits:
    """Return event functions in which sliders have those of their statuses."""
    base, sliders, sliding = regime.base, regime.sliders, regime.sliding
    assert sliders is not None
    assert sliding is not None
    spectrum, e, first, c = base.spectrum, regime.loads, sliders.first, len(base.space.contacts)
    bounds = np.abs(base.space.contacts[first:])
    if spectrum.real.modes is not None:
        bounds = bounds @ np.abs(spectrum.real.modes)
    speeds = sliding.speeds.reshape(len(sliders), 2, -1)
    sizes = np.abs(speeds)
    sizes[:, 0, e:], sizes[:, 1, e:] = spectrum.sizes(np.zeros_like(bounds), bounds)
    own, own_sizes = regime._quantities, regime._sizes
    more = sliders.exits(base.status, own[:c], (speeds, sizes), (own[c:], own_sizes[c:]), own_sizes[:c])
    kept = exits.owner < first
    return Exits(*(np.concatenate([part[kept], own]) for part, own in zip(exits, more, strict=True)))


class Regimes:
    """The linear pieces of a system's statuses, kept with its eigensystems.

    `vectors` (shape (n_functions, n)): modal load vectors, those of offsets of contacts last.
    `sliders`: those that are the last rows of the contacts.
    """

    def __init__(
        self, system: System, space: ModalSpace, vectors: Array, counters: Counters, sliders: Sliders | None = None
    ) -> None:
        self._system, self._space, self._vectors, self._sliders = system, space, vectors, sliders
        self.spectra = Spectra(space, system.contacts, counters, system.cache)

    @cached_property
    def row_sizes(self) -> Array:
        """Bounds on the terms that the modal rows of the contacts are summed of, shape (n_contacts, n).

        The gap between bodies that move together is a difference of displacements, so its error is their rounding.
        """
        laws, shapes = self._system.contacts, self._space.shapes
        if laws is None:
            return self._space.contacts
        return self._system.cache.get(
            "sizes of modal contact rows", None, lambda: np.asarray(abs(laws.rows) @ np.abs(shapes))
        )

    @cached_property
    def _key(self) -> bytes:
        laws = self._system.contacts
        moving = None if laws is None else laws.moving
        return self._vectors.tobytes() + (b"" if moving is None else moving.weights.tobytes())

    def of(self, status: Integers, loads: Exosystem, kind: int) -> Regime:
        """Return the linear piece of a contact status under loads of a kind."""
        spectrum, one = self.spectra[status], loads.kinds[kind]
        # Systems with other loads share eigensystems.
        if self._key not in spectrum.unloaded:
            spectrum.unloaded[self._key] = Unloaded(
                spectrum, self._space, self._system.contacts, status, self._vectors, self.row_sizes
            )
        base: Unloaded = spectrum.unloaded[self._key]
        key = loads.horizon, *one.key
        if key not in base.regimes:
            if len(base.regimes) >= (_MOST_REGIMES if self._space.size <= _FEW_MODES else 1):
                base.regimes.clear()
            base.regimes[key] = regime_of(base, one, loads.horizon, self._sliders)
        found: Regime = base.regimes[key]
        return found


def flat(states: Array) -> Array:
    """Return states (k, 2, m) as rows (k, 2m)."""
    return states.reshape(states.shape[0], states.shape[1] * states.shape[2])


def _over_all(w: Array, u: Array, steady: Array) -> Array:
    """Return rows over all blocks, shape (k, 2, M), from rows ``W z + U v`` over the structure's, each (k, m)."""
    k, e = w.shape[0], steady.shape[1] // 2
    own = np.stack([w, u], axis=1)
    loads = (np.concatenate([w, u], axis=1) @ steady).reshape(k, 2, e)
    return np.concatenate([loads, own], axis=2)
