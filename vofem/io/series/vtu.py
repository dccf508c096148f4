"""VTU files, the unstructured grids of VTK: many of one topology, written fast.

A file is a short XML header and one block of raw bytes that holds the arrays,
each compressed. Arrays that do not change along a series are compressed once.
"""

from __future__ import annotations

import struct
import sys
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Bytes that are compressed together.
_BLOCK = 1 << 18

#: Of fields in motion higher levels save less than 1 % and take up to half as long again.
_LEVEL = 1

_TYPES = {"f8": "Float64", "i8": "Int64", "i4": "Int32", "u1": "UInt8"}

#: Cell types of VTK.
VERTEX, LINE = 1, 3


@dataclass(frozen=True)
class Cells:
    """Cells of an unstructured grid.

    Attributes
    ----------
    connectivity : ndarray of int
        The points of all cells, one cell after another.
    offsets : ndarray of int, shape (n_cells,)
        Where each cell ends in `connectivity`.
    types : ndarray of uint8, shape (n_cells,)
    """

    connectivity: NDArray[np.int64]
    offsets: NDArray[np.int64]
    types: NDArray[np.uint8]


@dataclass(frozen=True)
class _Section:
    """A DataArray: its tag but for the place of its bytes, and these."""

    tag: str
    data: bytes


class VtuTemplate:
    """What the files of a series share.

    Parameters
    ----------
    points : ndarray, shape (n_points, 3)
        In m.
    cells : Cells
    point_data, cell_data : dict of str to ndarray
        Arrays that do not change.
    """

    def __init__(
        self, points: Array, cells: Cells, point_data: Mapping[str, NDArray], cell_data: Mapping[str, NDArray]
    ) -> None:
        self._counts = points.shape[0], cells.types.size
        self._points = [_section("Points", points)]
        self._cells = [
            _section("connectivity", cells.connectivity),
            _section("offsets", cells.offsets),
            _section("types", cells.types),
        ]
        self._point_data = [_section(name, values) for name, values in point_data.items()]
        self._cell_data = [_section(name, values) for name, values in cell_data.items()]

    def encode(
        self, fields: Mapping[str, float], point_data: Mapping[str, NDArray], cell_data: Mapping[str, NDArray]
    ) -> bytes:
        """Return the bytes of one file.

        Parameters
        ----------
        fields : dict of str to float
            Numbers for the whole grid, such as ``TimeValue``.
        point_data, cell_data : dict of str to ndarray
            One row per point or cell, beside the arrays that do not change.
        """
        data: list[bytes] = []
        position = 0

        def arrays(sections: list[_Section]) -> str:
            nonlocal position
            lines = []
            for section in sections:
                lines.append(f'{section.tag} format="appended" offset="{position}"/>\n')
                data.append(section.data)
                position += len(section.data)
            return "".join(lines)

        changing = [[_section(name, values) for name, values in group.items()] for group in (point_data, cell_data)]
        order = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
        numbers = "".join(
            f'<DataArray type="Float64" Name="{escape(name)}" NumberOfTuples="1" format="ascii">{value!r}</DataArray>\n'
            for name, value in fields.items()
        )
        header = (
            '<?xml version="1.0"?>\n'
            f'<VTKFile type="UnstructuredGrid" version="1.0" byte_order="{order}" header_type="UInt64" '
            'compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n'
            f"<FieldData>\n{numbers}</FieldData>\n"
            f'<Piece NumberOfPoints="{self._counts[0]}" NumberOfCells="{self._counts[1]}">\n'
            f"<Points>\n{arrays(self._points)}</Points>\n"
            f"<Cells>\n{arrays(self._cells)}</Cells>\n"
            f"<PointData>\n{arrays(self._point_data + changing[0])}</PointData>\n"
            f"<CellData>\n{arrays(self._cell_data + changing[1])}</CellData>\n"
            '</Piece>\n</UnstructuredGrid>\n<AppendedData encoding="raw">\n_'
        )
        return b"".join([header.encode(), *data, b"\n</AppendedData>\n</VTKFile>\n"])


def _section(name: str, values: NDArray) -> _Section:
    components = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    kind = _TYPES[f"{values.dtype.kind}{values.dtype.itemsize}"]
    return _Section(f'<DataArray type="{kind}" Name="{escape(name)}"{components}', _compress(values))


def _compress(values: NDArray) -> bytes:
    """Return number, size and last size of the blocks, their compressed sizes, and the blocks."""
    raw = values.tobytes()
    blocks = [zlib.compress(raw[k : k + _BLOCK], _LEVEL) for k in range(0, len(raw), _BLOCK)]
    last = len(raw) - (len(blocks) - 1) * _BLOCK if blocks else 0
    header = struct.pack(f"={3 + len(blocks)}Q", len(blocks), _BLOCK, last, *map(len, blocks))
    return b"".join([header, *blocks])
