"""A picture of a fit: measurements, model and residuals."""

from __future__ import annotations

from typing import Any

from vofem._validate import wrong
from vofem.fitting import Fit
from vofem.io.pictures.axes import COLORS, Canvas, Where, figure, ink, plain, stroke, text_size


@figure
def fit(result: Fit, path: Where = None, *, ax: Any = None) -> Any:
    """Draw measurements with the model that was fitted to them, and below the residuals.

    Parameters
    ----------
    result : Fit
    ax : matplotlib axes, optional
        The axes to draw into, in the order of rows: those of all measurements, then those of their residuals. By
        default a new figure is made.
    """
    if not isinstance(result, Fit):
        raise wrong("fit: result", repr(result), "what vf.fit returns")
    count = len(result.data)
    canvas = Canvas("fit", path, ax, (6.0 + 2.0 * count, 5.6), rows=2, columns=count)
    row, shift = 0, 0
    for k, one in enumerate(result.data):
        used = one.used(result.until)
        size = int(used.sum())
        residuals = result.residuals[row : row + size]
        row += size
        x = one.places[used]
        constant = 0.0
        if one.offset:
            constant, shift = float(result.offsets[shift]), shift + 1
        values = one.values[used] - constant
        upper, lower = canvas.grid[0, k], canvas.grid[1, k]
        marker = "o" if size < 60 else "."
        upper.plot(x, values, marker, color=COLORS[0], markersize=4.0, label="measured")
        upper.plot(x, values + residuals, color=ink(), linewidth=stroke(1.0), label="fitted")
        upper.set_title(plain(one.describe()), fontsize=text_size(10))
        upper.legend()
        lower.axhline(0.0, color=ink(), linewidth=stroke(0.6))
        lower.plot(x, residuals, marker, color=COLORS[1], markersize=4.0)
        lower.set(xlabel=one.along, ylabel=f"residual [{one.unit}]")
        upper.set(xlabel=one.along, ylabel=f"value [{one.unit}]")
    return canvas
