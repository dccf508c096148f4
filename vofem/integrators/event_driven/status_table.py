"""The eigensystems of several contact statuses in one set of arrays, as the compiled loop over segments takes them."""

from __future__ import annotations

import copy as copying
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.motion import Forcing, static_answer
from vofem.integrators.event_driven.search import EventFunctions
from vofem.integrators.event_driven.spectrum import Spectrum
from vofem.kernels.jit import jit
from vofem.linalg.vectors import copy, fill
from vofem.system import CLOSED

Array = NDArray[np.float64]
Status = NDArray[np.int64]

#: Memory that the table may take, bytes, and more modes than these have no table: their arithmetic takes longer.
_MOST_MEMORY, MOST_MODES = 128 * 2**20, 600

#: Memory of a table that is kept for later runs, bytes.
_MOST_LENT = 32 * 2**20

#: Levels of a spectrum at most, as in `Spectrum.levels`.
_LEVELS = 41


class Table(NamedTuple):
    """Statuses, one in each slot. All have n blocks, since no contact is pinned.

    Attributes
    ----------
    number : ndarray of int, shape (slots,)
        Number of the status in the record.
    following : ndarray of int, shape (slots, n_contacts)
        The slot of the status in which a contact has switched; -1 where it has none.
    delta, p, frequency : ndarray, shape (slots, n)
    plain : ndarray of bool, shape (slots,)
        Whether the real modes are those without contacts.
    mixed : ndarray of bool, shape (slots,)
        Whether damping couples the real modes.
    down, up : ndarray, shape (slots, n, n)
        The real modes and their transpose; not set where plain.
    into, out : ndarray, shape (slots, 2n, 2n), or (0, 0, 0)
        Transposed maps from real modes to blocks and back, where mixed.
    levels : ndarray of int, shape (slots, 41)
    level_count : ndarray of int, shape (slots,)
    sign, level : ndarray, shape (slots, n_contacts)
        Sign of the gap functions in the event functions, and the sizes of their constants.
    w, u, w_size, u_size : ndarray, shape (slots, n_contacts, n)
        See `EventFunctions`; u and u_size have no slots where no status is mixed.
    g1, g2 : ndarray, shape (slots, n_functions, n)
        Block inputs of the loads.
    push : ndarray, shape (slots, 4, n)
        What springs whose force is zero at a displacement other than zero do: static displacement and velocity of the
        blocks and the inputs g1, g2 that are left.
    constant : ndarray, shape (slots, n_functions, 4, n), or (0, 0, 0, 0)
        The same of the loads' constant parts, where mixed.
    slope : ndarray, shape (slots, n_functions, 8, n), or (0, 0, 0, 0)
        Static displacement and velocity, their rates, constant inputs g1, g2 and those that grow with time, of the
        loads' slopes, where mixed.
    """

    number: Status
    following: Status
    delta: Array
    p: Array
    frequency: Array
    plain: NDArray[np.bool_]
    mixed: NDArray[np.bool_]
    down: Array
    up: Array
    into: Array
    out: Array
    levels: Status
    level_count: Status
    sign: Array
    level: Array
    w: Array
    u: Array
    w_size: Array
    u_size: Array
    g1: Array
    g2: Array
    push: Array
    constant: Array
    slope: Array


#: Arrays of `Table` that have slots only where statuses are mixed.
_MIXED = ("into", "out", "u", "u_size", "constant", "slope")


class StatusTable:
    """A `Table` to which statuses are added as they occur.

    A run may begin with the table of an earlier one (`continued`). It then contains statuses that have not occurred in
    this run. These have no number yet, and the compiled loop stops at them.

    Parameters
    ----------
    loads : ndarray, shape (n_functions, n)
        Modal load vectors.
    contacts : int
    horizon : float
        Longest time in s for which a motion is computed.
    damped : bool
        Whether there is damping, so that modes may be mixed.

    Attributes
    ----------
    arrays : Table
    capacity : int
        Number of slots at most.
    """

    def __init__(self, loads: Array, contacts: int, horizon: float, damped: bool) -> None:
        self._loads, self._horizon = loads, horizon
        self.capacity = max(_MOST_MEMORY // (8 * max(loads.shape[1], 1) ** 2 * (10 if damped else 2)), 2)
        n = loads.shape[1]
        functions = loads.shape[0]
        self._used = 0
        # Whether other runs use the arrays, which are then copied before anything is written to them.
        self._lent = False
        self._spectra: list[Spectrum] = []
        self._statuses: list[Status] = []
        self._slots: dict[bytes, int] = {}
        self._shapes: dict[str, tuple[int, ...]] = {
            "number": (), "following": (contacts,), "delta": (n,), "p": (n,), "frequency": (n,), "plain": (),
            "mixed": (), "down": (n, n), "up": (n, n), "into": (2 * n, 2 * n), "out": (2 * n, 2 * n),
            "levels": (_LEVELS,), "level_count": (), "sign": (contacts,), "level": (contacts,), "w": (contacts, n),
            "u": (contacts, n), "w_size": (contacts, n), "u_size": (contacts, n), "g1": (functions, n),
            "g2": (functions, n), "push": (4, n), "constant": (functions, 4, n), "slope": (functions, 8, n),
        }  # fmt: skip
        self._any_mixed = False
        self.arrays = Table(*(self._empty(name, 0) for name in Table._fields))

    def lend(self) -> bool:
        """Let later runs begin with this table; return whether it is small enough to be kept for them."""
        self._lent = True
        return sum(part.nbytes for part in self.arrays) <= _MOST_LENT

    def continued(self, loads: Array, horizon: float) -> StatusTable | None:
        """Return a table for another run that begins with what this one holds; None under other loads."""
        if horizon != self._horizon or not np.array_equal(loads, self._loads):
            return None
        other = copying.copy(self)
        other._statuses, other._spectra, other._slots = list(self._statuses), list(self._spectra), {}
        other.arrays = self.arrays._replace(number=np.full(self.arrays.number.shape, -1))
        return other

    def recall(self, status: Status, number: int, spectrum: Spectrum) -> int:
        """Give a status the slot that it had in an earlier run, and return the slot; -1 if it had none.

        An eigensystem that was computed anew counts as a different one.
        """
        for slot, known in enumerate(self._spectra):
            if known is spectrum and self.arrays.number[slot] < 0:
                self.arrays.number[slot] = number
                self._slots[status.tobytes()] = slot
                return slot
        return -1

    def _empty(self, name: str, slots: int) -> NDArray:
        shape = self._shapes[name]
        if name in _MIXED and not self._any_mixed:
            slots, shape = 0, (0,) * len(shape)
        integer = name in ("number", "following", "levels", "level_count")
        kind = np.dtype(bool) if name in ("plain", "mixed") else np.dtype(np.int64 if integer else np.float64)
        empty = np.zeros((slots, *shape), dtype=kind)
        if name == "following":
            empty[:] = -1
        return empty

    def slot(self, status: Status) -> int:
        """Return the slot of a status, or -1."""
        return self._slots.get(status.tobytes(), -1)

    def renumber(self, number: Callable[[Status], int]) -> None:
        """Assign the slots to the statuses of another record.

        Parameters
        ----------
        number : callable
            Returns the number of a status in the record.
        """
        for slot, status in enumerate(self._statuses):
            self.arrays.number[slot] = number(status)

    def enter(self, status: Status, number: int, spectrum: Spectrum, functions: EventFunctions, push: Array) -> int:
        """Give a status a slot, and return it.

        Parameters
        ----------
        number : int
            Number of the status in the record.
        functions : EventFunctions
            Event functions of all contacts, as far as they do not depend on the state.
        push : ndarray, shape (n,)
            Modal force of springs whose force is zero at a displacement other than zero.
        """
        mixed = not spectrum.classical
        self._make_room(mixed)
        slot, table = self._used, self.arrays
        self._used += 1
        self._spectra.append(spectrum)
        self._statuses.append(np.array(status))
        self._slots[status.tobytes()] = slot
        self._link(slot)
        n = self._loads.shape[1]
        table.number[slot] = number
        table.delta[slot], table.p[slot], table.frequency[slot] = spectrum.delta, spectrum.p, spectrum.frequency
        modes = spectrum.real.modes
        table.plain[slot], table.mixed[slot] = modes is None, mixed
        if modes is not None:
            table.down[slot], table.up[slot] = modes, modes.T
        table.levels[slot, : spectrum.levels.size] = spectrum.levels
        table.level_count[slot] = spectrum.levels.size
        contacts = table.sign.shape[1]
        if contacts:
            table.sign[slot] = np.where(status == CLOSED, -1.0, 1.0)
            table.level[slot] = functions.constant
            table.w[slot], table.w_size[slot] = functions.w, functions.w_size
            if mixed:
                table.u[slot], table.u_size[slot] = functions.u, functions.u_size
        for f, vector in enumerate(self._loads):
            table.g1[slot, f], table.g2[slot, f] = spectrum.inputs(vector)
        nothing = np.zeros(n)
        if not mixed:
            table.push[slot, 3] = spectrum.inputs(push)[1]
            return slot
        assert spectrum.blocks is not None
        table.into[slot], table.out[slot] = spectrum.blocks.into.T, spectrum.blocks.out.T
        table.push[slot] = self._answer(spectrum, push, nothing)[[0, 2, 4, 5]]
        for f, vector in enumerate(self._loads):
            table.constant[slot, f] = self._answer(spectrum, vector, nothing)[[0, 2, 4, 5]]
            table.slope[slot, f] = self._answer(spectrum, nothing, vector)
        return slot

    def _answer(self, spectrum: Spectrum, constant: Array, slope: Array) -> Array:
        """Return the static response of complex modes to a force, and the remaining inputs, shape (8, n).

        In this order: displacement and its rate, velocity and its rate, constant inputs, inputs that grow with time.
        """
        empty = np.zeros((constant.size, 0), dtype=complex)
        (z, v), left = static_answer(spectrum, Forcing(np.zeros(0), empty, constant, slope), self._horizon)
        return np.stack(
            [z[:, 0], z[:, 1], v[:, 0], v[:, 1], *spectrum.inputs(left.constant), *spectrum.inputs(left.slope)]
        )

    def _link(self, slot: int) -> None:
        """Store which statuses follow from each other when one contact switches."""
        following, status = self.arrays.following, self._statuses[slot]
        for other, known in enumerate(self._statuses[:slot]):
            changed = np.flatnonzero(known != status)
            if changed.size == 1:
                following[slot, changed[0]], following[other, changed[0]] = other, slot

    def _make_room(self, mixed: bool) -> None:
        """Let the arrays have another slot; if there are too many, all statuses are removed."""
        slots = self.arrays.number.shape[0]
        if self._lent or (mixed and not self._any_mixed):
            self._any_mixed |= mixed
            self._resize(slots)
            self._lent = False
        if self._used == slots:
            if slots == self.capacity:
                self._used = 0
                self._spectra.clear()
                self._statuses.clear()
                self._slots.clear()
                self.arrays.following[:] = -1
            else:
                self._resize(min(max(2 * slots, 2), self.capacity))

    def _resize(self, slots: int) -> None:
        parts = []
        for name, part in zip(Table._fields, self.arrays, strict=True):
            larger = self._empty(name, slots)
            if part.shape[1:] == larger.shape[1:]:
                larger[: self._used][: part.shape[0]] = part[: self._used]
            parts.append(larger)
        self.arrays = Table(*parts)


@jit
def add_products(x: Array, rows: Array, out: Array) -> None:
    """Add ``x @ rows`` to `out`."""
    for i in range(rows.shape[0]):
        factor = x[i]
        row = rows[i]
        for k in range(row.size):
            out[k] += factor * row[k]


@jit
def add_columns(x: Array, rows: Array, first: int, last: int, out: Array) -> None:
    """Add some columns of ``x @ rows`` to those of `out`."""
    for i in range(rows.shape[0]):
        factor = x[i]
        row = rows[i]
        for k in range(first, last):
            out[k] += factor * row[k]


@jit
def to_real(table: Table, s: int, vector: Array, out: Array) -> None:
    """Write a modal vector in the real modes of a status, shape (n,)."""
    if table.plain[s]:
        copy(vector, out)
    else:
        fill(out, 0.0)
        add_products(vector, table.down[s], out)


@jit
def to_modes(table: Table, s: int, vector: Array, out: Array) -> None:
    """Write a vector in the real modes of a status as a modal one, shape (n,)."""
    if table.plain[s]:
        copy(vector, out)
    else:
        fill(out, 0.0)
        add_products(vector, table.up[s], out)


@jit
def to_blocks(table: Table, s: int, displacement: Array, velocity: Array, z: Array, v: Array, both: Array) -> None:
    """Write a modal state in the blocks of a status, each of shape (n,); `both` is work space of shape (2, 2n)."""
    n = displacement.size
    if not table.mixed[s]:
        to_real(table, s, displacement, z)
        to_real(table, s, velocity, v)
        return
    to_real(table, s, displacement, both[0, :n])
    to_real(table, s, velocity, both[0, n:])
    fill(both[1], 0.0)
    add_products(both[0], table.into[s], both[1])
    copy(both[1, :n], z)
    copy(both[1, n:], v)


@jit
def from_blocks(table: Table, s: int, z: Array, v: Array, displacement: Array, velocity: Array, both: Array) -> None:
    """Write a state in the blocks of a status, or a difference of states, as a modal one."""
    n = z.size
    if not table.mixed[s]:
        to_modes(table, s, z, displacement)
        to_modes(table, s, v, velocity)
        return
    copy(z, both[0, :n])
    copy(v, both[0, n:])
    fill(both[1], 0.0)
    add_products(both[0], table.out[s], both[1])
    to_modes(table, s, both[1, :n], displacement)
    to_modes(table, s, both[1, n:], velocity)
