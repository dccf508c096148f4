"""What `vofem doctor` reports: versions, and whether VTK can draw without a window."""

from __future__ import annotations

import contextlib
import platform
import sys
from importlib import metadata

from vofem._version import __version__
from vofem.io.space import graphics_fault

#: Distributions that vofem uses.
REQUIRED = ("numpy", "scipy", "scikit-fem", "numba", "matplotlib", "pyvista", "vtk", "meshio", "h5py", "threadpoolctl")


def diagnose() -> tuple[str, bool]:
    """Return what this machine has, as text, and whether all packages are there; this takes about a second."""
    versions: dict[str, str] = {}
    for name in REQUIRED:
        with contextlib.suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    missing = [name for name in REQUIRED if name not in versions]
    lines = [
        f"vofem {__version__}",
        f"Python {platform.python_version()} at {sys.executable}",
        f"{platform.platform()}, {platform.machine()}",
        "",
        *(f"{name:<12} {versions.get(name, 'is not installed')}" for name in REQUIRED),
    ]
    if missing:
        lines += ["", f"Install what is missing: {sys.executable} -m pip install {' '.join(missing)}"]
    fault = graphics_fault()
    told = f"vofem.io.snapshot does not work, all other pictures do: {fault}"
    lines += ["", *compiled_code().splitlines(), "", told if fault else "Pictures of all kinds can be drawn here"]
    return "\n".join(lines), not missing


def compiled_code() -> str:
    """Return where compiled code is kept, and which methods it covers."""
    from vofem.kernels.cache import cache_folder, kinds_on_disk, refused_folder, size_on_disk
    from vofem.simulate.ahead import KINDS

    folder, refused = cache_folder(), refused_folder()
    lines = [refused] if refused else []
    if folder is None:
        lines += [
            "Compiled code cannot be kept: neither the folder of the package nor that of the user's caches can be "
            "written.",
            "Long runs compile anew in every process; set NUMBA_CACHE_DIR to a folder that can be written",
        ]
        return "\n".join(lines)
    there = kinds_on_disk()
    lines.append(f"Compiled code is kept in {folder} ({size_on_disk() / 1e6:.3g} MB)")
    ready, missing = ([kind for kind in KINDS if (kind in there) is wanted] for wanted in (True, False))
    if ready:
        lines += [f"It is there for {len(ready)} of {len(KINDS)} kinds of work:", *(f"  {kind}" for kind in ready)]
    if missing:
        lines += [
            "For these kinds of work it is compiled by `vofem compile`, or in the first run that is long enough:",
            *(f"  {kind}" for kind in missing),
        ]
    return "\n".join(lines)
