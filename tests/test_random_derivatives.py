"""Derivatives of random scenes beside Richardson's differences of their runs, at the floor of such differences.

``python tests/test_random_derivatives.py FIRST LAST`` looks at the scenes of many seeds and prints what it finds.
"""

import random
import sys
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from random_scenes import scene as random_scene

import vofem as vf
from vofem import Parameter

FIELDS: dict[type, tuple[str, ...]] = {
    vf.Mass: ("mass", "stiffness", "damping"), vf.Beam: ("EI", "rhoA", "length"), vf.Spring: ("stiffness",),
    vf.Dashpot: ("damping",), vf.RayleighDamping: ("alpha", "beta"), vf.ModalDamping: ("ratio",),
    vf.Contact: ("gap", "stiffness", "damping"), vf.Gravity: ("g",),
    vf.PointLoad: ("f.amplitude", "f.omega", "f.phase", "f.value", "f.slope"),
}  # fmt: skip

#: Relative steps, each a fraction of the one before. Two neighbours give one extrapolated difference.
FACTOR = 8.0
STEPS = tuple(2e-3 / FACTOR**k for k in range(5))

#: Parameters of one scene that are looked at, and events of a run.
MOST, EVENTS = 3, 60


def parameters_of(scene: vf.Scene) -> list[Parameter]:
    """Return the parameters of a scene that are not zero; at zero derivatives may have one side only."""
    found = []
    for thing in (*scene.bodies, *scene.effects):
        for field in FIELDS.get(type(thing), ()):
            parameter = Parameter(thing, field)
            try:
                parameter.check(scene)
            except vf.ArgumentError:
                continue
            # The functions of x that give an initial state do not stretch with the beam.
            if parameter.value(scene) != 0.0 and not (field == "length" and scene.initial):
                found.append(parameter)
    return found


def motion(scene: vf.Scene, times: np.ndarray) -> tuple[np.ndarray, list[tuple[int, int]], Any]:
    """Return displacements of all bodies' ends and the dissipated energy at times, events, and the run."""
    run = vf.simulate(scene, float(times[-1]), times=times, method="event_driven", progress=False)
    rows = [run.displacement(point) for point in points_of(scene)]
    events = run.solution.events
    return np.stack([*rows, run.energy.dissipated]), list(zip(events.contact, events.status, strict=True)), run


def points_of(scene: vf.Scene) -> list[Any]:
    return [body.at(body.length) if isinstance(body, vf.Beam) else body for body in scene.bodies]


def worst(seed: int) -> tuple[float, str]:
    """Return the largest ratio of an error to what differences can show, and where it is; 0.0 if nothing compares."""
    scene, t_end = random_scene(random.Random(seed))
    t_end = min(t_end, 2.0)
    times = t_end * np.array([0.0, 0.37, 0.61, 0.83, 1.0])
    base, events, run = motion(scene, times)
    parameters = parameters_of(scene)
    random.Random(seed).shuffle(parameters)
    parameters = parameters[:MOST]
    if not parameters or len(events) > EVENTS:
        return 0.0, "nothing to compare"
    d = vf.sensitivities(run, parameters)
    mine = np.stack([*(d.displacement(point) for point in points_of(scene)), d.energy.dissipated])
    found = (0.0, "nothing compared")
    for k, parameter in enumerate(parameters):
        value, plain = parameter.value(scene), []
        for step in STEPS:
            h = step * abs(value)
            ends = [motion(parameter.changed(scene, sign * h), times) for sign in (1.0, -1.0)]
            if all(one[1] == events for one in ends):
                plain.append((ends[0][0] - ends[1][0]) / (2.0 * h))
        several = [(FACTOR**2 * b - a) / (FACTOR**2 - 1.0) for a, b in pairwise(plain)]
        if len(several) < 2:
            continue
        # A body may not depend on a parameter at all; then there is only rounding of the others to see.
        rows = np.max(np.abs(mine[..., k]), axis=1)
        size = rows + 1e-6 * np.max(rows) + 1e-12 * np.max(np.abs(base), axis=1) / abs(value) + 1e-300
        apart = [np.max(np.abs(a - b), axis=1) / size for a, b in pairwise(several)]
        best = int(np.argmin([np.max(one) for one in apart]))
        # The derivative lies as close to the differences as they lie to each other.
        off = np.max(np.abs(several[best + 1] - mine[..., k]), axis=1) / size
        ratio = float(np.max(off / (10.0 * apart[best] + 1e-8)))
        if ratio > found[0]:
            found = ratio, f"{parameter.name}: off by {off.max():.1e}, differences by {apart[best].max():.1e}"
    return found


@pytest.mark.parametrize("seed", [1, 4, 7])
def test_random_scenes_have_the_derivatives_of_differences(seed: int) -> None:
    ratio, where = worst(seed)
    assert 0.0 < ratio < 1.0, where


if __name__ == "__main__":
    for number in range(int(sys.argv[1]), int(sys.argv[2])):
        try:
            print(number, *worst(number), flush=True)
        except vf.VofemError as error:
            print(number, type(error).__name__, str(error)[:150], flush=True)
