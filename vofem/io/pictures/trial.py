"""Draws a trial picture, and then another one, in a process of its own, which may crash; see `vofem.io.probe`."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path


def draw(path: str) -> None:
    """Draw a red square, look at its middle, tell what was found, and draw what stands on the standard input.

    Some drivers draw without complaint, and nothing.
    """
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=(32, 32), theme=pyvista.themes.DocumentTheme())
    plotter.add_mesh(pyvista.Plane(), color="red", lighting=False)
    plotter.view_xy()
    plotter.render()
    pixel = plotter.screenshot(None, return_img=True)[16, 16]
    good = pixel[0] > 200 and pixel[1] < 60 and pixel[2] < 60
    name = plotter.render_window.GetClassName()
    plotter.close()
    drawing = pickle.load(sys.stdin.buffer)
    if good and drawing is not None:
        from vofem.io.pictures import backend_vtk

        Path(path).write_bytes(backend_vtk.draw(drawing))
    sys.stdout.write(f"vofem-probe {name if good else 'blank'}\n")
    sys.stdout.flush()
