"""A run as a series of VTU files with a PVD index, for ParaView.

The index is ``NAME.pvd``; its frames are in the folder ``NAME-frames`` beside
it. They are written under a hidden name first, and the index, which replaces
an earlier one in one step, comes last: a reader sees the whole new series, the
whole old one, or none.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import secrets
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape, unescape
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vofem._validate import array, number
from vofem.errors import ArgumentError, OutputError
from vofem.files.whole import impossible, replacing
from vofem.io.series.grid import Grid
from vofem.io.series.meshes import Meshes, meshes
from vofem.io.series.placement import place
from vofem.io.series.vtu import write_vtu
from vofem.result import Result

Array = NDArray[np.float64]

#: Memory for the fields of the frames that are evaluated together.
_BLOCK_BYTES = 64_000_000

#: Suffixes that a user may give in the belief that the series is one such file.
_OTHER_FORMATS = (".vtu", ".vtk", ".vtp", ".vtm", ".vtkhdf", ".xdmf")

_FRAMES = "frame-*.vtu"


@dataclass(frozen=True)
class SeriesOutcome:
    """What was written.

    Attributes
    ----------
    path : Path
        Path of the index file, which ParaView opens.
    frames : int
    bytes : int
        Size of all files together.
    """

    path: Path
    frames: int
    bytes: int


def write_series(
    result: Result,
    path: str | os.PathLike[str],
    times: ArrayLike | None = None,
    *,
    points_per_element: int = 5,
    magnification: float = 1.0,
) -> SeriesOutcome:
    """Write a series of VTU files and its PVD index.

    Geometry is at rest; in ParaView, Warp By Vector with ``deflection`` and
    the scale factor `magnification` moves it. x runs along the beams, y up,
    and every body has its own plane z, see `vofem.io.series.placement`.

    ===========  ==========================================================================
    point data   ``deflection`` (vector) and ``eta`` (its y) in m, ``velocity`` in m/s,
                 ``slope``, ``bending_moment`` in N m, ``shear_force`` in N (NaN where there
                 is no beam), what the `sections` of other bodies name, ``x``: the body's own
                 coordinate in m; bodies that move along their axis are displaced along x
    cell data    ``kind``: 0 beam, 1 mass, 2 contact, 3 the bar that shows a stop;
                 ``body``, ``element``, ``contact``: numbers from 0 in the order of the
                 scene, -1 for none; ``contact_state``: 0 open, 1 closed, 2 pinned, -1 no
                 contact; ``contact_force`` in N, positive pushes apart, and
                 ``contact_stiffness`` in N/m, NaN where there is no contact; in N m and
                 N m/rad of contacts that act on rotations
    field data   ``TimeValue`` in s, ``magnification``
    ===========  ==========================================================================

    Every element has its own points, so moments and shear forces jump at nodes
    and are averaged nowhere. A contact is a line from its point a to the stop,
    or to its point b.

    Parameters
    ----------
    result : Result
    path : path
        Of the index, ``NAME.pvd``, in a folder that exists; or a folder, made
        where there is none, for ``series.pvd`` in it.
    times : array_like, optional
        Times of the frames, s, increasing; `result.times` where not given.
    points_per_element : int
        2 or more.
    magnification : float
        By which gaps are drawn larger, so that bodies meet when a contact
        closes under a warp of the same factor. The data are never magnified.

    Returns
    -------
    SeriesOutcome

    Raises
    ------
    ArgumentError
        For times outside the run or not increasing, or another format.
    OutputError
        If a file cannot be written. An earlier series of that name stays as it was.
    """
    if not isinstance(result, Result):
        raise ArgumentError(f"write_series: result is {result!r}, expected the Result of vofem.simulate")
    chosen = _times(result, times)
    magnification = number("write_series: magnification", magnification, positive=True)
    if not isinstance(points_per_element, (int, np.integer)) or not 2 <= points_per_element <= 1000:
        raise ArgumentError(f"write_series: points_per_element is {points_per_element!r}, expected 2 to 1000")
    grid = Grid(result, place(result.scene, magnification), int(points_per_element))
    with _removed_on_failure() as made:
        index = _index(path, made)
        staging, folder = index.parent / f".vofem-{secrets.token_hex(8)}", _free_name(index)
        earlier = _folder_of(index)
        size = 0
        with replacing(index) as temporary:
            staging.mkdir()
            made.append(staging)
            for k, (t, point_data, cell_data) in enumerate(_frames(grid, chosen)):
                fields = {"TimeValue": t, "magnification": magnification}
                size += write_vtu(staging / _name(k), grid, fields, point_data, cell_data)
            text = _index_text(folder.name, chosen)
            temporary.write_bytes(text)
            staging.rename(folder)
            made.append(folder)
    if earlier is not None:
        _remove(earlier)
    return SeriesOutcome(index, chosen.size, size + len(text))


def frames(
    source: Result | str | os.PathLike[str], times: ArrayLike | None = None, *, magnification: float | None = None
) -> Meshes:
    """Return the frames of a run as meshes of pyvista, moved as it moves.

    ``pyvista.read`` gives the first frame of a file alone. This is a sequence of all of them::

        found = vtk.frames("run.vtkhdf", magnification=20.0)
        found.times, found[10].plot(scalars="bending_moment")

    Parameters
    ----------
    source : Result, or path of a saved run or of a .pvd
    times : array_like, optional
        Times of the frames of a Result, s; `result.times` where not given.
    magnification : float, optional
        Of displacements. Of a file that of the file where not given, with which its stops are drawn; of a Result 1.

    Returns
    -------
    Meshes
        A sequence of `pyvista.UnstructuredGrid`, with `times` in s; each is made when it is asked for.

    Raises
    ------
    ArgumentError
        For another source, or times of a file.
    StorageError
        If the file is missing or holds no frames.
    """
    return meshes(source, times, magnification=magnification)


def _times(result: Result, times: ArrayLike | None) -> Array:
    if times is None:
        return result.times
    chosen = np.atleast_1d(array("write_series: times", times))
    end = result.solution.t_end
    if chosen.ndim != 1 or not chosen.size or np.any(np.diff(chosen) <= 0):
        raise ArgumentError(f"write_series: times has shape {chosen.shape}, expected one or more that increase")
    if chosen[0] < 0.0 or chosen[-1] > end * (1.0 + 1e-12):
        raise ArgumentError(
            f"write_series: times reach from {chosen[0]:g} to {chosen[-1]:g} s, expected 0 to {end:g} s"
        )
    return np.minimum(chosen, end)


def _frames(grid: Grid, times: Array) -> Iterator[tuple[float, dict[str, NDArray], dict[str, NDArray]]]:
    """Yield time, point data and cell data of all frames, evaluated in blocks that a bounded memory holds."""
    count = max(1, _BLOCK_BYTES // grid.bytes_per_frame)
    for start in range(0, times.size, count):
        block = times[start : start + count]
        frames = grid.frames(block)
        for k, t in enumerate(block.tolist()):
            yield (
                t,
                {name: values[k] for name, values in frames.point_data.items()},
                {name: values[k] for name, values in frames.cell_data.items()},
            )


# -- files ----------------------------------------------------------------------------------------


def _index(path: str | os.PathLike[str], made: list[Path]) -> Path:
    """Return the path of the index; make its folder, and add it to `made`, where the path is a new folder."""
    try:
        goal = Path(path)
    except TypeError:
        raise ArgumentError(f"path is {path!r}, expected NAME.pvd or a folder") from None
    fault = impossible(goal)
    if fault is not None:
        raise OutputError(f"path is {str(path)!r}, which {fault}; give another name")
    if goal.suffix.lower() == ".pvd":
        return goal
    if goal.suffix.lower() in _OTHER_FORMATS:
        raise ArgumentError(f"path is {str(path)!r}, expected NAME.pvd or a folder; each frame becomes a .vtu file")
    try:
        goal.mkdir()
        made.append(goal)
    except FileExistsError:
        pass  # a folder, or a file, of which `replacing` will complain
    except OSError as error:
        raise OutputError(
            f"the folder {goal} cannot be made: {error.strerror}; make it yourself or choose another place"
        ) from error
    return goal / "series.pvd"


@contextlib.contextmanager
def _removed_on_failure() -> Iterator[list[Path]]:
    """Give a list; remove the folders put into it if the block fails."""
    made: list[Path] = []
    try:
        yield made
    except BaseException:
        for folder in reversed(made):
            _remove(folder)
        raise


def _remove(folder: Path) -> None:
    """Remove a folder of frames; what else a user has put there stays."""
    with contextlib.suppress(OSError):
        for frame in folder.glob(_FRAMES):
            frame.unlink()
        folder.rmdir()


def _name(k: int) -> str:
    return f"frame-{k:06d}.vtu"


def _free_name(index: Path) -> Path:
    """Return the first of NAME-frames, NAME-frames-2, ... that does not exist."""
    names = itertools.chain([""], (f"-{k}" for k in itertools.count(2)))
    candidates = (index.with_name(f"{index.stem}-frames{end}") for end in names)
    return next(folder for folder in candidates if not os.path.lexists(folder))


def _folder_of(index: Path) -> Path | None:
    """Return the folder of the series that is there already."""
    try:
        with index.open(encoding="utf-8") as file:
            found = re.search(r'file="([^"/]+)/', file.read(10_000))
    except (OSError, UnicodeDecodeError):
        return None
    name = unescape(found[1]) if found else ""
    return index.parent / name if re.fullmatch(re.escape(index.stem) + r"-frames(-\d+)?", name) else None


def _index_text(folder: str, times: Array) -> bytes:
    entries = "".join(
        f'<DataSet timestep="{float(t)!r}" part="0" file="{escape(folder)}/{_name(k)}"/>\n' for k, t in enumerate(times)
    )
    text = f'<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n{entries}</Collection>\n'
    return (text + "</VTKFile>\n").encode()
