"""One frame of a series as a VTU file, written by meshio."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vofem.io.series.grid import Grid

_GRID = b"<UnstructuredGrid>\n"


def write_vtu(
    path: Path,
    grid: Grid,
    fields: Mapping[str, float],
    point_data: Mapping[str, NDArray],
    cell_data: Mapping[str, NDArray],
) -> int:
    """Write one file and return its size in bytes.

    Parameters
    ----------
    path : Path
    grid : Grid
        Its points, its cells and the arrays that do not change are written to every file.
    fields : mapping of str to float
        Numbers for the whole grid, such as ``TimeValue``.
    point_data, cell_data : mapping of str to ndarray
        One row per point or cell.
    """
    import meshio

    blocks = grid.cells.blocks
    ends = np.cumsum([len(points) for _, points in blocks])[:-1]
    # meshio writes names as they are, so that a name with & or < would damage the file.
    at_points = {escape(name): values for name, values in {**grid.point_data, **point_data}.items()}
    of_cells = {escape(name): np.split(values, ends) for name, values in {**grid.cell_data, **cell_data}.items()}
    meshio.vtu.write(path, meshio.Mesh(grid.points, list(blocks), point_data=at_points, cell_data=of_cells))
    numbers = "".join(
        f'<DataArray type="Float64" Name="{escape(name)}" NumberOfTuples="1" format="ascii">{value!r}</DataArray>\n'
        for name, value in fields.items()
    )
    # meshio leaves field data out of VTU files, and ParaView shows the time from there.
    whole = f"<FieldData>\n{numbers}</FieldData>\n".encode()
    return path.write_bytes(path.read_bytes().replace(_GRID, _GRID + whole, 1))
