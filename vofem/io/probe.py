"""Whether VTK can draw off-screen on this machine.

Without a working graphics driver VTK ends the process with a segmentation
fault, which no Python code can catch. So a child process tries first.
"""

from __future__ import annotations

import functools
import os
import subprocess
import sys
from dataclasses import dataclass

_TIMEOUT = 60.0

#: Draws a red square and looks at its middle: some drivers draw without complaint, and nothing.
_SCRIPT = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(32, 32), theme=pyvista.themes.DocumentTheme())
plotter.add_mesh(pyvista.Plane(), color="red", lighting=False)
plotter.view_xy()
plotter.render()
pixel = plotter.screenshot(None, return_img=True)[16, 16]
good = pixel[0] > 200 and pixel[1] < 60 and pixel[2] < 60
print("vofem-probe", plotter.render_window.GetClassName() if good else "blank", flush=True)
"""


@dataclass(frozen=True)
class Probe:
    """The verdict: whether VTK works, and the name of its window or the cause of the failure."""

    works: bool
    detail: str


def prepare_environment() -> None:
    """Let VTK use EGL on Linux, which needs no display; has an effect before VTK makes its first window."""
    if sys.platform.startswith("linux"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


@functools.cache
def probe() -> Probe:
    """Return whether VTK can draw off-screen; tried once a process, which takes about a second."""
    prepare_environment()
    try:
        child = subprocess.run(
            [sys.executable or "python", "-c", _SCRIPT],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=_TIMEOUT,
            check=False,
            text=True,
            errors="replace",
        )
    except subprocess.TimeoutExpired:
        return Probe(False, f"a trial picture was not ready after {_TIMEOUT:g} s")
    except OSError as error:
        return Probe(False, f"a trial process could not be started: {error}")
    return verdict(child.returncode, child.stdout, child.stderr)


def verdict(code: int, output: str, errors: str) -> Probe:
    """Return what the exit code and the output of the child process mean."""
    words = [line.split()[1] for line in output.splitlines() if line.startswith("vofem-probe ")]
    if words and words[0] == "blank":
        return Probe(False, "a trial picture came out blank")
    # A driver may crash as the process ends, after the picture is done; it would crash the user's process then too.
    if code == 0 and words:
        return Probe(True, words[0])
    if code < 0 or code >= 0xC0000000:
        return Probe(False, f"VTK crashed a trial process (exit code {code}): no working graphics driver")
    lines = errors.strip().splitlines()
    return Probe(False, lines[-1].strip() if lines else f"a trial process ended with exit code {code}")


def cure() -> str:
    """Return what would make VTK work here."""
    if sys.platform.startswith("linux"):
        return "on Debian and Ubuntu, apt-get install libegl1 libgl1-mesa-dri"
    return "install a graphics driver with OpenGL 3.2 or later"
