"""Draws with VTK in a process of its own, which may crash; see `vofem.io.probe` and `vofem.io.pictures.studio`."""

from __future__ import annotations

import pickle
import signal
import sys
from pathlib import Path


def _window() -> str:
    """Draw a red square, look at its middle; return the name of VTK's window, or "blank".

    Some drivers draw without complaint, and nothing.
    """
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=(32, 32), theme=pyvista.themes.DocumentTheme())
    plotter.add_mesh(pyvista.Plane(), color="red", lighting=False)
    plotter.view_xy()
    plotter.render()
    pixel = plotter.screenshot(None, return_img=True)[16, 16]
    name = plotter.render_window.GetClassName()
    plotter.close()
    return str(name) if pixel[0] > 200 and pixel[1] < 60 and pixel[2] < 60 else "blank"


def _print(*words: str) -> None:
    sys.stdout.write(" ".join(words) + "\n")
    sys.stdout.flush()


def draw(path: str) -> None:
    """Draw a trial picture and, where that went well, what stands on the standard input."""
    found = _window()
    drawing = pickle.load(sys.stdin.buffer)
    if found != "blank" and drawing is not None:
        from vofem.io.pictures import backend_vtk

        Path(path).write_bytes(backend_vtk.draw(drawing))
    _print("vofem-probe", found)


def serve() -> None:
    """Draw a trial picture, then one for every line of the standard input: the files of a drawing and its picture."""
    # Ctrl-C is for the process that waits for the pictures.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    found = _window()
    _print("vofem-probe", found)
    if found == "blank":
        return
    from vofem.io.pictures import backend_vtk

    for line in sys.stdin:
        source, goal = (Path(part) for part in line.rstrip("\n").split("\t"))
        goal.write_bytes(backend_vtk.draw(pickle.loads(source.read_bytes())))
        _print("vofem-drawn")
