"""Cards: runs, orbits, branches, scenes and explanations as a notebook shows them, as a table, a figure and notes."""

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

#: Contacts, special points, bodies or effects that are listed; rows of a table; orbits whose amplitude is drawn.
_CONTACTS, _SPECIAL, _LINES, _ROWS, _ORBITS = 6, 10, 12, 30, 40

#: Width and height of a figure with axes, inches, its dots per inch, and of a side view, pixels.
_FIGURE, _DPI, _SIDE = (6.6, 3.0), 64, (520, 240)

Rows = list[tuple[str, str]]
#: Makes the figure of a card.
Draw = Callable[[], Any]


def card_of(thing: Any) -> str:
    """Return the card of a Result, PeriodicOrbit, Branch, Locus, Scene, Explanation or Table as HTML."""
    for kind, parts in _CARDS:
        if isinstance(thing, kind):
            return _html(*parts(thing))
    return f"<pre>{escape(repr(thing))}</pre>"


# -- what is on each card -----------------------------------------------------------------------------


def _result(result: Result) -> tuple[Table, Draw]:
    counters = result.counters
    rows = [
        ("method", result.method),
        ("times", f"{result.times.size}, to {result.times[-1]:g} s"),
        ("steps", f"{counters.steps}"),
        ("contact events", f"{counters.events}"),
    ]
    for index, name in enumerate(list(result.contacts)[:_CONTACTS]):
        span = spans_of(result, index)
        share = float(np.sum(span.end - span.begin)) / result.solution.t_end
        rows.append((f"contact {name}", f"{span.begin.size} impacts, closed {100.0 * share:.3g} % of the time"))
    rows += _more(len(result.contacts) - _CONTACTS, "contacts")

    def draw(axes: Any) -> None:
        from vofem.io.pictures.histories import time_history

        time_history(result, points_of_interest(result.scene)[0], ax=axes)

    return _table("Result", rows, result.notes), _on_axes(draw)


def _orbit(orbit: PeriodicOrbit) -> tuple[Table, Draw]:
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

    def draw(axes: Any) -> None:
        from vofem.io.pictures.steady import phase_portrait

        phase_portrait(orbit, point, ax=axes)
        axes.get_legend().remove()

    return _table("PeriodicOrbit", rows, orbit.notes), _on_axes(draw)


def _branch(branch: Branch) -> tuple[Table, Draw | None]:
    stable = branch.stable.tolist()
    rows = [
        ("orbits", f"{len(branch)}, of which {sum(one is True for one in stable)} are stable"),
        ("parameter", f"{branch.values[0]:.6g} to {branch.values[-1]:.6g}" if len(branch) else "-"),
        *((one.kind.replace("_", " "), f"{one.value:.9g}") for one in branch.special[:_SPECIAL]),
        *_more(len(branch.special) - _SPECIAL, "special points"),
    ]

    def draw(axes: Any) -> None:
        some = np.unique(np.linspace(0, len(branch) - 1, _ORBITS).round().astype(int))
        point = points_of_interest(branch.orbits[0].scene)[0]
        heights = [branch.orbits[int(k)].amplitude(point) for k in some]
        axes.plot(branch.values[some], heights, ".-", color="#16181d", markersize=3, linewidth=1.0)
        axes.set(xlabel="parameter", ylabel="amplitude [m]")
        axes.set_title(point.describe(), fontsize=8)

    return _table("Branch", rows, branch.notes), _on_axes(draw) if len(branch) else None


def _locus(locus: Locus) -> tuple[Table, Draw]:
    low, high = locus.values.min(axis=0), locus.values.max(axis=0)
    rows = [
        ("kind", locus.kind.replace("_", " ")),
        ("value", f"{low[0]:.6g} to {high[0]:.6g}"),
        ("other", f"{low[1]:.6g} to {high[1]:.6g}"),
        *((one.kind.replace("_", " "), f"{one.value:.9g}, {one.other:.9g}") for one in locus.special[:_SPECIAL]),
        *_more(len(locus.special) - _SPECIAL, "special points"),
    ]

    def draw(axes: Any) -> None:
        from vofem.io.pictures.steady import locus as drawn

        drawn(locus, parameter="value", other="other", ax=axes)

    return _table("Locus", rows, locus.notes), _on_axes(draw)


def _scene(scene: Scene) -> tuple[Table, Draw]:
    rows = [("body", body.summary()) for body in scene.bodies[:_LINES]] + _more(len(scene.bodies) - _LINES, "bodies")
    rows += [("effect", effect.describe()) for effect in scene.effects[:_LINES]]
    rows += _more(len(scene.effects) - _LINES, "effects")

    def draw() -> Any:
        from vofem.io.pictures.sketch import sketch
        from vofem.io.pictures.snapshot import at_rest

        return sketch(at_rest(scene), _SIDE, None).figure()

    return _table("Scene", rows), draw


def _explanation(found: Explanation) -> tuple[Table, None]:
    rows = [("body", line) for line in found.bodies] + [("effect", line) for line in found.effects]
    rows += [("start", line) for line in found.start or ("at rest",)]
    rows += [
        ("unknowns", f"{found.unknowns}"),
        ("method", f"{found.method}, because {found.why}"),
        ("not in the scene", ", ".join(found.absent) or "nothing"),
    ]
    return _table("What will be simulated", rows), None


_CARDS: tuple[tuple[type, Callable[[Any], tuple[Table, Draw | None]]], ...] = (
    (Result, _result),
    (PeriodicOrbit, _orbit),
    (Branch, _branch),
    (Locus, _locus),
    (Scene, _scene),
    (Explanation, _explanation),
    (Table, lambda table: (table, None)),
)


def _more(count: int, what: str) -> Rows:
    return [("", f"and {count} more {what}")] if count > 0 else []


def _table(title: str, rows: Rows, notes: Iterable[str] = ()) -> Table:
    """Return a table without headings of names and values."""
    names, values = zip(*rows, strict=True)
    return Table({"": (names, ""), " ": (values, "")}, title, tuple(notes))


def _on_axes(draw: Callable[[Any], None]) -> Draw:
    """Return what draws into the axes of a small figure, and returns the figure."""

    def made() -> Any:
        from matplotlib.figure import Figure

        figure = Figure(figsize=_FIGURE, dpi=_DPI, layout="constrained")
        draw(figure.subplots())
        return figure

    return made


# -- HTML ---------------------------------------------------------------------------------------------


def _html(table: Table, draw: Draw | None) -> str:
    """Return a card: a title, a table beside a figure, and notes under them."""
    head, *lines = table.text(_ROWS)
    cell = '<td style="text-align:left;padding:1px 12px 1px 0">'
    rows = "".join("<tr>" + "".join(f"{cell}{escape(value)}</td>" for value in line) + "</tr>" for line in lines)
    if any(name.strip() for name in head):
        rows = "<tr>" + "".join(f"<th>{escape(name)}</th>" for name in head) + f"</tr>{rows}"
    more = [f"and {table.rows - len(lines)} more rows"] * (table.rows > len(lines))
    notes = "".join(f"<li>{escape(note)}</li>" for note in (*more, *table.notes))
    return (
        '<div style="border:1px solid #c4c7cd;border-radius:6px;padding:8px 12px;max-width:980px">'
        f'<div style="font-weight:bold;margin-bottom:4px">{escape(table.title)}</div>'
        '<div style="display:flex;flex-wrap:wrap;gap:16px;align-items:flex-start">'
        f'<table style="border:none;font-size:90%">{rows}</table>{_image(draw)}</div>'
        + (f'<ul style="font-size:85%;margin:6px 0 0">{notes}</ul>' if notes else "")
        + "</div>"
    )


def _image(draw: Draw | None) -> str:
    """Return a figure; where it cannot be drawn, the reason: a card must not fail for its figure."""
    if draw is None:
        return ""
    file = io.BytesIO()
    try:
        draw().savefig(file, format="png", dpi="figure")
    except VofemError as error:
        return f'<div style="color:#6b7280;font-size:85%;max-width:420px">no figure: {escape(str(error))}</div>'
    return f'<img alt="" src="data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}">'
