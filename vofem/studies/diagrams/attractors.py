"""Basins of attraction: the steady motion to which each initial state leads."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from vofem._validate import number, whole, wrong
from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.scene import Scene, as_scene
from vofem.studies.diagrams.bifurcation import Stroboscope, order_of, sizes_of, stroboscope
from vofem.studies.sweep import Sweep
from vofem.studies.sweep.sweeping import SweepOptions, sweep


@dataclass(frozen=True)
class Attractor:
    """A steady motion that some initial states lead to.

    Attributes
    ----------
    name : str
        "period 1", "period 2", ..., with a letter if there are several of one
        period. All motions that do not repeat are "not periodic".
    order : int
        Number of periods of the loads after which the motion repeats; 0 if it does not.
    points : ndarray, shape (2, n_points, order)
        Displacements in m and velocities in m/s, sampled once a period of the
        loads. For motions that do not repeat these are the samples of the first one.
    share : float
        Share of the initial states that lead to this motion.
    """

    name: str
    order: int
    points: Array
    share: float


@dataclass(frozen=True, eq=False)
class Basins:
    """The attractor to which each initial state leads.

    Attributes
    ----------
    attractors : tuple of Attractor
        The attractors, those with the most initial states first.
    index : ndarray of int
        Index of the attractor of every initial state, in the shape of the grid; -1 where the run failed.
    sweep : Sweep
        The runs. ``sweep["looks"]`` holds the samples, and `failed` the runs that failed.
    """

    attractors: tuple[Attractor, ...]
    index: NDArray[np.int64]
    sweep: Sweep

    def __repr__(self) -> str:
        parts = ", ".join(f"{one.name} ({100 * one.share:.3g} %)" for one in self.attractors)
        return f"<Basins: {' x '.join(map(str, self.index.shape))} initial states; {parts}>"


def basins(
    scene: Scene,
    grid: Mapping[str, Iterable[float]],
    *,
    start: Callable[..., Mapping[Any, Any]] | None = None,
    periods: int = 12,
    skip: int = 200,
    tolerance: float = 1e-6,
    points: Any = None,
    period: float | None = None,
    method: str = "auto",
    **options: Unpack[SweepOptions],
) -> Basins:
    """Return the steady motion to which each initial state of a grid leads.

    Parameters
    ----------
    scene : Scene
        The scene.
    grid : mapping of names to values
        Values that vary in the initial state. All combinations are run.
    start : callable, optional
        ``start(**point)`` returns the initial state for a point of the grid, in a form that `vofem.simulate` takes.
        Without it the names of the grid are ``displacement`` and ``velocity``, in m and m/s, of the only body.
    periods : int
        Number of samples, one in each period of the loads, at least 2. Attractors are
        recognised if they repeat after at most half as many periods.
    skip : int
        Periods of the loads before the first sample: the transient.
    tolerance : float
        Difference up to which two samples count as equal, relative to the largest sample of the point in all runs;
        velocities are compared with displacements too, as in a harmonic motion.
    points : point or name of a mass, or sequence of them, optional
        Points whose motion distinguishes attractors. The default is the point of the first contact.
    period : float, optional
        Time between two samples in s. The default is the common period of the loads.
    method : str
        See `vofem.simulate`.
    **options
        Options of `vofem.sweep`, such as ``executor``, ``store`` and ``progress``.

    Returns
    -------
    Basins

    Raises
    ------
    ArgumentError
        For arguments out of range, or if every run fails.
    """
    as_scene("basins", scene)
    tolerance = number("basins: tolerance", tolerance, positive=True)
    how = stroboscope("basins", points, period, whole("basins: periods", periods, least=2), skip, method)
    if not isinstance(grid, Mapping):
        raise wrong("basins: grid", repr(grid), "a dict of names to values")
    if start is None:
        if len(scene.bodies) != 1 or set(grid) != {"displacement", "velocity"}:
            raise ArgumentError(
                f"basins: the grid has the names {', '.join(map(repr, grid)) or 'none'}, expected 'displacement' and "
                f"'velocity' of one body, and the scene has {len(scene.bodies)}; for other starts give start="
            )
        start = functools.partial(_start_of, body=scene.bodies[0])
    table = sweep(functools.partial(_looks, scene=scene, start=start, how=how), grid, **options)
    if not len(table):
        raise ArgumentError(f"basins: every run failed, the first with: {table.failed[0].error}")
    samples = table["looks"].reshape(-1, *table["looks"].shape[-3:])
    sizes = sizes_of(np.moveaxis(samples, 0, 2), np.array([np.nanmax(table["period"])]))
    index, found = _distinct(samples, tolerance * sizes)
    counts = np.bincount(index[index >= 0], minlength=len(found))
    ranking = np.argsort(-counts, kind="stable")
    attractors = _named([found[j] for j in ranking], counts[ranking] / index.size)
    place = np.append(np.argsort(ranking), -1)
    return Basins(attractors, place[index].reshape(table.points.shape), table)


def _start_of(displacement: float, velocity: float, body: Any) -> dict[Any, Any]:
    return {body: (displacement, velocity)}


def _looks(scene: Scene, start: Callable[..., Mapping[Any, Any]], how: Stroboscope, **point: Any) -> dict[str, Any]:
    samples, period, _ = how.samples(scene, start(**point))
    return {"looks": samples, "period": period}


def _distinct(samples: Array, tolerance: Array) -> tuple[NDArray[np.int64], list[tuple[int, Array]]]:
    """Return the number of the attractor of every run, and order and points of each attractor."""
    found: list[tuple[int, Array]] = []
    index = np.full(samples.shape[0], -1, dtype=np.int64)
    for k, own in enumerate(samples):
        if not np.all(np.isfinite(own)):
            continue
        order = order_of(own, tolerance)
        own = own[..., : order or None]
        for j, (other, points) in enumerate(found):
            if other == order and (order == 0 or _same(own, points, tolerance)):
                index[k] = j
                break
        else:
            index[k] = len(found)
            found.append((order, own))
    return index, found


def _same(first: Array, second: Array, tolerance: Array) -> bool:
    """Return whether two periodic motions have the same points; they may begin at different ones."""
    # Ten times as far as a motion may be from itself a period later: it has not settled to the last bit.
    return any(
        bool(np.all(np.abs(np.roll(first, k, axis=-1) - second) <= 10.0 * tolerance)) for k in range(first.shape[-1])
    )


def _named(found: list[tuple[int, Array]], shares: Array) -> tuple[Attractor, ...]:
    orders = [order for order, _ in found]
    letters: dict[int, int] = {}
    result = []
    for (order, points), share in zip(found, shares.tolist(), strict=True):
        name = f"period {order}" if order else "not periodic"
        if orders.count(order) > 1:
            letters[order] = letters.get(order, 0) + 1
            name += f" ({_letters(letters[order])})"
        result.append(Attractor(name, order, points, share))
    return tuple(result)


def _letters(number: int) -> str:
    """Return a, b, ..., z, aa, ab, ... for 1, 2, ..."""
    text = ""
    while number > 0:
        number, digit = divmod(number - 1, 26)
        text = chr(ord("a") + digit) + text
    return text
