"""Pictures with VTK, off-screen; with matplotlib where VTK does not work."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from vofem.io.files import replacing, target
from vofem.io.probe import Probe, cure, prepare_environment, probe, remembered, try_out
from vofem.result import Result
from vofem.scene import Scene
from vofem.statics import Equilibrium

__all__ = ["Probe", "RenderOutcome", "probe", "render"]


@dataclass(frozen=True)
class RenderOutcome:
    """What was drawn.

    Attributes
    ----------
    path : Path
    backend : str
        "vtk" or "matplotlib".
    message : str
        Why matplotlib was used and how to get VTK; empty where VTK drew.
    """

    path: Path
    backend: str
    message: str


def render(
    result: Result | Equilibrium,
    t: float | None,
    path: str | os.PathLike[str],
    *,
    scene: Scene | None = None,
    size: tuple[int, int] = (1600, 700),
    magnification: float | None = None,
) -> RenderOutcome:
    """Draw the side view of a scene at time t.

    Beams are coloured by their bending moment, which is also drawn above
    them on the side in tension; closed contacts carry their force. Colours and
    magnification are those of the whole run, so that pictures of one run at
    several times can be compared.

    Parameters
    ----------
    result : Result or Equilibrium
    t : float or None
        In s; None for an equilibrium.
    path : path of a .png
    scene : Scene, optional
        That of an equilibrium.
    size : tuple of int
        Width and height in pixels.
    magnification : float, optional
        Of displacements; where not given, the largest 1, 2 or 5 times a power
        of ten at which the motion fits. In a scene without beams the picture
        is taken to be 1 m wide.

    Returns
    -------
    RenderOutcome

    Raises
    ------
    ArgumentError
        For a time outside the run, a size or a suffix that is not possible.
    OutputError
        If the file cannot be written.
    """
    from vofem.io.pictures.sketch import sketch
    from vofem.io.pictures.snapshot import snapshot

    goal = target(path, (".png",))
    drawing = sketch(snapshot(result, t, scene), size, magnification)
    found = remembered()
    with replacing(goal) as temporary:
        if found is None:
            found = try_out(drawing, temporary)
        elif found.works:
            prepare_environment()
            from vofem.io.pictures import backend_vtk

            temporary.write_bytes(backend_vtk.draw(drawing))
        if not found.works:
            from vofem.io.pictures import backend_matplotlib

            backend_matplotlib.draw(drawing, temporary)
    if found.works:
        return RenderOutcome(goal, "vtk", "")
    message = f"drawn with matplotlib, because VTK does not work here: {found.detail}. To get VTK, {cure()}"
    return RenderOutcome(goal, "matplotlib", message)
