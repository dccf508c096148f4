"""What `vofem doctor` reports: versions, and whether pictures can be drawn off-screen."""

from __future__ import annotations

import platform
import sys
from dataclasses import dataclass
from importlib import metadata

from vofem._version import __version__
from vofem.io.probe import Probe, cure, probe

#: Distributions that vofem uses.
REQUIRED = ("numpy", "scipy", "scikit-fem", "numba", "matplotlib", "pyvista", "vtk", "meshio", "h5py", "threadpoolctl")


@dataclass(frozen=True)
class Diagnosis:
    """What was found.

    Attributes
    ----------
    versions : dict of str to str or None
        None where a package is not installed.
    rendering : Probe
    """

    versions: dict[str, str | None]
    rendering: Probe

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
        lines.append("")
        if self.rendering.works:
            lines.append(f"Off-screen rendering works ({self.rendering.detail})")
        else:
            lines += [
                f"Off-screen rendering does not work: {self.rendering.detail}",
                f"To get it, {cure()}",
                "Until then pictures are drawn with matplotlib",
            ]
        return "\n".join(lines)


def diagnose() -> Diagnosis:
    """Look at this machine; takes about a second."""
    versions: dict[str, str | None] = {}
    for name in REQUIRED:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = None
    return Diagnosis(versions, probe())
