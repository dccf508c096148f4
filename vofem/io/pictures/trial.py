"""Draws in a process of its own, which may crash; see `vofem.io.probe` and `vofem.io.pictures.studio`."""

from __future__ import annotations

import pickle
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


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
    """Draw a side view with VTK for every line of the standard input, see `_answer`.

    Where the name of VTK's window is not `known` on this machine, a trial picture is drawn first.
    """
    # Ctrl-C is for the process that waits for the pictures.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from vofem.io.pictures import backend_vtk

    found = known or backend_vtk.try_window()
    _print("vofem-probe", found)
    if found != "blank":
        _answer(lambda drawing, goal: goal.write_bytes(backend_vtk.draw(drawing)))


def plot() -> None:
    """Draw histories with matplotlib for every line of the standard input, see `_answer`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from vofem.io.pictures import history_figure

    history_figure.prepare()
    _answer(history_figure.draw)


def _answer(draw: Callable[[Any, Path], object]) -> None:
    """Draw a picture for every line of the standard input, which names the files of an object and of its picture."""
    for line in sys.stdin:
        source, goal = (Path(part) for part in line.rstrip("\n").split("\t"))
        draw(pickle.loads(source.read_bytes()), goal)
        _print("vofem-drawn")
