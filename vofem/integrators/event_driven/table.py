"""The linear pieces of a run in one set of arrays, as the loop over segments takes them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.regime import Regime
from vofem.linalg.oscillators import DIVISOR

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Memory that the arrays may take, bytes.
_MOST_MEMORY = 128 * 2**20

#: In systems of more modes the arrays hold one piece without a copy.
MOST_MODES = 600


class Table(NamedTuple):
    """Linear pieces, one in each slot. What one of them has less of than others is filled up with zeros.

    Attributes
    ----------
    slots : ndarray of int, shape (n_statuses, n_kinds)
        Slots of the contact statuses of the record under loads of each kind; -1 for those without.
    after : ndarray of int, shape (n_statuses, k)
        The status to which each event function leads; -1 for one that has not occurred yet.
    counts : ndarray of int, shape (slots, 3)
        Numbers of event functions, of pairs and of levels.
    flags : ndarray of bool, shape (slots, 4)
        Whether the real modes are those without contacts, whether damping couples them, whether rows have velocities
        of the structure's blocks, and whether contacts are pinned.
    of, pair, gain, levels, rows, sizes, sign, level, owner, leads : ndarray, shape (slots, ...)
        See `Regime` and `Blocks`.
    modes : ndarray, shape (slots, n, m)
        Real modes; not set where they are those without contacts.
    into, out : ndarray, shape (slots, 2, m, 2, m)
        Maps from real modes to blocks and back, where damping couples modes.
    steady : ndarray, shape (slots, 2e, 2, m)
        Steady answers, a load in each row.
    shift : ndarray, shape (slots, n)
        Modal displacement that puts pinned contacts at their gaps.
    """

    slots: Integers
    after: Integers
    counts: Integers
    flags: NDArray[np.bool_]
    of: Array
    pair: Integers
    gain: Array
    levels: Integers
    rows: Array
    sizes: Array
    sign: Array
    level: Array
    owner: Integers
    leads: Integers
    modes: Array
    into: Array
    out: Array
    steady: Array
    shift: Array


#: How many of the fields of `Table` belong to statuses and not to slots.
_OF_STATUSES = 2


def _parts(regime: Regime) -> list[NDArray]:
    """Return what a slot holds of a linear piece, in the order of the fields of `Table`."""
    spectrum, blocks, exits = regime.spectrum, regime.blocks, regime.exits
    real, mixed = spectrum.real, spectrum.blocks
    m, n = spectrum.p.size, regime.vectors.shape[1]
    steady = np.ascontiguousarray(regime.answers.steady.T)
    none = np.zeros((2, 0, 2, 0))
    return [
        np.array([exits.sign.size, blocks.pair.shape[0], regime.levels.size]),
        np.array([real.modes is None, mixed is not None, regime.mixed, regime.held]),
        blocks.of, blocks.pair, blocks.gain, regime.levels, *exits,
        np.zeros((0, 0)) if real.modes is None else np.ascontiguousarray(real.modes),
        none if mixed is None else np.ascontiguousarray(mixed.into).reshape(2, m, 2, m),
        none if mixed is None else np.ascontiguousarray(mixed.out).reshape(2, m, 2, m),
        steady.reshape(len(steady), 2, m), np.zeros(n) if real.shift is None else real.shift,
    ]  # fmt: skip


def single(regime: Regime, number: int, kind: int, statuses: int, kinds: int) -> Table:
    """Return a table that holds one linear piece, that of a status of the record, without a copy."""
    slots = np.full((statuses, kinds), -1)
    slots[number, kind] = 0
    return Table(slots, np.full((statuses, regime.exits.sign.size), -1), *(part[None] for part in _parts(regime)))


class Statuses:
    """A `Table` to which linear pieces are added as they occur.

    Parameters
    ----------
    kinds : int
        Number of kinds of loads.

    Attributes
    ----------
    table : Table, optional
        None before the first piece.
    """

    def __init__(self, kinds: int) -> None:
        self.table: Table | None = None
        self._kinds, self._used = kinds, 0

    def enter(self, regime: Regime, number: int, kind: int) -> Table:
        """Return the table with a slot for a linear piece, from its numbers of contact status and kind of loads."""
        if self.table is not None and number < len(self.table.slots) and self.table.slots[number, kind] >= 0:
            return self.table
        parts = _parts(regime)
        slots, after = self._links(regime.exits.sign.size, number)
        stacks = [part[None][:0] for part in parts] if self.table is None else list(self.table[_OF_STATUSES:])
        rows = stacks[0].shape[0]
        if self._used == rows and rows * sum(part.nbytes for part in parts) > _MOST_MEMORY:
            # There are too many: they begin anew.
            self._used, slots[:] = 0, -1
        slot = self._used
        for at, part in enumerate(parts):
            stack = stacks[at]
            if part.shape != stack.shape[1:] or slot == rows:
                shape = tuple(max(sizes) for sizes in zip(stack.shape[1:], part.shape, strict=True))
                if shape != stack.shape[1:] or slot == rows:
                    stacks[at] = np.zeros((max(rows, 2 * slot, 2), *shape), dtype=stack.dtype)
                    stacks[at][tuple(slice(size) for size in stack.shape)] = stack
                stacks[at][slot] = 0
                stacks[at][slot][tuple(slice(size) for size in part.shape)] = part
            else:
                stack[slot] = part
        table = Table(slots, after, *stacks)
        # Blocks that are there for their place only are at rest; nothing is divided by zero for them.
        divisor = table.of[: slot + 1, DIVISOR]
        divisor[divisor == 0.0] = 1.0
        slots[number, kind] = self._used
        self._used += 1
        self.table = table
        return table

    def _links(self, functions: int, number: int) -> tuple[Integers, Integers]:
        """Return the slots of all statuses, and which follow from each other, with room for one more status."""
        none = np.zeros((0, self._kinds), dtype=np.int64), np.zeros((0, functions), dtype=np.int64)
        found = none if self.table is None else (self.table.slots, self.table.after)
        if number < len(found[0]) and functions <= found[1].shape[1]:
            return found
        rows, columns = max(2 * len(found[0]), number + 1), max(functions, found[1].shape[1])
        slots, after = np.full((rows, self._kinds), -1), np.full((rows, columns), -1)
        slots[: len(found[0])] = found[0]
        after[: len(found[1]), : found[1].shape[1]] = found[1]
        return slots, after

    def room(self, statuses: int) -> Table | None:
        """Return the table with a row for each of so many statuses."""
        if self.table is not None and len(self.table.slots) < statuses:
            slots, after = self._links(0, statuses - 1)
            self.table = self.table._replace(slots=slots, after=after)
        return self.table
