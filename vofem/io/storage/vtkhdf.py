"""The group ``VTKHDF`` of a saved run: the fields as ParaView reads them.

A temporal UnstructuredGrid of VTKHDF 2.0 (https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/): points
and cells at rest are written once, every step refers to them, and each field is one long dataset into which the steps
point.
"""

from __future__ import annotations

import h5py
import numpy as np

from vofem.arrays import Array
from vofem.files.hdf5 import FILTERS, Blocks, empty_dataset
from vofem.io.frames import Frames
from vofem.result import Result

#: Number of frames that are written by default. Fields on the grid take several times as much space as the history.
_MOST_FRAMES = 1000


def frame_times(times: Array, most: int = _MOST_FRAMES) -> Array:
    """Return which of the times become frames: all, or `most` of them spread evenly, the last among them."""
    distinct = np.unique(times)
    if distinct.size <= most:
        return distinct
    return distinct[np.round(np.linspace(0, distinct.size - 1, most)).astype(int)]


def write_fields(blocks: Blocks, group: h5py.Group, result: Result, times: Array, magnification: float = 1.0) -> None:
    """Write points, cells and fields of `vofem.Result.frame` at some times.

    `group`: the empty group ``VTKHDF``.
    `times` (shape (n_frames,)): times of the frames, s, increasing.
    `magnification`: by which gaps are drawn larger.
    """
    grid = Frames(result, magnification)
    # VTK wants a string of fixed length in ASCII.
    group.attrs.create("Type", b"UnstructuredGrid", dtype="S16")
    group.attrs["Version"] = np.array([2, 0], dtype=np.int64)
    group.attrs["magnification"] = magnification
    _geometry(group, grid)
    steps = group.create_group("Steps")
    steps.attrs["NSteps"] = np.int64(times.size)
    steps["Values"] = times
    zero = np.zeros(times.size, dtype=np.int64)
    steps["NumberOfParts"] = zero + 1
    steps["PartOffsets"] = zero
    steps["PointOffsets"] = zero
    steps["CellOffsets"] = zero[:, None]
    steps["ConnectivityIdOffsets"] = zero[:, None]
    _fields(blocks, group, grid, times)


def _geometry(group: h5py.Group, grid: Frames) -> None:
    for name, count in (
        ("NumberOfPoints", grid.points.shape[0]),
        ("NumberOfCells", grid.types.size),
        ("NumberOfConnectivityIds", grid.connectivity.size),
    ):
        group[name] = np.array([count], dtype=np.int64)
    for name, values in (
        ("Points", grid.points),
        ("Connectivity", grid.connectivity),
        ("Offsets", grid.offsets.astype(np.int64)),
        ("Types", grid.types),
    ):
        group.create_dataset(name, data=values, **FILTERS)


def _fields(blocks: Blocks, group: h5py.Group, grid: Frames, times: Array) -> None:
    kinds = ("PointData", "CellData")
    places = {kind: (group.create_group(kind), group.create_group(f"Steps/{kind}Offsets")) for kind in kinds}
    for kind, constant in zip(kinds, (grid.point_data, grid.cell_data), strict=True):
        data, offsets = places[kind]
        for name, values in constant.items():
            data.create_dataset(name, data=values, **FILTERS)
            offsets[name] = np.zeros(times.size, dtype=np.int64)
    for part, *changing in grid.blocks(times):
        for kind, fields in zip(kinds, changing, strict=True):
            data, offsets = places[kind]
            for name, values in fields.items():
                count = values.shape[1]
                if name not in data:
                    empty_dataset(data, name, (times.size * count, *values.shape[2:]), values.dtype)
                    offsets[name] = np.arange(times.size, dtype=np.int64) * count
                data[name][part.start * count : part.stop * count] = values.reshape(-1, *values.shape[2:])
        blocks.flush()
