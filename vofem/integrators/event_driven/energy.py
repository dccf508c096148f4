"""Energies of an event-driven run: work and dissipation as closed-form integrals, segment by segment.

Segments of one status are treated together (`energy_forms`). Segments with clusters of modes, or with dampers and ramps
on blocks that are slower than the run, are treated one by one (`energy_by_exponentials`). The kinetic energy that is
removed when a contact is pinned counts as dissipated.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from vofem.integrators.event_driven.energy_by_exponentials import Velocities
from vofem.integrators.event_driven.energy_forms import Loads, StatusForms
from vofem.integrators.event_driven.load_table import LoadTable
from vofem.integrators.event_driven.modal_space import ModalSpace
from vofem.integrators.event_driven.record import Record
from vofem.integrators.event_driven.segment import Segment
from vofem.system import ContactLaws

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


def work_and_dissipation(
    space: ModalSpace,
    laws: ContactLaws | None,
    vectors: Array,
    record: Record,
    forms_of: Callable[[int], StatusForms | None],
    segment_of: Callable[[int, Integers, Array], Segment],
    loads: LoadTable | None,
    visits: list[tuple[int, Integers, Array]],
    damped: bool,
    pinning: Array | None,
    work: Array,
    dissipated: Array,
) -> None:
    """Compute the work of all loads and the energy dissipated by all dampers, from t = 0 to the given times.

    Parameters
    ----------
    vectors : ndarray, shape (n_functions, n)
        Modal load vectors.
    record : Record
    forms_of, segment_of : callable
        Return the forms of the status of a segment, None where there are none, and a segment for some of the times.
    loads : LoadTable, optional
        The functions of time of the loads; None where they are too many for a table.
    visits : list of (int, ndarray of int, ndarray)
        Segments in ascending order with the requested times in them: the places of the times in `work`, and the times
        in s from the start of the segment.
    damped : bool
        Whether there are any dampers.
    pinning : ndarray, shape (n_segments,), optional
        Energy lost at the beginning of every segment, J.
    work, dissipated : ndarray, shape (n_times,)
        Filled.
    """
    count = visits[-1][0] + 1
    whole = np.zeros((2, count))
    wanted = {index: (mine, tau) for index, mine, tau in visits}
    nothing = np.empty(0, dtype=np.int64), np.empty(0)
    if damped or len(vectors):
        left = set(range(count))
        for members, drive in _groups(record, loads, count) if loads is not None else ():
            forms = forms_of(members[0])
            if forms is None:
                continue
            places, taus = zip(*(wanted.get(k, nothing) for k in members.tolist()), strict=True)
            # The times in a segment, and its end.
            of = np.repeat(np.arange(members.size), [part.size + 1 for part in taus])
            tau = np.concatenate(
                [part for k, own in zip(members, taus, strict=True) for part in (own, record.durations[k : k + 1])]
            )
            parts = record.buffers
            taken = forms.taken(drive, parts.displacement[members], parts.velocity[members], of, tau)
            if taken is None:
                continue
            left -= set(members.tolist())
            last = np.append(np.diff(of) > 0, True)
            whole[:, members] = taken[0][last], taken[1][last]
            at = np.concatenate(places)
            work[at], dissipated[at] = taken[0][~last], taken[1][~last]
        for index in sorted(left):
            segment = segment_of(index, *wanted.get(index, nothing))
            tau = np.append(segment.tau, segment.duration)
            velocities = Velocities(space, laws, segment)
            for total, end, value in (
                (work, whole[0], velocities.work(vectors, segment.pieces, tau) if segment.pieces else None),
                (dissipated, whole[1], velocities.dissipation(tau) if damped else None),
            ):
                if value is not None:
                    total[segment.wanted], end[index] = value[:-1], value[-1]
    if pinning is not None:
        whole[1, :-1] += pinning[1:count]
    begun = np.concatenate([np.zeros((2, 1)), np.cumsum(whole, axis=1)[:, :-1]], axis=1)
    if pinning is not None:
        begun[1] += pinning[0]
    for index, mine, _ in visits:
        work[mine] += begun[0, index]
        dissipated[mine] += begun[1, index]


def _groups(record: Record, loads: LoadTable, count: int) -> Iterator[tuple[Integers, Loads]]:
    """Yield segments of one status under loads of the same frequencies, and these loads from their starts."""
    starts = record.starts[:count]
    interval = np.clip(np.searchsorted(loads.edges, starts, side="right") - 1, 0, loads.constant.shape[0] - 1)
    _, kind = np.unique(np.column_stack([loads.counts, loads.omega]), axis=0, return_inverse=True)
    keys = np.column_stack([record.status_numbers[:count], kind.ravel()[interval]])
    _, group = np.unique(keys, axis=0, return_inverse=True)
    order = np.argsort(group.ravel(), kind="stable")
    edges = np.flatnonzero(np.diff(group.ravel()[order])) + 1
    for members in np.split(order, edges):
        own = interval[members]
        late = starts[members] - loads.edges[own]
        omega = loads.omega[own[0], : loads.counts[own[0]]]
        amplitude = (
            np.transpose(loads.amplitude[own][:, :, : omega.size], (2, 1, 0))
            * np.exp(1j * omega[:, None] * late)[:, None, :]
        )
        constant = (loads.constant[own] + loads.slope[own] * late[:, None]).T
        yield members, Loads(omega, constant, loads.slope[own].T, amplitude)
