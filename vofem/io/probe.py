"""Whether VTK can draw off-screen on this machine.

Without a working graphics driver VTK ends the process with a segmentation
fault, which no Python code can catch. Therefore a child process draws the first
picture on a machine. The outcome is stored until VTK or the drivers change.
"""

from __future__ import annotations

import functools
import os
import pickle
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import platformdirs

from vofem.folders import read_entries, write_entry

_TIMEOUT = 60.0

#: What was found on this machine stands there.
_KNOWN = "graphics.json"


@dataclass(frozen=True)
class Probe:
    """Whether VTK works, and the name of its window or the cause of the failure."""

    works: bool
    detail: str


def prepare_environment() -> None:
    """Let VTK use EGL on Linux, which needs no display; has an effect before VTK makes its first window."""
    if sys.platform.startswith("linux"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


@functools.cache
def probe() -> Probe:
    """Return whether VTK can draw off-screen. The first call in a process takes about a second."""
    return try_out(None, None)


def try_out(drawing: Any, path: Path | None) -> Probe:
    """Let a child process draw a picture, return whether it succeeded, and store the outcome.

    Parameters
    ----------
    drawing : Drawing, optional
        Drawn after a small trial picture.
    path : Path, optional
        Name of its PNG file.
    """
    prepare_environment()
    try:
        child = subprocess.run(
            [sys.executable or "python", "-c", child_code(f"draw({str(path)!r})")],
            input=pickle.dumps(drawing),
            capture_output=True,
            timeout=_TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Probe(False, f"a trial picture was not ready after {_TIMEOUT:g} s")
    except OSError as error:
        return Probe(False, f"a trial process could not be started: {error}")
    found = verdict(child.returncode, *(part.decode(errors="replace") for part in (child.stdout, child.stderr)))
    remember(found)
    return found


def child_code(call: str) -> str:
    """Return the program of a process that calls a function of `vofem.io.pictures.trial`."""
    root = str(Path(__file__).parent.parent.parent)
    return f"import sys; sys.path.insert(0, {root!r}); from vofem.io.pictures.trial import *; {call}"


def remember(found: Probe) -> None:
    """Store what was found, for this process and others."""
    write_entry(
        platformdirs.user_cache_path("vofem", appauthor=False) / _KNOWN, _machine(), [found.works, found.detail]
    )
    remembered.cache_clear()


def forget() -> None:
    """Drop what was stored of this machine: VTK has failed all the same."""
    write_entry(platformdirs.user_cache_path("vofem", appauthor=False) / _KNOWN, _machine(), None)
    remembered.cache_clear()


@functools.cache
def remembered() -> Probe | None:
    """Return what any process found on this machine with the same drivers, or None."""
    known = read_entries(platformdirs.user_cache_path("vofem", appauthor=False) / _KNOWN).get(_machine())
    return Probe(bool(known[0]), str(known[1])) if isinstance(known, list) and len(known) == 2 else None


def _machine() -> str:
    """Return what the drawing depends on, as far as it can be told without drawing: machine, VTK, driver, settings."""
    import hashlib
    import platform
    from importlib.util import find_spec

    vtk = find_spec("vtkmodules")
    # The list of all libraries of a Linux system is written anew when one of them is installed.
    files = [*(vtk.submodule_search_locations or [] if vtk is not None else []), "/etc/ld.so.cache"]
    stamps = [
        f"{file} {status.st_mtime_ns} {status.st_size}" for file in files if (status := _status(file)) is not None
    ]
    prefixes = ("VTK_", "LIBGL_", "MESA_", "GALLIUM_", "EGL_", "__GL", "__EGL", "LD_", "DISPLAY")
    settings = sorted(f"{name}={value}" for name, value in os.environ.items() if name.startswith(prefixes))
    parts = [platform.node(), platform.release(), sys.executable, *stamps, *settings]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]


def _status(file: str) -> os.stat_result | None:
    try:
        return os.stat(file)
    except OSError:
        return None


def verdict(code: int, output: str, errors: str) -> Probe:
    """Return the meaning of the exit code and the output of the child process."""
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
