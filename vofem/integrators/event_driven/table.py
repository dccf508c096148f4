"""The linear pieces of a run as the loop over segments takes them: rows of sizes and of places of arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.integrators.event_driven.blocks import response
from vofem.integrators.event_driven.clusters import Group
from vofem.integrators.event_driven.regime import Regime
from vofem.integrators.event_driven.search import SPARE, TAKES, WORK
from vofem.kernels.addresses import place_of

Integers = NDArray[np.int64]

#: Columns of a table of linear pieces: those that searches take, and places of arrays, see `Regime`. Steady answers
#: (2e, 2m) have a load in each row. Real modes (n, m) are 0 where they are those without contacts, maps (2m, 2m) from
#: real modes to blocks and back where damping couples no modes, and the displacement (n,) that puts pinned contacts at
#: their gaps where there are none. Of sliders there are 1 and -1 for those that slide up and down, with 0 for all other
#: contacts (c,), and the displacements that follow loads (n, e). The last column is the place of what searches take.
OF, SIGN, LEVEL, OWNER, LEADS, STEADY, MODES, INTO, OUT, SHIFT = range(TAKES, TAKES + 10)
SLIDES, CARRIED, TAKEN, _COLUMNS = range(TAKES + 10, TAKES + 14)

#: Memory of the arrays of a table above which it begins anew, bytes.
_MOST_MEMORY = 128 * 2**20


def searched(regime: Regime) -> tuple[Integers, Array, list[NDArray]]:
    """Return what searches take of a linear piece, see `search.FUNCTIONS`; their work space; and arrays to keep.

    It is the beginning of a row of a table, see `OF`, whose places are kept with the piece.
    """
    if "row" not in regime.kept:
        blocks, exits, m, spectrum = regime.blocks, regime.exits, regime.blocks.of.shape[1], regime.spectrum
        mixed, real = spectrum.blocks, spectrum.real
        taken: list[Any] = [blocks.pair, blocks.gain, regime.levels, exits.rows, exits.sizes, None]
        taken += [*(blocks.group or (None,) * len(Group._fields))]
        others = [
            blocks.of, exits.sign, exits.level, exits.owner, exits.leads, regime.answers.steady.T, real.modes,
            None if mixed is None else mixed.into, None if mixed is None else mixed.out, real.shift, *_slides(regime),
        ]  # fmt: skip
        kept = [None if part is None else np.ascontiguousarray(part) for part in (*taken, *others)]
        sizes = exits.sign.size, len(blocks.pair), regime.levels.size, m, m - regime.loads
        numbers = [*sizes, m if regime.mixed else regime.loads, response(blocks.pair.size > 0).address]
        places = (0 if part is None else place_of(part) for part in kept)
        regime.kept["row"] = np.array([*numbers, *places, 0]), [part for part in kept if part is not None]
    known, parts = regime.kept["row"]
    # Runs in other threads have work space of their own.
    row, work = known.copy(), np.empty(SPARE)
    row[WORK], row[TAKEN] = place_of(work), place_of(row)
    return row, work, [row, work, *parts]


def _slides(regime: Regime) -> tuple[Array, Array | None]:
    """Return 1 and -1 for sliders that slide, 0 for other contacts (c,), and the displacements that follow loads."""
    status, sliders, pushes = regime.base.status, regime.sliders, regime.pushes
    slides = np.zeros(status.size)
    if sliders is None or pushes is None:
        return slides, None
    slides[sliders.first :] = sliders.signs(status)
    return slides, pushes.carried if pushes.carried.any() else None


class Statuses:
    """A table of linear pieces, one in each slot, to which they are added as they occur.

    `kinds`: number of kinds of loads.
    `table` has shape (n_slots, _COLUMNS).
    `slots` (shape (n_statuses, n_kinds)): slots of the contact statuses of the record under loads of each kind; -1 for
    those without.
    `after` (shape (n_statuses, k)): the status to which each event function leads; -1 for one that has not occurred
    yet.
    """

    def __init__(self, kinds: int) -> None:
        self.table = np.zeros((0, _COLUMNS), dtype=np.int64)
        self.slots, self.after = np.zeros((0, kinds), dtype=np.int64), np.zeros((0, 0), dtype=np.int64)
        self._kept: list[NDArray] = []
        self._memory = 0

    def enter(self, regime: Regime, number: int, kind: int) -> None:
        """Give a linear piece a slot, from its numbers of contact status and kind of loads."""
        self.make_room(number + 1, regime.exits.sign.size)
        if self.slots[number, kind] >= 0:
            return
        if self._memory > _MOST_MEMORY:
            self.table, self._kept, self._memory = self.table[:0], [], 0
            self.slots[:] = -1
        row, _, kept = searched(regime)
        self._kept += kept
        self._memory += sum(part.nbytes for part in kept)
        self.slots[number, kind] = len(self.table)
        self.table = np.concatenate([self.table, [row]])

    def make_room(self, statuses: int, functions: int = 0) -> None:
        """Let there be rows for so many statuses, and columns for so many event functions."""
        rows, columns = self.after.shape
        if statuses > rows or functions > columns:
            size = max(statuses, 2 * rows if statuses > rows else rows), max(functions, columns)
            slots, after = np.full((size[0], self.slots.shape[1]), -1), np.full(size, -1)
            slots[:rows], after[:rows, :columns] = self.slots, self.after
            self.slots, self.after = slots, after
