"""Checks of the arguments of `vofem.simulate`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import nearest, number, one_of, series
from vofem.arrays import Array
from vofem.bodies.base import Point
from vofem.errors import ArgumentError
from vofem.histories.tables import named_points
from vofem.initial import Initial
from vofem.integrators.base import ProbeRows
from vofem.integrators.registry import advice, method_named, method_names
from vofem.lookup import rows_over
from vofem.scene import Scene, as_scene
from vofem.simulate.methods import choose, hint, option_names
from vofem.simulate.plan import Plan

#: Arguments of every run, which a misspelt option may be meant for.
_ARGUMENTS = (
    "initial",
    "t_start",
    "method",
    "dt",
    "tol",
    "times",
    "progress",
    "probes",
    "checkpoint",
    "checkpoint_every",
    "compiled",
)


def checked_plan(
    scene: Scene,
    t_end: float,
    method: str,
    dt: float | None,
    tol: float | None,
    times: ArrayLike | None,
    probes: Mapping[str, Any] | Iterable[Any] | None,
    options: dict[str, Any],
    initial: Any = None,
    t_start: float = 0.0,
    compiled: bool | None = None,
) -> Plan:
    """Return what is to be run, or raise `ArgumentError` for arguments that do not go together.

    Parameters are those of `vofem.simulate`.
    """
    t_end = number("simulate: t_end", t_end, positive=True)
    if not (compiled is None or isinstance(compiled, (bool, np.bool_))):
        raise ArgumentError(
            f"simulate: compiled is {compiled!r}, expected True, False or None, which lets vofem decide"
        )
    wanted = None if times is None else _output_times(times, t_end)
    system = as_scene("simulate", scene).model.system
    t_start = number("simulate: t_start", t_start, minimum=0)
    other = None if initial is None else Initial("simulate: initial", scene.bodies, initial, by_name=True)
    if tol is not None:
        tol = number("simulate: tol", tol, positive=True)
    # Steps of one size were asked for by name only, so dt is answered below.
    _check_method(method)
    chosen = choose(system, t_end, tol if dt is None else None).method if method == "auto" else method
    _check_options(chosen, options)
    description = method_named(chosen)
    if not description.steps:
        if dt is not None:
            if method != "auto":
                raise ArgumentError(f"simulate: dt was given, but {chosen} has no step; leave it out")
            others = advice(system, steps=True)
            cure = f"leave dt out, or use {others}" if others else "leave dt out: no method with steps treats the scene"
            raise ArgumentError(
                f"simulate: dt was given, but method='auto' takes {chosen} for this scene, which has no step; {cure}"
            )
        wanted = np.linspace(0.0, t_end, 1001) if wanted is None else wanted
    if tol is not None:
        if description.adaptive:
            options = {**options, "tol": tol}
        elif not (description.exact and method == "auto"):
            # Where "auto" takes a method without errors of steps, any tolerance is met.
            has = "no step" if not description.steps else "no steps that follow a tolerance"
            raise ArgumentError(
                f"simulate: tol was given, but {chosen} has {has}; choose {advice(adaptive=True)}, or leave it out"
            )
    step = None if dt is None else number("simulate: dt", dt, positive=True)
    rows = None if probes is None else _probe_rows(scene, probes)
    start = None if other is None else scene.initial_state(other)
    return Plan(chosen, t_end, wanted, step, options, rows, start, t_start, scene.forgotten(other), compiled)


def _check_method(method: Any) -> None:
    """Raise for a method that there is not."""
    names = ("auto", *method_names())
    if not isinstance(method, str) or method not in names:
        raise ArgumentError(f"simulate: method is {method!r}, expected {one_of(names)}{hint(method, names)}")


def _check_options(chosen: str, options: dict[str, Any]) -> None:
    """Raise for options that a method does not take."""
    taken = option_names(chosen)
    unknown = sorted(set(options) - set(taken))
    if unknown:
        raise ArgumentError(
            f"simulate: method {chosen!r} does not know the option {unknown[0]!r}"
            f"{nearest(unknown[0], (*taken, *_ARGUMENTS))}; it takes {', '.join(taken) or 'none of its own'}"
        )


def _probe_rows(scene: Scene, probes: Mapping[str, Any] | Iterable[Any]) -> ProbeRows | None:
    """Return names and rows of points to be recorded, or None where there are none."""
    if not isinstance(probes, (Point, Iterable)):
        raise ArgumentError(
            f"simulate: probes is {probes!r}, expected points such as beam.at(x), or a dict of names and points"
        )
    named = named_points("simulate: probes", scene, probes)
    return ProbeRows(tuple(named), rows_over(scene.model, scene.bodies, named.values())) if named else None


def _output_times(times: ArrayLike, t_end: float) -> Array:
    """Return where results are wanted, within [0, t_end], checked."""
    wanted = series("simulate: times", times)
    if np.any(np.diff(wanted) < 0):
        k = int(np.argmax(np.diff(wanted) < 0))
        raise ArgumentError(
            f"simulate: times must be a list of times that does not decrease, found {wanted[k]:g} s "
            f"followed by {wanted[k + 1]:g} s"
        )
    slack = 1e-12 * t_end
    if wanted[0] < 0.0 or wanted[-1] > t_end + slack:
        raise ArgumentError(
            f"simulate: times reaches from {wanted[0]:g} to {wanted[-1]:g} s, expected within 0 to t_end = {t_end:g} s"
            f"; uniform times are np.linspace(0, {t_end:g}, count)"
        )
    return np.minimum(wanted, t_end)
