"""A mode shape over one period, as what pictures need."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vofem.bodies import Beam
from vofem.errors import ArgumentError
from vofem.io.pictures.snapshot import BodyState, Snapshot, fixed_parts
from vofem.scene import Scene, as_scene
from vofem.vibration import Modes

#: Largest displacement that is shown, over the length of the scene.
_SHARE = 0.05

#: Points along a beam.
_POINTS = 241


def mode_snapshots(modes: Modes, number: int, scene: Scene | None, count: int) -> list[Snapshot]:
    """Return a mode shape at `count` equal parts of its period.

    Its size is arbitrary: the largest displacement is shown as a twentieth of the longest beam.

    Raises `ArgumentError` for a number that there is no mode of, and for a scene of other bodies.
    """
    if isinstance(number, bool) or not isinstance(number, (int, np.integer)) or not 0 <= number < modes.omega.size:
        raise ArgumentError(f"animate: mode is {number!r}, expected 0 to {modes.omega.size - 1}")
    bodies = modes.bodies
    if scene is not None and {*as_scene("animate", scene).bodies} != {*bodies}:
        names, others = ([body.name for body in some] for some in (bodies, scene.bodies))
        raise ArgumentError(
            f"animate: the mode shapes are those of the bodies {names}, and the scene has others, {others}; give the "
            "scene of which vofem.modes found them"
        )
    places = {b: np.linspace(b.nodes[0], b.nodes[-1], _POINTS) if isinstance(b, Beam) else b.shape.x for b in bodies}
    shapes = {b: modes.shape(number, places[b] if isinstance(b, Beam) else None, b) for b in bodies}
    largest = max(float(np.max(np.abs(shape), initial=0.0)) for shape in shapes.values())
    length = max(float(np.ptp(body.shape.x)) for body in bodies) or 1.0
    scale = _SHARE * length / largest if largest else 0.0
    title = f"mode {number + 1}: {modes.frequencies[number]:.4g} Hz"
    still = Snapshot(None, (), (), title=title) if scene is None else replace(fixed_parts(scene), title=title)
    found = []
    for turn in np.arange(count) / count:
        states = []
        for body in bodies:
            eta = scale * shapes[body]
            extent, nothing, depth = float(np.max(np.abs(eta), initial=0.0)), np.zeros(eta.size), np.ones(eta.size)
            now = eta * np.cos(2.0 * np.pi * turn)
            states.append(BodyState(body, places[body], now, nothing, depth, -extent, extent, 0.0, 0.0))
        found.append(replace(still, bodies=tuple(states)))
    return found
