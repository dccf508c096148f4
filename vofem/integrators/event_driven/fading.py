"""Free motion of many segments of a status, without what has decayed below rounding.

An overdamped block is the sum of two exponentials, and the faster one is soon gone. Such blocks are therefore described
by the amplitudes of their exponentials, and all others by their states (z, v), as pairs. Coordinates are ordered by
their decay rates. From some time on only the first ones of this order still move. The others have then lost their whole
initial state, up to a share of the motion that is below rounding.

With ``w^2 = p`` the state ``(w z, v)`` of a free block decays at least as ``exp(-r t)``, where r is the decay rate of
its slowest root, times a factor that is ``sqrt((1 + d) / |1 - d|)`` for the damping ratio d. The factor
``1 + (delta + w) t`` bounds it too. It is used close to critical damping, together with half of the decay rate.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vofem.kernels.jit import jit, plain_form
from vofem.linalg.exponential import oscillator_changes
from vofem.linalg.oscillators import Oscillators, decays, oscillators, oscillators_at, remainders_at

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Share of the motion, over the number of coordinates, below which a coordinate has come to rest: 1/16 of rounding.
_STILL = 2.0**-56

#: Factor above which a block counts as nearly critically damped and is not split into exponentials.
_CRITICAL = 10.0

#: Ratio of the numbers of coordinates in neighbouring classes, least number of coordinates and of times in a class.
_RATIO, _FEWEST, _LEAST_TIMES = 0.75, 4, 64

#: Number of times of one status from which on it pays to leave out what has come to rest.
DENSE = 512

#: Terms of the series of ``exp(-x) - 1 + x`` for x < 0.5.
_TERMS = 15


class Moving(NamedTuple):
    """The coordinates that still move, of one class.

    Attributes
    ----------
    which, rest : ndarray of int
        Numbers of these coordinates and of all others: displacements of pairs, their velocities, exponentials.
    pairs : Oscillators
    rate : ndarray
        Decay rates of the exponentials, 1/s.
    """

    which: Integers
    rest: Integers
    pairs: Oscillators
    rate: Array


class Fading:
    """The free motion of a status in coordinates that come to rest one after the other.

    Coordinates 0...n-1 are those of block displacements, n...2n-1 those of block velocities. Of an overdamped block,
    where damping couples modes, they are the amplitudes of its slower and of its faster exponential instead.

    Parameters
    ----------
    delta, p : ndarray, shape (n,)
        Decay rates in 1/s and squared frequencies in 1/s^2 of the blocks.
    out : ndarray, shape (2n, 2n), optional
        Map from block states to displacements and velocities of real modes; None where blocks are real modes.
    stiffness : ndarray, shape (n,)
        Squared frequencies of the real modes, 1/s^2.
    """

    def __init__(self, delta: Array, p: Array, out: Array | None, stiffness: Array) -> None:
        w, n = np.sqrt(p), p.size
        self._delta, self._p = delta, p
        root = np.sqrt(np.maximum(delta**2 - p, 0.0))
        rate = np.where(root > 0.0, p / np.where(root > 0.0, delta + root, 1.0), delta)
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = np.sqrt((w + delta) / np.abs(w - delta))
            growth = 2.0 * (w + delta) / rate
            near = growth * np.exp(1.0 / growth - 1.0)
        close = ~(factor <= _CRITICAL) & (rate > 0.0)
        #: Blocks of two exponentials, and the roots of these.
        split = np.flatnonzero((root > 0.0) & ~close & (rate > 0.0) & (out is not None))
        self._split = split
        self._roots = -rate[split], -(delta + root)[split]
        self._alone = np.zeros(n, dtype=bool)
        self._alone[split] = True
        rate, factor = np.where(close, 0.5 * rate, rate), np.where(close, near, factor)
        self._rate, self._factor = np.tile(rate, 2), np.tile(np.where(rate > 0.0, factor, 1.0), 2)
        self._speed = np.tile(w + delta, 2)
        for half, own in enumerate(self._roots):
            at = half * n + split
            self._rate[at], self._factor[at], self._speed[at] = -own, 1.0, -own
        self._norm = self._norms(out, stiffness)
        # Both coordinates of a pair have one rate, and so follow each other.
        both = np.arange(2 * n).reshape(2, n).T.ravel()
        self._order = both[np.argsort(self._rate[both], kind="stable")]
        lasting = int(np.sum(self._rate == 0.0))
        counts = [2 * n]
        while counts[-1] > max(_FEWEST, lasting):
            counts.append(self._whole_pairs(max(int(_RATIO * counts[-1]), lasting), counts[-1]))
        self._counts = np.array(counts)
        self._moving: dict[int, Moving] = {}

    def _whole_pairs(self, count: int, less: int) -> int:
        """Return a number of coordinates that cuts no pair, up to one more than asked for, or one less than `less`."""
        n = self._p.size
        last = int(self._order[count - 1])
        if last < n and not self._alone[last]:
            count += 1 if count + 1 < less else -1
        return count

    def moving(self, number: int) -> Moving:
        """Return the coordinates of a class; class 0 has all, later ones have fewer and fewer."""
        if number not in self._moving:
            n = self._p.size
            chosen = np.zeros(2 * n, dtype=bool)
            chosen[self._order[: self._counts[number]]] = True
            pairs = np.flatnonzero(chosen[:n] & ~self._alone)
            single = np.concatenate([half + self._split[chosen[half + self._split]] for half in (0, n)])
            which = np.concatenate([pairs, n + pairs, single]).astype(np.int64)
            of = oscillators(self._delta[pairs], self._p[pairs])
            self._moving[number] = Moving(which, np.flatnonzero(~chosen), of, self._rate[single])
        return self._moving[number]

    def _norms(self, out: Array | None, stiffness: Array) -> Array:
        """Return the square roots of the energies of unit coordinates, shape (2n,)."""
        n = stiffness.size
        if out is None:
            return np.sqrt(0.5) * np.concatenate([np.sqrt(self._p), np.ones(n)])
        out = self.functionals(out)
        return np.asarray(np.sqrt(0.5 * (stiffness @ out[:n] ** 2 + np.sum(out[n:] ** 2, axis=0))))

    def functionals(self, rows: Array) -> Array:
        """Return rows over the coordinates from rows over the block states, shape (..., 2n)."""
        if not self._split.size:
            return rows
        z, v = self._split, self._p.size + self._split
        answer = rows.copy()
        for at, own in zip((z, v), self._roots, strict=True):
            answer[..., at] = rows[..., z] + own * rows[..., v]
        return answer

    def states(self, blocks: Array) -> Array:
        """Return the coordinates of block states, shape (2n, k)."""
        if not self._split.size:
            return blocks
        z, v = self._split, self._p.size + self._split
        slower, faster = (own[:, None] for own in self._roots)
        answer = blocks.copy()
        answer[z] = (blocks[v] - faster * blocks[z]) / (slower - faster)
        answer[v] = (slower * blocks[z] - blocks[v]) / (slower - faster)
        return answer

    def form(self, matrix: Array) -> Array:
        """Return a quadratic form over the coordinates, (2n, 2n), of one over the block states, or of its diagonal."""
        return matrix if matrix.ndim == 1 else self.functionals(self.functionals(matrix).T).T

    def choose(self, start: Array, segment: Integers, tau: Array, duration: Array, lasting: Integers) -> Integers:
        """Return the number of the class of the coordinates that still move at each time, shape (n_times,).

        Parameters
        ----------
        start : ndarray, shape (2n, k)
            Coordinates at the begin of k segments.
        segment : ndarray of int, shape (n_times,)
        tau : ndarray, shape (n_times,)
            Times from the begins of segments, s.
        duration : ndarray, shape (k,)
            Longest of these times in each segment.
        lasting : ndarray of int
            Coordinates that also respond to loads from rest, and do not come to rest.
        """
        chosen = np.zeros(tau.size, dtype=np.int64)
        if self._counts.size == 1:
            return chosen
        size = self._norm[:, None] * np.abs(start)
        # What is left at the end of the segment, of displacements and velocities, and of accelerations.
        left = size * np.exp(-np.minimum(self._rate[:, None] * duration, 700.0))
        speed = self._speed[:, None]
        motion, change = left.sum(axis=0), (speed * left).sum(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            still = _STILL / size.shape[0] * np.minimum(motion, change / speed)
            end = np.log(self._factor[:, None] * size / still) / self._rate[:, None]
        # A coordinate without any motion has come to rest already.
        end = np.where(size > 0.0, np.where(np.isfinite(end), end, np.inf), 0.0)
        end[lasting] = np.inf
        last = np.maximum.accumulate(end[self._order][::-1], axis=0)[::-1]
        for count in self._counts[1:]:
            chosen += last[count, segment] < tau
        # Few times are not worth a class of their own. They are evaluated with more coordinates.
        times, place = np.bincount(chosen, minlength=self._counts.size), np.arange(self._counts.size)
        for c in range(self._counts.size - 1, 0, -1):
            if times[c] < _LEAST_TIMES:
                place[place == c] = c - 1
                times[c - 1] += times[c]
        return np.asarray(place[chosen])


@jit
def _pair_changes(of: Oscillators, c: Array, s: Array, start: Array, row: Array) -> None:
    """Write the changes of pairs into a row, from the functions c and s of `oscillators_at` or `remainders_at`."""
    n = of.p.size
    for k in range(n):
        z0, v0 = start[k], start[n + k]
        row[k] = c[k] * z0 + s[k] * (v0 + of.delta[k] * z0)
        row[n + k] = c[k] * v0 - s[k] * (of.p[k] * z0 + of.delta[k] * v0)


@jit
def free_rows(of: Oscillators, rate: Array, starts: Array, segment: Integers, tau: Array, change: Array) -> None:
    """Fill in by how much coordinates have changed since the begins of segments, a row each time.

    Parameters
    ----------
    of : Oscillators
        The pairs.
    rate : ndarray, shape (n_exponentials,)
        Decay rates of the exponentials, 1/s.
    starts : ndarray, shape (k, m)
        Coordinates at the begins of segments, in the order of `Moving.which`.
    segment, tau : ndarray, shape (n_times,)
        Row of `starts` for each time, and times from the begins, s.
    change : ndarray, shape (n_times, m)
    """
    n, count = of.p.size, rate.size
    c, s = np.empty((2, n))
    lost, bits = np.empty(count), np.zeros(count, dtype=np.int64)
    power = bits.view(np.float64)
    for i in range(tau.size):
        start, row = starts[segment[i]], change[i]
        if n:
            oscillators_at(of, tau[i], c, s)
        _pair_changes(of, c, s, start, row)
        if count:
            decays(rate, tau[i], lost, bits, power)
            for k in range(count):
                row[2 * n + k] = lost[k] * start[2 * n + k]


@plain_form(free_rows)
def _free_rows_at_once(
    of: Oscillators, rate: Array, starts: Array, segment: Integers, tau: Array, change: Array
) -> None:
    n = of.p.size
    c, s = (part.T for part in oscillator_changes(of.delta, of.p, tau))
    z0, v0 = starts[segment, :n], starts[segment, n : 2 * n]
    change[:, :n] = c * z0 + s * (v0 + of.delta * z0)
    change[:, n : 2 * n] = c * v0 - s * (of.p * z0 + of.delta * v0)
    change[:, 2 * n :] = np.expm1(-np.outer(tau, rate)) * starts[segment, 2 * n :]


@jit
def second_order_rows(
    of: Oscillators, rate: Array, starts: Array, segment: Integers, tau: Array, change: Array, rest: Array
) -> None:
    """Do what `free_rows` does, and fill in `rest`, shape (n_times, m), with the part beyond that in proportion to tau.

    All of `rest` is accurate however short the times are.
    """
    n, count = of.p.size, rate.size
    c, s = np.empty((2, n))
    lost, bits = np.empty(count), np.zeros(count, dtype=np.int64)
    power = bits.view(np.float64)
    for i in range(tau.size):
        start, t, row, later = starts[segment[i]], tau[i], change[i], rest[i]
        if n:
            oscillators_at(of, t, c, s)
        _pair_changes(of, c, s, start, row)
        if n:
            remainders_at(of, t, c, s)
        _pair_changes(of, c, s, start, later)
        if count:
            decays(rate, t, lost, bits, power)
        for k in range(count):
            x, z0 = rate[k] * t, start[2 * n + k]
            row[2 * n + k] = lost[k] * z0
            later[2 * n + k] = (lost[k] + x) * z0
            if x < 0.5:
                series = 1.0
                for j in range(_TERMS, 2, -1):
                    series = 1.0 - series * x / j
                later[2 * n + k] = 0.5 * x * x * series * z0
