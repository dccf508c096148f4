"""The frames of a run as meshes of pyvista: of a Result, of a saved run, or of a series of VTU files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import number
from vofem.errors import ArgumentError, StorageError
from vofem.io.series.grid import Grid
from vofem.io.series.placement import place
from vofem.result import Result

Array = NDArray[np.float64]

_POINTS_PER_ELEMENT = 5


class Meshes(Sequence[Any]):
    """Frames as `pyvista.UnstructuredGrid`, each made when it is asked for.

    Their points have moved by `magnification` times ``deflection``. Points, cells and fields are those of
    `vofem.io.vtk.write_series`.

    Attributes
    ----------
    times : ndarray, shape (n_frames,)
        Times of the frames, s.
    magnification : float
    """

    times: Array
    magnification: float

    def _mesh(self, k: int) -> Any:
        """Return a frame at rest."""
        raise NotImplementedError

    def __len__(self) -> int:
        return int(self.times.size)

    @overload
    def __getitem__(self, index: int) -> Any: ...

    @overload
    def __getitem__(self, index: slice) -> list[Any]: ...

    def __getitem__(self, index: int | slice) -> Any:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        mesh = self._mesh(range(len(self))[index])
        mesh.points = np.asarray(mesh.points, dtype=float) + self.magnification * mesh.point_data["deflection"]
        return mesh

    def __repr__(self) -> str:
        return f"Meshes({len(self)} frames to {self.times[-1]:g} s, moved by {self.magnification:g} times deflection)"


class _OfResult(Meshes):
    def __init__(self, result: Result, times: ArrayLike | None, magnification: float) -> None:
        self.times = result.times if times is None else np.atleast_1d(np.asarray(times, dtype=float))
        self.magnification = magnification
        self._grid = Grid(result, place(result.scene, magnification), _POINTS_PER_ELEMENT)

    def _mesh(self, k: int) -> Any:
        import pyvista

        cells = self._grid.cells
        ends = np.concatenate([[0], cells.offsets])
        counted = np.insert(cells.connectivity, ends[:-1], np.diff(ends))
        mesh = pyvista.UnstructuredGrid(counted, cells.types, self._grid.points.copy())
        fields = self._grid.frames(self.times[[k]])
        for name, values in self._grid.point_data.items():
            mesh.point_data[name] = values
        for name, values in self._grid.cell_data.items():
            mesh.cell_data[name] = values
        for name, values in fields.point_data.items():
            mesh.point_data[name] = values[0]
        for name, changing in fields.cell_data.items():
            mesh.cell_data[name] = changing[0]
        return mesh


class _OfSavedRun(Meshes):
    def __init__(self, path: Path, magnification: float | None) -> None:
        import pyvista

        from vofem.files.hdf5 import reading

        with reading(path) as file:
            if "VTKHDF/Steps" not in file:
                raise StorageError(f"{path} holds no frames, expected a run that Result.save has written")
            self.times = np.array(file["VTKHDF/Steps/Values"], dtype=float)
            own = float(file["VTKHDF"].attrs.get("magnification", 1.0))
        self.magnification = own if magnification is None else magnification
        self._reader = pyvista.get_reader(str(path), force_ext=".vtkhdf").reader

    def _mesh(self, k: int) -> Any:
        import pyvista

        self._reader.SetStep(k)
        self._reader.Update()
        return pyvista.wrap(self._reader.GetOutput()).copy()


class _OfSeries(Meshes):
    def __init__(self, path: Path, magnification: float | None) -> None:
        import pyvista

        self._reader = pyvista.get_reader(str(path))
        self.times = np.array(self._reader.time_values, dtype=float)
        own = float(self._read(0).field_data["magnification"][0])
        self.magnification = own if magnification is None else magnification

    def _read(self, k: int) -> Any:
        self._reader.set_active_time_point(k)
        return self._reader.read()[0]

    def _mesh(self, k: int) -> Any:
        return self._read(k)


def meshes(
    source: Result | str | os.PathLike[str], times: ArrayLike | None = None, *, magnification: float | None = None
) -> Meshes:
    """Return the frames of a run as meshes; see `vofem.io.vtk.frames`."""
    if magnification is not None:
        magnification = number("frames: magnification", magnification, positive=True)
    if isinstance(source, Result):
        return _OfResult(source, times, 1.0 if magnification is None else magnification)
    if times is not None:
        raise ArgumentError("frames: times belong to a Result; a file has times of its own, see .times")
    try:
        path = Path(source)
    except TypeError:
        raise ArgumentError(f"frames: source is {source!r}, expected a Result or the path of a file") from None
    if not path.exists():
        raise StorageError(
            f"{path} does not exist; expected a .pvd of write_series or a run that Result.save has written"
        )
    return (_OfSeries if path.suffix.lower() == ".pvd" else _OfSavedRun)(path, magnification)
