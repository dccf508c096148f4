"""Pictures of steady states: response curves, multipliers, phase portraits, Poincare sections, backbones."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.bodies.base import as_point
from vofem.errors import ArgumentError
from vofem.io.pictures.axes import COLORS, Where, color_of, figure, ink, legend, plain, single, stroke, text_size
from vofem.io.pictures.units import length
from vofem.studies.steady import Branch, Locus, PeriodicOrbit, PoincareSection

#: How special points are marked and named; their colours are numbers among those of the picture.
MARKS = {
    "fold": ("o", 4, "fold"),
    "period_doubling": ("D", 1, "period doubling"),
    "neimark_sacker": ("s", 3, "Neimark-Sacker"),
    "grazing": ("^", 2, "grazing"),
    "branch_point": ("P", 5, "branch point"),
    "sticking": ("X", 2, "onset of sticking"),
}

#: The same for points at which a locus is special itself.
_ON_LOCI = {**MARKS, "turn": ("o", 0, "turn"), "cusp": ("*", 0, "cusp")}

#: Lines of orbits by their stability: width, style and name.
LINES = {True: ("-", 1.8, "stable"), False: ("--", 1.3, "unstable"), None: ("-", 0.9, "stability not decided")}

#: So many special points are marked at full size.
_FEW = 8

#: Times at which a phase portrait is drawn beside those of events.
_DENSE = 2001


@figure
def response_curve(
    branch: Branch | Sequence[Branch],
    point: Any,
    path: Where = None,
    *,
    parameter: str = "parameter",
    title: str = "",
    ax: Any = None,
) -> Any:
    """Draw the amplitude of a point along branches: stable orbits solid, unstable ones dashed, special points marked.

    Parameters
    ----------
    branch : Branch, or several of them
        The branches. Each branch after the first has its own colour.
    point : point of a body, or name of a mass
    parameter : str
        Name and unit of the parameter, for the axis.
    title : str

    Raises
    ------
    ArgumentError
        If the branch has no orbits, or `point` is not a point of a body.
    """
    branches = [branch] if isinstance(branch, Branch) else branch
    if not all(len(one) for one in branches):
        raise ArgumentError("response_curve: a branch has no orbits; its notes say why it ended")
    place = as_point("response_curve: point", point, branches[0].orbits[0].scene.bodies)
    heights = [one.amplitude(place) for one in branches]
    marked = [[(s, s.orbit.amplitude(place)) for s in one.special] for one in branches]
    scale = length(float(max(part.max() for part in heights)))
    canvas, axes = single("response_curve", path, ax, (9.0, 5.4))
    for k, (one, amplitude) in enumerate(zip(branches, heights, strict=True)):
        color = color_of(k)
        for stable, values, line in stretches(one, amplitude, np.array([height for _, height in marked[k]])):
            style, width, name = LINES[stable]
            axes.plot(values, line / scale[0], style, color=color, linewidth=width, label=name)
    # Behind the curves, and smaller where there are many.
    size = 9.0 if sum(len(points) for points in marked) <= _FEW else 5.0
    for points in marked:
        for special, height in points:
            mark, number, name = MARKS[special.kind]
            axes.plot(
                special.value, height / scale[0], mark, color=COLORS[number], markersize=size, markerfacecolor="none",
                markeredgewidth=0.2 * size, linestyle="none", label=name, zorder=1.5,
            )  # fmt: skip
    axes.set(xlabel=plain(parameter), ylabel=f"amplitude [{scale[1]}]")
    axes.ticklabel_format(axis="x", useOffset=False)
    # Amplitudes that hardly differ would lie on the upper edge.
    axes.set_ylim(0.0, max(axes.get_ylim()[1], 1.05 * max(float(part.max()) for part in heights) / scale[0]))
    axes.set_title(plain(title or place.describe()), fontsize=text_size(11))
    legend(axes, most=12)
    return canvas


@figure
def locus(
    curves: Locus | Sequence[Locus],
    path: Where = None,
    *,
    parameter: str = "parameter",
    other: str = "second parameter",
    title: str = "",
    ax: Any = None,
) -> Any:
    """Draw curves of special points in the plane of two parameters, with the points where they turn, end or meet.

    Parameters
    ----------
    curves : Locus, or several of them
        Curves that `vofem.locus` has returned. The colour is that of the kind of special point.
    parameter, other : str
        Names and units of both parameters, for the axes.
    title : str

    Raises
    ------
    ArgumentError
        If an argument is not a locus.
    """
    loci = [curves] if isinstance(curves, Locus) else curves
    canvas, axes = single("locus", path, ax, (9.0, 5.4))
    for one in loci:
        _, number, name = MARKS[one.kind]
        shown = f"{name} of {one.contact}" if one.contact else name
        axes.plot(one.values[:, 0], one.values[:, 1], color=COLORS[number], linewidth=1.8, label=shown)
        for special in one.special:
            mark, number, name = _ON_LOCI[special.kind]
            axes.plot(
                special.value, special.other, mark, color=ink() if special.kind not in MARKS else COLORS[number],
                markersize=7.0, markerfacecolor="none", markeredgewidth=1.4, linestyle="none",
                label=name if special.kind not in MARKS else f"meets {name}",
            )  # fmt: skip
    axes.set(xlabel=plain(parameter), ylabel=plain(other))
    axes.ticklabel_format(useOffset=False)
    axes.set_title(plain(title or "loci of special points"), fontsize=text_size(11))
    legend(axes, most=12)
    return canvas


def stretches(branch: Branch, heights: Array, marked: Array) -> Iterator[tuple[bool | None, Array, Array]]:
    """Return the stretches of a branch of one stability: whether it is stable, its values, and what is drawn over them.

    Neighbouring stretches meet at the special point between them; if none is known, at the first orbit of the next one.
    `heights`, `marked`: what is drawn of orbits and of special points, shapes (n, ...) and (m, ...).
    """
    begin: list[tuple[float, Any]] = []
    start, orbits = 0, list(zip(branch.values.tolist(), heights, strict=True))
    points = [
        (special.place, (special.value, height)) for special, height in zip(branch.special, marked, strict=True)
        if special.kind not in ("grazing", "sticking")
    ]  # fmt: skip
    for stable, group in groupby(branch.stable.tolist()):
        stop = start + len(list(group))
        joint = [point for place, point in points if stop - 1 <= place <= stop][:1]
        values, shown = zip(*begin, *orbits[start:stop], *(joint or orbits[stop : stop + 1]), strict=True)
        yield stable, np.array(values), np.array(shown)
        begin, start = joint, stop


@figure
def multipliers(orbit: PeriodicOrbit | Sequence[PeriodicOrbit] | Branch, path: Where = None, *, ax: Any = None) -> Any:
    """Draw Floquet multipliers in the complex plane, with the unit circle; orbits without known ones are left out.

    Parameters
    ----------
    orbit : PeriodicOrbit, several of them, or Branch
        If there are several orbits, the colour of the multipliers changes from light to dark in the order of the
        orbits.

    Raises
    ------
    ArgumentError
        If the multipliers of no orbit are known.
    """
    orbits = orbit.orbits if isinstance(orbit, Branch) else [orbit] if isinstance(orbit, PeriodicOrbit) else orbit
    known = [one.multipliers for one in orbits if one.multipliers is not None]
    if not known:
        raise ArgumentError(
            "multipliers: the multipliers of no orbit are known. If its notes name a law with a memory, simulate the "
            "scene to see whether it settles; otherwise take more harmonics"
        )
    canvas, axes = single("multipliers", path, ax, (6.4, 5.6))
    turn = np.exp(2j * np.pi * np.linspace(0.0, 1.0, 361))
    axes.fill(turn.real, turn.imag, color="#eef1f6", linewidth=stroke(0.0), zorder=0)
    axes.plot(turn.real, turn.imag, color="#9aa0aa", linewidth=stroke(1.2), label="unit circle")
    values = np.concatenate(known)
    order = np.concatenate([np.full(part.size, k) for k, part in enumerate(known)])
    outside = np.abs(values) > 1.0
    if len(known) == 1:
        for part, color, name in ((~outside, ink(), "inside"), (outside, COLORS[4], "outside: unstable")):
            if np.any(part):
                axes.plot(values[part].real, values[part].imag, "o", color=color, markersize=7, label=name)
    else:
        dots = axes.scatter(values.real, values.imag, c=order, s=12, cmap="viridis_r", zorder=3)
        canvas.figure.colorbar(dots, ax=axes, label="number of the orbit [-]", shrink=0.8)
    limit = 1.15 * max(1.0, float(np.abs(values).max(initial=0.0)))
    # With very large multipliers the circle would shrink to a dot.
    limit = min(limit, 3.0)
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), xlabel="real part [-]", ylabel="imaginary part [-]")
    axes.set_box_aspect(1.0)
    beyond = int(np.sum(np.abs(values) > limit))
    if beyond:
        largest = values[np.argmax(np.abs(values))]
        text = f"{beyond} beyond this frame, the largest {largest.real:.4g}"
        text += f" {largest.imag:+.4g}i" if largest.imag else ""
        axes.text(0.02, 0.02, text, transform=axes.transAxes, fontsize=text_size(9))
    if len(known) == 1:
        legend(axes)
    return canvas


@figure
def phase_portrait(
    orbit: PeriodicOrbit | Sequence[PeriodicOrbit], point: Any, path: Where = None, *, ax: Any = None
) -> Any:
    """Draw velocity over displacement of a point, with the events of contacts.

    Parameters
    ----------
    orbit : PeriodicOrbit, or several of them
    point : point of a body, or name of a mass

    Raises
    ------
    ArgumentError
        If an argument is not an orbit, or not a point.
    """
    orbits = [orbit] if isinstance(orbit, PeriodicOrbit) else orbit
    place = as_point("phase_portrait: point", point, orbits[0].scene.bodies)
    canvas, axes = single("phase_portrait", path, ax, (7.6, 5.4))
    drawn = []
    for one in orbits:
        times = np.unique(np.concatenate([np.linspace(0.0, one.period, _DENSE), _events(one)[0]]))
        drawn.append((one.result.displacement(place, times), one.result.velocity(place, times)))
    scale = length(float(max(np.abs(u).max() for u, _ in drawn)))
    frequencies = [one.frequency_words() for one in orbits]
    same = len(set(frequencies)) == 1
    for k, (one, (u, v)) in enumerate(zip(orbits, drawn, strict=True)):
        color = color_of(k)
        style, width, name = LINES[one.stable]
        label = f"{frequencies[k]}, {name}" if not same else f"orbit {k + 1}, {name}" if len(orbits) > 1 else name
        axes.plot(u / scale[0], v / scale[0], style, color=color, linewidth=width, label=label)
        times, closing = _events(one)
        start = np.zeros(1)
        for part, mark, color, name in (
            (times[closing], "v", COLORS[4], "a contact closes"),
            (times[~closing], "^", COLORS[2], "a contact opens"),
            (start, "o", COLORS[1], "t = 0 of the loads"),
        ):
            if part.size:
                x, y = one.result.displacement(place, part), one.result.velocity(place, part)
                axes.plot(x / scale[0], y / scale[0], mark, color=color, markersize=7, linestyle="none", label=name)
    axes.set(xlabel=f"displacement [{scale[1]}]", ylabel=f"velocity [{scale[1]}/s]")
    title = f"{place.describe()}, {frequencies[0]}" if same else place.describe()
    axes.set_title(plain(title), fontsize=text_size(11))
    legend(axes, most=8)
    return canvas


def _events(orbit: PeriodicOrbit) -> tuple[Array, NDArray[np.bool_]]:
    """Return the times of contact events within an orbit, s, and which of them are closings."""
    from vofem.system import CLOSED

    events = orbit.result.solution.events
    return np.asarray(events.time, dtype=float), np.asarray(events.status == CLOSED)


@figure
def poincare_section(section: PoincareSection, point: Any, path: Where = None, *, ax: Any = None) -> Any:
    """Draw stroboscopic samples of a run: velocity over displacement of a point, once a period.

    Parameters
    ----------
    section : PoincareSection
        A section that `vofem.poincare` has returned.
    point : point of a body, or name of a mass

    Raises
    ------
    ArgumentError
        If an argument is not a section, or not a point.
    """
    place = as_point("poincare_section: point", point, section.result.scene.bodies)
    u, v = section.displacement(place), section.velocity(place)
    scale = length(float(np.abs(u).max()))
    canvas, axes = single("poincare_section", path, ax, (6.8, 5.4))
    axes.plot(u / scale[0], v / scale[0], ".", color=ink(), markersize=3.0 if len(section) > 200 else 6.0)
    axes.set(xlabel=f"displacement [{scale[1]}]", ylabel=f"velocity [{scale[1]}/s]")
    axes.set_title(
        plain(f"{place.describe()}: {len(section)} samples, one every {section.period:.6g} s"), fontsize=text_size(11)
    )
    return canvas


@figure
def backbone_curve(branch: Branch | Sequence[Branch], path: Where = None, *, ax: Any = None) -> Any:
    """Draw nonlinear normal modes: energy over frequency.

    Parameters
    ----------
    branch : Branch, or several of them
        A branch that `vofem.backbone` has returned.

    Raises
    ------
    ArgumentError
        If the branch is not a backbone.
    """
    branches = [branch] if isinstance(branch, Branch) else branch
    canvas, axes = single("backbone_curve", path, ax, (7.6, 5.2))
    for k, one in enumerate(branches):
        color = color_of(k)
        label = None if len(branches) == 1 else f"backbone {k + 1}"
        axes.plot(one.omega / (2.0 * np.pi), one.energy, color=color, linewidth=stroke(1.6), label=label)
    axes.set(xlabel="frequency [Hz]", ylabel="energy [J]", yscale="log")
    legend(axes)
    return canvas
