"""Cards: runs, orbits, branches, scenes and explanations as a notebook shows them, in numbers, a figure and notes."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterable
from html import escape
from typing import Any

import numpy as np

from vofem.errors import VofemError
from vofem.histories import Table
from vofem.histories.tables import points_of_interest
from vofem.histories.touches import spans_of
from vofem.result import Result
from vofem.scene import Scene
from vofem.simulate.explanation import Explanation
from vofem.studies.steady import Branch, Locus, PeriodicOrbit

#: Contacts, special points and lines that are listed; orbits whose amplitude is drawn.
_CONTACTS, _SPECIAL, _LINES, _ORBITS = 6, 10, 12, 40

#: Width and height of a figure with axes, inches, its dots per inch, and of a side view, pixels.
_FIGURE, _DPI, _SIDE = (6.6, 3.0), 64, (520, 240)

Rows = Iterable[tuple[str, str]]


def card_of(thing: Any) -> str:
    """Return the card of a Result, PeriodicOrbit, Branch, Locus, Scene, Explanation or Table as HTML."""
    for kind, make in _CARDS:
        if isinstance(thing, kind):
            return make(thing)
    return f"<pre>{escape(repr(thing))}</pre>"


# -- one card each ------------------------------------------------------------------------------------


def _result(result: Result) -> str:
    counters = result.counters
    rows = [
        ("method", result.method),
        ("times", f"{result.times.size}, to {result.times[-1]:g} s"),
        ("steps", f"{counters.steps}"),
        ("contact events", f"{counters.events}"),
    ]
    names = list(result.contacts)
    for index, name in enumerate(names[:_CONTACTS]):
        span = spans_of(result, index)
        share = float(np.sum(span.end - span.begin)) / result.solution.t_end
        rows.append((f"contact {name}", f"{span.begin.size} impacts, closed {100.0 * share:.3g} % of the time"))
    if len(names) > _CONTACTS:
        rows.append(("", f"and {len(names) - _CONTACTS} more contacts"))

    def figure(axes: Any) -> None:
        from vofem.io.pictures.histories import time_history

        time_history(result, points_of_interest(result.scene)[0], ax=axes)

    return _card("Result", rows, _axes(figure), result.notes)


def _orbit(orbit: PeriodicOrbit) -> str:
    point = points_of_interest(orbit.scene)[0]
    rows = [
        ("method", orbit.method),
        ("frequency of the loads", f"{orbit.omega:.6g} rad/s, {orbit.omega / (2.0 * np.pi):.6g} Hz"),
        ("period of the orbit", f"{orbit.period:.6g} s" + (f", {orbit.periods} of the loads" * (orbit.periods > 1))),
        ("stability", orbit.stability),
        (f"amplitude, {point.describe()}", f"{orbit.amplitude(point):.5g} m"),
        ("residual", f"{orbit.residual:.1e}"),
    ]
    if orbit.multipliers is not None and orbit.multipliers.size:
        rows.insert(4, ("largest multiplier", f"{orbit.multipliers[0]:.6g}, modulus {abs(orbit.multipliers[0]):.6g}"))

    def figure(axes: Any) -> None:
        from vofem.io.pictures.steady import phase_portrait

        phase_portrait(orbit, point, ax=axes)
        axes.get_legend().remove()

    return _card("PeriodicOrbit", rows, _axes(figure), orbit.notes)


def _branch(branch: Branch) -> str:
    stable = branch.stable.tolist()
    rows = [
        ("orbits", f"{len(branch)}, of which {sum(one is True for one in stable)} are stable"),
        ("parameter", f"{branch.values[0]:.6g} to {branch.values[-1]:.6g}") if len(branch) else ("parameter", "-"),
    ]
    rows += [(one.kind.replace("_", " "), f"{one.value:.9g}") for one in branch.special[:_SPECIAL]]
    if len(branch.special) > _SPECIAL:
        rows.append(("", f"and {len(branch.special) - _SPECIAL} more special points"))

    def figure(axes: Any) -> None:
        some = np.unique(np.linspace(0, len(branch) - 1, _ORBITS).round().astype(int))
        point = points_of_interest(branch.orbits[0].scene)[0]
        heights = [branch.orbits[int(k)].amplitude(point) for k in some]
        axes.plot(branch.values[some], heights, ".-", color="#16181d", markersize=3, linewidth=1.0)
        axes.set(xlabel="parameter", ylabel="amplitude [m]")
        axes.set_title(point.describe(), fontsize=8)

    return _card("Branch", rows, _axes(figure) if len(branch) else "", branch.notes)


def _locus(locus: Locus) -> str:
    low, high = locus.values.min(axis=0), locus.values.max(axis=0)
    rows = [
        ("kind", locus.kind.replace("_", " ")),
        ("value", f"{low[0]:.6g} to {high[0]:.6g}"),
        ("other", f"{low[1]:.6g} to {high[1]:.6g}"),
    ]
    rows += [(one.kind.replace("_", " "), f"{one.value:.9g}, {one.other:.9g}") for one in locus.special[:_SPECIAL]]

    def figure(axes: Any) -> None:
        axes.plot(*locus.values.T, color="#16181d", linewidth=1.0)
        axes.set(xlabel="value", ylabel="other")

    return _card("Locus", rows, _axes(figure), locus.notes)


def _scene(scene: Scene) -> str:
    rows = [("body", body.summary()) for body in scene.bodies[:_LINES]]
    if len(scene.bodies) > _LINES:
        rows.append(("", f"and {len(scene.bodies) - _LINES} more bodies"))
    rows += [("effect", effect.describe()) for effect in scene.effects[:_LINES]]
    if len(scene.effects) > _LINES:
        rows.append(("", f"and {len(scene.effects) - _LINES} more effects"))

    def side() -> str:
        from vofem.io.pictures.sketch import sketch
        from vofem.io.pictures.snapshot import at_rest

        return _picture(sketch(at_rest(scene), _SIDE, None).figure())

    return _card("Scene", rows, _drawn(side), [])


def _explanation(found: Explanation) -> str:
    rows = [("body", line) for line in found.bodies] + [("effect", line) for line in found.effects]
    rows += [
        ("unknowns", f"{found.unknowns}"),
        ("method", f"{found.method}, because {found.why}"),
        ("not simulated", ", ".join(found.absent) or "nothing is left out"),
    ]
    return _card("What will be simulated", rows, "", [])


def _table(table: Table) -> str:
    head, *lines = table.text()
    cells = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(value)}</td>" for value in line) + "</tr>" for line in lines)
    more = f"<p>and {table.rows - len(lines)} more rows</p>" if table.rows > len(lines) else ""
    return (
        f"<div><b>{escape(table.title)}</b><table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table>{more}"
        f"{_listed(table.notes)}</div>"
    )


_CARDS: tuple[tuple[type, Callable[[Any], str]], ...] = (
    (Result, _result),
    (PeriodicOrbit, _orbit),
    (Branch, _branch),
    (Locus, _locus),
    (Scene, _scene),
    (Explanation, _explanation),
    (Table, _table),
)


# -- HTML ---------------------------------------------------------------------------------------------


def _card(title: str, rows: Rows, figure: str, notes: Iterable[str]) -> str:
    """Return a card: a title, numbers beside a figure, and notes under them."""
    lines = "".join(
        f'<tr><td style="text-align:left;color:#6b7280;padding:1px 12px 1px 0">{escape(name)}</td>'
        f'<td style="text-align:left;padding:1px 0">{escape(value)}</td></tr>'
        for name, value in rows
    )
    return (
        '<div style="border:1px solid #c4c7cd;border-radius:6px;padding:8px 12px;max-width:980px">'
        f'<div style="font-weight:bold;margin-bottom:4px">{escape(title)}</div>'
        '<div style="display:flex;flex-wrap:wrap;gap:16px;align-items:flex-start">'
        f'<table style="border:none;font-size:90%">{lines}</table>{figure}</div>{_listed(notes)}</div>'
    )


def _listed(notes: Iterable[str]) -> str:
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f'<ul style="font-size:85%;margin:6px 0 0">{items}</ul>' if items else ""


def _axes(draw: Callable[[Any], None]) -> str:
    """Return a small figure with axes as an image."""

    def made() -> str:
        from matplotlib.figure import Figure

        figure = Figure(figsize=_FIGURE, dpi=_DPI, layout="constrained")
        draw(figure.subplots())
        return _picture(figure)

    return _drawn(made)


def _drawn(make: Callable[[], str]) -> str:
    """Return a figure; where it cannot be drawn, the reason: a card must not fail for its figure."""
    try:
        return make()
    except VofemError as error:
        return f'<div style="color:#6b7280;font-size:85%;max-width:420px">no figure: {escape(str(error))}</div>'


def _picture(figure: Any) -> str:
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi="figure")
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}">'
