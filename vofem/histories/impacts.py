"""The impacts of a contact one by one, and its statistics over a window of time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import array
from vofem.arrays import Array, IntArray
from vofem.effects.two_points import Units
from vofem.errors import ArgumentError
from vofem.histories.motion import Motion
from vofem.histories.table import Table, Tabled, column, tabled
from vofem.histories.touches import RESOLVED, Parts, Span, Touches, resolve, spans_of
from vofem.system import CLOSED, PINNED, ContactLaws

if TYPE_CHECKING:
    from vofem.integrators.event_driven.bounces import Bounces


#: A contact with a penetration at t = 0 beyond this share of gap and displacement counts as closed before t = 0.
_AT_GAP = 1e-9

_UNKNOWN = (
    "the run stored its states at times that are too far apart for its steps, so forces between them are not known; "
    "simulate without times=, or with times= at most two steps apart"
)


@tabled(", shape (n,)")
class Impacts(Tabled):
    """The impacts of a contact in the order of time: the intervals in which it is closed or pinned at its gap.

    For a contact that acts on rotations, read rad for m, and N m for N. A force or a work that cannot be computed from
    the run is NaN, and `why` gives the reason.
    """

    name: str = column(None, "Name of the contact.")
    closing: Array = column(
        "s", "Times at which impacts begin. The first one begins at 0 if the contact starts closed."
    )
    opening: Array = column("s", "Times at which they end.")
    duration: Array = column("s", "Duration of each impact.", init=False)
    ended: NDArray[np.bool_] = column(
        "", "False if the run ends before the contact opens. In that case `opening` is the end of the run."
    )
    approach_speed: Array = column(
        "{coordinate}/s",
        "Rate at which the gap closes at `closing`. NaN where the contact does not close within the run.",
    )
    departure_speed: Array = column(
        "{coordinate}/s",
        "Rate at which the gap opens at `opening`. NaN where the contact does not open within the run.",
    )
    peak_force: Array = column("{force}", "The force of largest magnitude; inf for an impact on a rigid stop.")
    peak_time: Array = column("s", "Time at which it is reached.")
    impulse: Array = column("{impulse}", "Integral of the force over time.")
    work: Array = column(
        "J",
        "Work done on the contact while it is pressed in. If an elastic contact is pressed in once, this is the "
        "largest energy stored in it.",
    )
    absorbed: Array = column(
        "J",
        "The part of `work` that is not returned: the energy dissipated in the damper, and the energy that is "
        "stored at the end of the run.",
    )
    error: float = column(
        None,
        "Estimated error of the forces between events, divided by the largest force. It is 1e-10 unless the motion "
        "oscillates very often while the contact is closed. For a stepping method it is 0: the forces are as exact "
        "as the steps.",
    )
    units: Units = column(None, "Units of coordinate, force and impulse.")
    why: str = column(None, "The reason why forces are not known; empty if they are known.")

    def __post_init__(self) -> None:
        object.__setattr__(self, "duration", self.opening - self.closing)

    def __len__(self) -> int:
        return int(self.closing.size)

    def __repr__(self) -> str:
        return f"Impacts({self.name!r}, {len(self)} impacts)"

    def table(self) -> Table:
        """Return the impacts as a table with one impact in each row."""
        return Table(self.quantities(), f"Impacts of contact {self.name!r}", (self.why,) if self.why else ())

    def to_dataframe(self) -> Any:
        """Return a `pandas.DataFrame`, one row an impact; see `Table.to_dataframe`."""
        return self.table().to_dataframe()


@tabled("")
class ContactStatistics(Tabled):
    """What a contact does over a window of time.

    For a contact that acts on rotations, read rad for m, and N m for N. Means are over the whole window, open times
    included, unless they say otherwise. A value that cannot be computed from the run is NaN, and `why` gives the
    reason. A mean over impacts is NaN if there is no impact.
    """

    name: str = column(None, "Name of the contact.")
    begin: float = column("s", "Begin of the window.")
    end: float = column("s", "End of the window.")
    count: int = column("", "Number of impacts that begin in the window.")
    rate: float = column("1/s", "`count` divided by the length of the window.")
    closed_share: float = column("", "Share of the window in which the contact is closed or pinned.")
    mean_duration: float = column("s", "Mean duration of the impacts that begin in the window and end within the run.")
    mean_approach_speed: float = column(
        "{coordinate}/s", "Mean approach speed of the impacts that begin in the window."
    )
    largest_approach_speed: float = column("{coordinate}/s", "Largest approach speed of these impacts.")
    peak_force: float = column("{force}", "The force of largest magnitude in the window.")
    mean_force: float = column("{force}", "Mean of the force.")
    rms_force: float = column("{force}", "Root of its mean square.")
    mean_closed_force: float = column("{force}", "Mean force over the time in which the contact is closed.")
    impulse: float = column("{impulse}", "Integral of the force over the window.")
    work: float = column("J", "Work done on the contact while it is pressed in.")
    work_rate: float = column("W", "`work` divided by the length of the window.")
    work_per_impact: float = column("J", "`work` divided by `count`.")
    absorbed: float = column(
        "J", "Energy that the contact takes for good in the window, without what it stores at its ends."
    )
    absorbed_rate: float = column("W", "`absorbed` divided by the length of the window.")
    error: float = column(None, "Estimated relative error; see `Impacts`.")
    units: Units = column(None, "Units of coordinate, force and impulse.")
    why: str = column(None, "The reason why forces are not known; empty if they are known.")

    def __str__(self) -> str:
        lines = [f"Contact {self.name!r}"]
        for name, (value, unit) in self.quantities().items():
            lines.append(f"  {name.replace('_', ' '):<24}{value:>14.6g} {unit}".rstrip())
        return "\n".join([*lines, f"  not known: {self.why}"] if self.why else lines)


class ImpactRecord:
    """Impacts and statistics of one contact; what both need is computed once.

    `index`: number of the contact.
    `most`: how many impacts are looked at, from the first on; all where not given.
    `tolerance`: accepted error of the forces between events, divided by the largest force.
    """

    def __init__(
        self, run: Motion, laws: ContactLaws, index: int, units: Units, most: int | None = None,
        tolerance: float = RESOLVED,
    ) -> None:  # fmt: skip
        self._run, self._laws, self._index, self._units = run, laws, index, units
        span = spans_of(run, index)
        self.span = Span(span.begin[:most], span.end[:most], span.ended[:most])
        self._touches, self._why = self._resolved(tolerance)
        self._bounces = self._bounces_of_spans() if laws.rigid[index] else None
        self._approach, self._departure = self._speeds()

    def _bounces_of_spans(self) -> tuple[IntArray, Array, Bounces]:
        """Return the spans of the impacts on a rigid stop, their times in s, and the impacts."""
        solution: Any = self._run.solution
        events, every = solution.events, solution.bounces
        entered = events.stays(self._index, CLOSED, PINNED)[0]
        span = np.searchsorted(entered, every.event, side="right") - 1
        own = (every.contact == self._index) & (span < self.span.begin.size)
        bounces = type(every)(*(values[own] for values in every))
        return span[own], events.time[bounces.event], bounces

    def _resolved(self, tolerance: float) -> tuple[Touches, str]:
        """Return force and rate over all stretches that the run knows, and why not over all."""
        found = resolve(self._run, self._laws, self._index, self.span.begin, self.span.end, tolerance)
        if found is not None:
            return found, ""
        none = np.empty((6, 0))
        return Touches(np.empty(0, dtype=np.int64), np.empty(0), np.empty(0), none, none), _UNKNOWN

    def _rate_at(self, times: Array) -> tuple[Array, Array]:
        """Return gap function and its rate at some times; NaN where the run does not know them."""
        laws, index = self._laws, self._index
        try:
            samples = self._run.solution.sample(times)
        except ArgumentError:
            return np.full(times.size, np.nan), np.full(times.size, np.nan)
        return laws.gap_function(samples, index, times), laws.gap_rate(samples, index, times)

    def _stored(self, times: Array) -> Array:
        """Return the energy in J that the contact stores at some times, of the same shape."""
        laws = self._laws
        # All others are open.
        u = np.repeat(laws.gap[:, None] - 1.0, times.size, axis=1)
        u[self._index] = laws.gap[self._index] + self._rate_at(times)[0]
        return laws.potential(u)

    def _speeds(self) -> tuple[Array, Array]:
        """Return the speeds at which the gap closes and opens, each of shape (n,)."""
        span = self.span
        gap, closing = self._rate_at(span.begin)
        _, opening = self._rate_at(span.end)
        size = abs(float(self._laws.gap[self._index])) + np.abs(gap + self._laws.gap[self._index])
        if self._bounces is not None:
            of, _, bounces = self._bounces
            approach, departure = np.full((2, span.begin.size), np.nan)
            # The first impact of a span is its approach. One that ends without a bounce leaves slowly, as forces pull.
            approach[of[::-1]] = bounces.approach[::-1]
            departure[span.ended] = 0.0
            bounced = span.end[of] == self._bounces[1]
            departure[of[bounced]] = bounces.departure[bounced]
            return approach, departure
        preloaded = (span.begin == 0.0) & (np.abs(gap) > _AT_GAP * size)
        return np.where(preloaded, np.nan, closing), np.where(span.ended, -opening, np.nan)

    def impacts(self) -> Impacts:
        """Return the impacts one by one."""
        span, touches, n = self.span, self._touches, self.span.begin.size
        if self._why:
            peak, peak_time, impulse, work, absorbed = np.full((5, n), np.nan)
        else:
            parts = touches.parts()
            found, of = touches.integrals(parts), touches.span[parts.panel]
            peak, peak_time = _largest(*touches.peaks(parts), of, n)
            impulse, work, absorbed = (
                np.bincount(of, values, n).astype(float) for values in (found.force, found.pressed, found.work)
            )
            if self._bounces is not None:
                of, times, bounces = self._bounces
                # The force of an impact on a rigid stop has no bound. The last one of many that accumulate is nothing.
                struck = self._run.solution.events.contact[bounces.event]
                hard = (bounces.departure > 0.0) | (self._laws.restitution[struck] == 0.0)
                peak[of[hard]], peak_time[of[hard]] = np.inf, times[hard]
                for total, more in zip(
                    (impulse, work, absorbed), (bounces.impulse, bounces.pressed, bounces.lost), strict=True
                ):
                    total += np.bincount(of, more, n)
        return Impacts(
            self._laws.names[self._index], span.begin, span.end, span.ended, self._approach, self._departure, peak,
            peak_time, impulse, work, absorbed, touches.error, self._units, self._why,
        )  # fmt: skip

    def statistics(self, window: ArrayLike | None) -> ContactStatistics:
        """Return what the contact does over a window of time; see `ContactHistory.statistics`."""
        t_end = float(self._run.solution.t_end)
        begin, end = window_of(f"statistics of contact {self._laws.names[self._index]!r}", window, t_end)
        span, length = self.span, end - begin
        # An impact that begins exactly at the end of a window belongs to the next window, if there is one.
        started = (span.begin >= begin) & ((span.begin < end) | (end >= t_end))
        finished = started & span.ended
        count = int(np.sum(started))
        closed = float(np.sum(np.maximum(np.minimum(span.end, end) - np.maximum(span.begin, begin), 0.0)))
        speeds = self._approach[started]
        speeds = speeds[~np.isnan(speeds)]
        impulse = square = work = absorbed = peak = np.nan
        if not self._why:
            parts: Parts = self._touches.parts((begin, end))
            found = self._touches.integrals(parts)
            impulse, square = float(found.force.sum()), float(found.square.sum())
            stored = self._stored(np.array([begin, end]))
            work, absorbed = float(found.pressed.sum()), float(found.work.sum() - stored[1] + stored[0])
            peaks, _ = self._touches.peaks(parts)
            peak = float(peaks[np.argmax(np.abs(peaks))]) if peaks.size else 0.0
            if self._bounces is not None:
                _, times, bounces = self._bounces
                within = (times >= begin) & ((times < end) | (end >= t_end))
                if within.any():
                    peak = square = np.inf
                impulse += float(bounces.impulse[within].sum())
                work, absorbed = (
                    work + float(bounces.pressed[within].sum()),
                    absorbed + float(bounces.lost[within].sum()),
                )
        return ContactStatistics(
            name=self._laws.names[self._index],
            begin=begin,
            end=end,
            count=count,
            rate=count / length,
            closed_share=closed / length,
            mean_duration=_mean((span.end - span.begin)[finished]),
            mean_approach_speed=_mean(speeds),
            largest_approach_speed=float(speeds.max()) if speeds.size else np.nan,
            peak_force=peak,
            mean_force=impulse / length,
            rms_force=float(np.sqrt(square / length)),
            mean_closed_force=impulse / closed if closed else np.nan,
            impulse=impulse,
            work=work,
            work_rate=work / length,
            work_per_impact=work / count if count else np.nan,
            absorbed=absorbed,
            absorbed_rate=absorbed / length,
            error=self._touches.error,
            units=self._units,
            why=self._why,
        )


def window_of(what: str, window: ArrayLike | None, t_end: float) -> tuple[float, float]:
    """Return begin and end of a window in s, the whole run by default; raise `ArgumentError` where it lies outside."""
    if window is None:
        return 0.0, t_end
    ends = array(f"{what}: window", window)
    if ends.shape != (2,) or not 0.0 <= ends[0] < ends[1] <= t_end * (1.0 + 1e-12):
        raise ArgumentError(
            f"{what}: window is {ends.tolist()}, expected two times within the run, 0 <= begin < end <= {t_end:g} s"
        )
    return float(ends[0]), min(float(ends[1]), t_end)


def _largest(values: Array, times: Array, of: NDArray[np.int64], count: int) -> tuple[Array, Array]:
    """Return for each of `count` groups the value of largest magnitude and its time, 0 and NaN where there is none."""
    order = np.lexsort((np.abs(values), of))
    found, at = np.zeros(count), np.full(count, np.nan)
    # Assignment keeps the last entry of each group.
    found[of[order]], at[of[order]] = values[order], times[order]
    return found, at


def _mean(values: Array) -> float:
    return float(values.mean()) if values.size else np.nan
