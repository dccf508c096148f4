"""What `vofem doctor` reports: versions, and whether VTK can draw without a window."""

from __future__ import annotations

import platform
import sys
from dataclasses import dataclass
from importlib import metadata

from vofem._version import __version__
from vofem.io.space import graphics_fault

#: Distributions that vofem uses.
REQUIRED = ("numpy", "scipy", "scikit-fem", "numba", "matplotlib", "pyvista", "vtk", "meshio", "h5py", "threadpoolctl")


@dataclass(frozen=True)
class Diagnosis:
    """What `vofem doctor` has found.

    Attributes
    ----------
    versions : dict of str to str or None
        Versions of packages; None for a package that is not installed.
    graphics : str
        Why VTK cannot draw without a window, and what would help; empty where it can.
    compiled : str
        Where compiled code is kept, and which methods it covers.
    """

    versions: dict[str, str | None]
    graphics: str
    compiled: str = ""

    @property
    def missing(self) -> tuple[str, ...]:
        """Packages that are not installed."""
        return tuple(name for name, version in self.versions.items() if version is None)

    def __str__(self) -> str:
        lines = [
            f"vofem {__version__}",
            f"Python {platform.python_version()} at {sys.executable}",
            f"{platform.platform()}, {platform.machine()}",
            "",
        ]
        lines += [f"{name:<12} {version or 'is not installed'}" for name, version in self.versions.items()]
        if self.missing:
            lines += ["", f"Install what is missing: {sys.executable} -m pip install {' '.join(self.missing)}"]
        lines += ["", *self.compiled.splitlines(), ""] if self.compiled else [""]
        lines.append(
            f"vofem.io.snapshot does not work, all other pictures do: {self.graphics}"
            if self.graphics
            else "Pictures of all kinds can be drawn here"
        )
        return "\n".join(lines)


def diagnose() -> Diagnosis:
    """Examine this machine; this takes about a second."""
    versions: dict[str, str | None] = {}
    for name in REQUIRED:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = None
    return Diagnosis(versions, graphics_fault(), compiled_code())


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
