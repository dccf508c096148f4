"""Maps of the steady states over two parameters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vofem._validate import choice
from vofem.io.pictures.axes import Canvas, Where, figure, ink, plain, text_size
from vofem.studies.diagrams import StabilityMap

_LABELS = {"amplitude": "amplitude [m]", "multiplier": "modulus of the leading multiplier [1]"}


@figure
def state_map(
    found: StabilityMap,
    path: Where = None,
    *,
    quantity: str = "amplitude",
    labels: tuple[str, str] = ("x", "y"),
    ax: Any = None,
) -> Any:
    """Draw a quantity of the steady states over two parameters; where they are unstable, the map is hatched.

    Parameters
    ----------
    found : StabilityMap
    quantity : {"amplitude", "multiplier"}
        The amplitude in m, or the modulus of the leading multiplier.
    labels : tuple of str
        Labels of the axes: names and units of the two parameters.

    Raises
    ------
    ArgumentError
        If the quantity is another one.
    """
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Patch

    choice("state_map: quantity", quantity, tuple(_LABELS))
    values = found.amplitude if quantity == "amplitude" else np.abs(found.multiplier)
    canvas = Canvas("state_map", path, ax, (7.8, 5.2))
    axes = canvas.grid[0, 0]
    axes.grid(False)
    # Grey shows where no orbit was found.
    axes.set_facecolor("#d7dade")
    mesh = axes.pcolormesh(found.x, found.y, values.T, shading="nearest", cmap="viridis", rasterized=True)
    canvas.figure.colorbar(mesh, ax=axes, label=_LABELS[quantity])
    cells = _cells(found.x, found.y, found.stable == 0.0)
    handles = []
    if cells:
        axes.add_collection(PatchCollection(cells, facecolor="none", edgecolor=ink(), linewidth=0.0, hatch="////"))
        handles.append(Patch(facecolor="white", edgecolor=ink(), hatch="////", label="unstable"))
    if found.failed:
        handles.append(Patch(color="#d7dade", label="no such orbit found"))
    axes.set(xlabel=plain(labels[0]), ylabel=plain(labels[1]))
    if handles:
        axes.legend(handles=handles, loc="upper right", fontsize=text_size(9.0))
    return canvas


def _cells(x: NDArray[np.float64], y: NDArray[np.float64], chosen: NDArray[np.bool_]) -> list[Any]:
    """Return the chosen cells of a map as rectangles whose sides are halfway to the neighbours."""
    from matplotlib.patches import Rectangle

    left, bottom = _sides(x), _sides(y)
    return [
        Rectangle((left[i], bottom[j]), left[i + 1] - left[i], bottom[j + 1] - bottom[j])
        for i, j in np.argwhere(chosen).tolist()
    ]


def _sides(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the sides of cells about values, shape (n + 1,)."""
    if values.size == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2.0 * values[0] - middle[0]], middle, [2.0 * values[-1] - middle[-1]]])
