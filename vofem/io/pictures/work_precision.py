"""Work-precision diagrams: error against wall time and against steps, both logarithmic."""

from __future__ import annotations

from itertools import groupby
from typing import Any

import numpy as np

from vofem.integrators.registry import method_named
from vofem.io.pictures.axes import COLORS, Canvas, Where, beside, figure, ink, plain, stroke, text_size
from vofem.studies.accuracy import Study

_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")


@figure
def work_precision(study: Study, path: Where = None, title: str = "", *, ax: Any = None) -> Any:
    """Draw the error of all runs of a study against their time and their steps.

    Each method has a colour and each mesh has a marker. A dashed line is the error of a mesh alone: smaller steps do
    not reduce the error below it. The grey band is the error of the reference: differences of errors within it have no
    meaning.

    Parameters
    ----------
    study : Study
    title : str
    ax : two matplotlib axes, optional
        The axes to draw into. By default a new figure is made.
    """
    canvas = Canvas("work_precision", path, ax, (11.0, 5.2), 1, 2, sharey=True)
    figure, grid = canvas.figure, canvas.grid
    meshes = sorted({run.setting.elements for run in study.runs})
    methods = list(dict.fromkeys(run.setting.method for run in study.runs))
    colors = {name: ink() if method_named(name).exact else COLORS[k % len(COLORS)] for k, name in enumerate(methods)}
    marks = {n: _MARKERS[k % len(_MARKERS)] for k, n in enumerate(meshes)}
    # An error of zero is drawn at the level of rounding, because its logarithm is minus infinity.
    lowest = max(study.floor, 1e-16)
    for axes, what in zip(grid[0], ("seconds", "steps"), strict=True):
        series = groupby(
            study.runs, key=lambda run: (run.setting.method, run.setting.elements, run.setting.tol is None)
        )
        for (method, n, _), runs in series:
            part = list(runs)
            x = [getattr(run, what) for run in part]
            y = [max(study.relative(run), 0.5 * lowest) for run in part]
            line = "-" if part[0].setting.tol is None else ":"
            axes.plot(x, y, line, marker=marks[n], color=colors[method], markersize=6, linewidth=stroke(1.3), alpha=0.9)
        _limits(axes, study, meshes)
        axes.set(xscale="log", yscale="log")
    grid[0, 0].set(xlabel="wall time [s]", ylabel="largest error / largest displacement [-]")
    grid[0, 1].set(xlabel="steps, or segments between events [-]")
    _legend(grid[0, 1], study, colors, marks)
    if title:
        figure.suptitle(plain(title), fontsize=text_size(11))
    return canvas


def _limits(axes: Any, study: Study, meshes: list[int]) -> None:
    """Draw the errors of the meshes as lines and the reference's own as a band."""
    scale = study.reference.scale or 1.0
    space = {run.setting.elements: run.space / scale for run in study.runs}
    for n in meshes:
        if space[n] > 0.0:
            axes.axhline(space[n], color="#9aa0aa", linewidth=stroke(1.0), linestyle="--", zorder=1)
    floor = max(study.floor, 1e-16)
    values = [study.relative(run) for run in study.runs] + list(space.values())
    bottom = 0.3 * min([floor, *(value for value in values if value > 0.0)])
    axes.axhspan(bottom, floor, color="#eceef1", zorder=0)
    axes.set_ylim(bottom, 3.0 * max([floor, *values]))


def _legend(axes: Any, study: Study, colors: dict[str, str], marks: dict[int, str]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    scale = study.reference.scale or 1.0
    handles: list[Any] = [Line2D([], [], color=color, label=name) for name, color in colors.items()]
    if any(run.setting.tol is not None for run in study.runs):
        handles.append(Line2D([], [], color=ink(), linestyle=":", label="by tolerance"))
    for n, mark in marks.items():
        if n:
            space = next(run.space for run in study.runs if run.setting.elements == n) / scale
            known = f"{space:.0e}" if np.isfinite(space) else "unknown"
            label = f"{n} elements (mesh error {known})"
            handles.append(Line2D([], [], color="#9aa0aa", linestyle="--", marker=mark, label=label))
    handles.append(Patch(color="#eceef1", label=f"reference known to {study.floor:.0e}"))
    beside(axes, handles, [handle.get_label() for handle in handles])
