"""A run as a series of VTU files with a PVD index, for ParaView.

The index is ``NAME.pvd``; its frames are in a folder ``NAME-frames`` beside it. The index, which replaces an earlier
one in one step, is written after all frames: a reader sees the whole new series, the whole old one, or none.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
from dataclasses import dataclass
from html import escape, unescape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vofem._validate import series
from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.files.whole import replacing, target
from vofem.io.frames import Frames
from vofem.result import Result

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
    """Write the frames of a run as a series of VTU files with a PVD index.

    Points, cells and fields are those of `vofem.Result.frame`. Geometry is at rest; in ParaView, Warp By Vector with
    ``deflection`` and the scale factor `magnification` moves it.

    Parameters
    ----------
    result : Result
    path : path of a .pvd
        The index. The frames are in a folder beside it.
    times : array_like, optional
        Times of the frames, s, increasing; `result.times` where not given.
    points_per_element : int
        Points of each element of a beam, 2 or more.
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
    index = target(path, (".pvd",))
    frames = Frames(result, magnification, points_per_element)
    earlier, folder, size = _folder_of(index), _free_name(index), 0
    try:
        with replacing(index) as temporary:
            folder.mkdir()
            for k, frame in enumerate(frames.over(chosen)):
                size += _write(frame, folder / _name(k))
            text = _index_text(folder.name, chosen)
            temporary.write_bytes(text)
    except BaseException:
        _remove(folder)
        raise
    if earlier is not None:
        _remove(earlier)
    return SeriesOutcome(index, chosen.size, size + len(text))


def _times(result: Result, times: ArrayLike | None) -> Array:
    if times is None:
        return result.times
    chosen, end = series("write_series: times", times), result.solution.t_end
    if np.any(np.diff(chosen) <= 0):
        raise ArgumentError("write_series: times do not increase; sort them, and name each once")
    if chosen[0] < 0.0 or chosen[-1] > end * (1.0 + 1e-12):
        raise ArgumentError(
            f"write_series: times reach from {chosen[0]:g} to {chosen[-1]:g} s, expected 0 to {end:g} s"
        )
    return np.minimum(chosen, end)


def _write(frame: Any, path: Path) -> int:
    """Write a frame as a VTU file and return its size in bytes."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    # As a text first: if a file cannot be written, VTK tells the terminal and goes on.
    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(frame)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    return path.write_bytes(writer.GetOutputString().encode())


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
