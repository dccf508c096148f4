"""What contacts and sliders of an orbit do that most likely ends a branch there."""

from __future__ import annotations

import numpy as np

from vofem.studies.steady.following.point import Point
from vofem.studies.steady.following.watched import NEARLY
from vofem.studies.steady.segments.gaps import law_of
from vofem.studies.steady.segments.signature import Signature
from vofem.system import CLOSED, OPEN, PINNED

#: Distance of an extreme from its gap, over the size of the motion, that is told where a branch is lost, and the number
#: of touches above which a contact may chatter.
_CLOSE, _SEQUENCE = 1e-4, 3

#: Length in rad of a rest at a rigid stop that is about to end.
_BRIEF = 0.02


def what_contacts_do(point: Point) -> str:
    """Return what of an orbit most likely ends a branch there, as the end of a sentence; "" for nothing.

    These are, the most likely first: sliders and contacts that rest, impacts without end, short touches, grazings.
    """
    chart = point.chart
    laws = point.problem.system.contacts if isinstance(chart, Signature) else None
    if laws is None:
        return ""
    found: dict[tuple[int, str], list[str]] = {}
    for contact, name in enumerate(laws.names):
        kind, hits = law_of(point.problem, contact), chart.struck.count(contact)
        rests = [status[contact] == PINNED for status in chart.statuses]
        count, shortest, what = _short_touches(point, contact)
        touches = f"{what} at {{}}{', the shortest' if count > 1 else ''} for {shortest:.2g} rad of the load"
        near = min((-e.height for e in point.evaluation.extremes if e.contact == contact), default=np.inf)
        rest = _shortest_rest(point, contact)
        for rank, (holds, told) in enumerate((
            (
                kind == "impact" and rest < _BRIEF,
                f"{{}} resting for {rest:.2g} rad of the load only; its impacts become infinitely many where it no "
                "longer comes to rest",
            ),
            (kind != "stick" and any(rests), "{} resting at the gap for a part of it"),
            (kind == "jump" and count > _SEQUENCE, touches + ": where a force jumps they may become infinitely many"),
            (hits > _SEQUENCE, f"{hits} impacts on {{}}, which may become infinitely many"),
            (shortest < NEARLY, touches),
            (kind == "stick" and near < _CLOSE, "{} about to stop or to slide for a short time"),
            (kind != "stick" and near < _CLOSE, f"{{}} within {max(near, 0.0):.2g} of the motion of the gap"),
            (kind == "stick" and all(rests), "{} sticking all along"),
        )):  # fmt: skip
            if holds:
                found.setdefault((rank, told), []).append(repr(name))
                break
    first = min(found, default=(0, ""))[0]
    parts = [told.format(" and ".join(names)) for (rank, told), names in found.items() if rank == first]
    return "; the orbit there has " + ", and ".join(parts) if parts else ""


def _shortest_rest(point: Point, contact: int) -> float:
    """Return the shortest time in rad of the load for which something rests at a rigid stop."""
    chart, lengths = point.chart, point.chart.lengths(point.y[:-1])
    rests = ((p, k) for p, k in chart.successive if chart.switches[p][:2] == (contact, PINNED))
    return min((float(lengths[p + 1 : k + 1].sum()) for p, k in rests), default=np.inf)


def _short_touches(point: Point, contact: int) -> tuple[int, float, str]:
    """Return the number of touches or openings of a contact, the shortest in rad of the load, and words for them."""
    chart, lengths = point.chart, point.chart.lengths(point.y[:-1])
    found: dict[int, list[float]] = {CLOSED: [], OPEN: []}
    for p, k in chart.touches:
        if chart.switches[p].contact == contact:
            found[chart.switches[p].status].append(float(lengths[p + 1 : k + 1].sum()))
    closed, opened = (min(found[status], default=np.inf) for status in (CLOSED, OPEN))
    status, one, many = (CLOSED, "a touch", "touches") if closed <= opened else (OPEN, "an opening", "openings")
    count = len(found[status])
    return count, min(closed, opened), f"{count} {many}" if count > 1 else one
