"""Draws with VTK in a process of its own, which may crash; see `vofem.io.probe` and `vofem.io.pictures.studio`."""

from __future__ import annotations

import pickle
import signal
import sys
from pathlib import Path


def _print(*words: str) -> None:
    sys.stdout.write(" ".join(words) + "\n")
    sys.stdout.flush()


def draw(path: str) -> None:
    """Draw a trial picture and, if this succeeds, the drawing on the standard input."""
    from vofem.io.pictures import backend_vtk

    found = backend_vtk.try_window()
    drawing = pickle.load(sys.stdin.buffer)
    if found != "blank" and drawing is not None:
        Path(path).write_bytes(backend_vtk.draw(drawing))
    _print("vofem-probe", found)


def serve(known: str = "") -> None:
    """Draw a picture for every line of the standard input: the files of a drawing and of its picture.

    Where the name of VTK's window is not `known` on this machine, a trial picture is drawn first.
    """
    # Ctrl-C is for the process that waits for the pictures.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from vofem.io.pictures import backend_vtk

    found = known or backend_vtk.try_window()
    _print("vofem-probe", found)
    if found == "blank":
        return
    for line in sys.stdin:
        source, goal = (Path(part) for part in line.rstrip("\n").split("\t"))
        goal.write_bytes(backend_vtk.draw(pickle.loads(source.read_bytes())))
        _print("vofem-drawn")
