"""A law written outside the package: one class for the law, one for its effect, one entry for scene files."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import vofem as vf
from vofem.bodies.base import as_point
from vofem.io.scene_file import load_scene
from vofem.io.scenes.entry import Entry
from vofem.io.scenes.kinds import POSITIVE
from vofem.io.scenes.parts import PointByName
from vofem.io.scenes.schema import EFFECTS
from vofem.laws import LawGroup, SmoothLaws

STIFFNESS, LENGTH = 40.0, 0.1


@dataclass(frozen=True)
class SinhLaw:
    """R = K L sinh(u/L): a spring that stiffens."""

    name: str
    stiffness: float
    length: float
    monotone: bool = True
    group: type[LawGroup] = SmoothLaws

    @property
    def label(self):
        return f"SinhSpring {self.name!r}"

    def reaction(self, u):
        return self.stiffness * self.length * math.sinh(u / self.length)

    def energy(self, u):
        # cosh(x) - 1 without cancellation.
        return 2.0 * self.stiffness * self.length**2 * math.sinh(0.5 * u / self.length) ** 2

    def tangent(self, u):
        return self.stiffness * math.cosh(u / self.length)


class SinhSpring:
    """The effect: a spring from a point to ground."""

    def __init__(self, point, *, stiffness, length, name="sinh"):
        self.name, self.point = name, as_point(f"SinhSpring {name!r}: point", point)
        self.stiffness, self.length = stiffness, length

    def points(self):
        return (self.point,)

    def compile(self, builder):
        builder.add_law(builder.row(self.point), SinhLaw(self.name, self.stiffness, self.length))

    def describe(self):
        return f"SinhSpring {self.name!r} at {self.point.describe()}"


def scene_of(mass, *more):
    return vf.Scene([mass], [SinhSpring(mass, stiffness=STIFFNESS, length=LENGTH), *more], initial={mass: (0.25, 0.0)})


def exact(times, damping=0.0):
    law = SinhLaw("", STIFFNESS, LENGTH)

    def rate(t, y):
        return [y[1], -law.reaction(y[0]) - damping * y[1]]

    return solve_ivp(rate, (0.0, times[-1]), [0.25, 0.0], t_eval=times, rtol=1e-11, atol=1e-12, method="DOP853").y


@pytest.mark.parametrize("method", ["energy_conserving", "generalized_alpha", "central_difference"])
def test_every_stepping_method_takes_it(method):
    mass, times = vf.Mass(1.0, name="m"), np.linspace(0.0, 1.0, 21)
    errors = []
    for dt in (2e-3, 1e-3):
        result = vf.simulate(scene_of(mass), 1.0, method=method, dt=dt, times=times)
        errors.append(np.max(np.abs(result.displacement(mass) - exact(times)[0])))
    assert errors[1] < 2e-4
    assert 1.8 < np.log2(errors[0] / errors[1]) < 2.2
    energy = result.energy
    expected = np.array([SinhLaw("", STIFFNESS, LENGTH).energy(u) for u in result.displacement(mass)])
    assert energy.strain == pytest.approx(expected, rel=1e-12)
    assert energy.balance_error < (1e-12 if method == "energy_conserving" else 1e-3)
    assert result.counters.law_evaluations > 0


def test_steps_that_follow_a_tolerance_take_it():
    mass, times = vf.Mass(1.0, name="m"), np.linspace(0.0, 1.0, 21)
    result = vf.simulate(scene_of(mass), 1.0, tol=1e-5, times=times)
    assert result.method == "energy_conserving"
    assert np.max(np.abs(result.displacement(mass) - exact(times)[0])) < 10.0 * 1e-5 * 0.25


@pytest.mark.parametrize("load", [0.5, 40.0, -30.0])
def test_statics_takes_a_law_whose_force_never_falls(load):
    law = SinhLaw("", STIFFNESS, LENGTH)
    mass = vf.Mass(1.0, stiffness=3.0, name="m")
    stop = vf.Contact(mass, gap=0.2, stiffness=100.0, side="above", acts_on="penetration", name="stop")
    scene = vf.Scene([mass], [SinhSpring(mass, stiffness=STIFFNESS, length=LENGTH), stop, vf.PointLoad(mass, load)])

    def residual(u):
        return law.reaction(u) + 3.0 * u + 100.0 * max(u - 0.2, 0.0) - load

    expected = brentq(residual, -5.0, 5.0, xtol=1e-16, rtol=1e-15)
    outcome = vf.equilibrium(scene)
    assert outcome.displacement(mass) == pytest.approx(expected, rel=1e-12)
    assert outcome.contacts["stop"].closed == (expected > 0.2)
    path = vf.quasi_static(scene, [0.5, 1.0])
    assert path.displacement(mass)[-1] == pytest.approx(expected, rel=1e-12)


def test_a_law_whose_force_may_fall_is_refused_by_name():
    mass = vf.Mass(1.0)
    law = SinhLaw("odd", 1.0, 1.0, monotone=False)

    class Odd(SinhSpring):
        def compile(self, builder):
            builder.add_law(builder.row(self.point), law)

    scene = vf.Scene([mass], [Odd(mass, stiffness=1.0, length=1.0), vf.PointLoad(mass, 1.0)])
    with pytest.raises(vf.ArgumentError, match="SinhSpring 'odd' may have several equilibria"):
        vf.equilibrium(scene)
    with pytest.raises(vf.MethodError, match="SinhSpring 'odd' is not piecewise linear"):
        vf.simulate(scene, 1.0, method="event_driven")
    with pytest.raises(vf.ArgumentError, match="SinhSpring 'odd' has no modes"):
        vf.modes(scene)


def test_a_reaction_counts_it():
    """What the clamp of a beam holds is what inertia and the spring leave over."""
    beam = vf.Beam(1.0, 1.0, 1.0, 4, {"left": "clamped"}, name="b")
    tip = beam.at(1.0)
    scene = vf.Scene(
        [beam], [SinhSpring(tip, stiffness=STIFFNESS, length=LENGTH), vf.PointLoad(tip, 2.0), vf.RayleighDamping(3.0)]
    )
    result = vf.simulate(scene, 30.0, method="generalized_alpha", dt=0.01, times=[30.0])
    rest = vf.equilibrium(scene)
    assert result.displacement(tip)[-1] == pytest.approx(rest.displacement(tip), rel=1e-9)
    held = SinhLaw("", STIFFNESS, LENGTH).reaction(rest.displacement(tip)) - 2.0
    assert result.reaction(beam, "left").force[-1] == pytest.approx(held, rel=1e-6)


def test_an_entry_makes_it_part_of_scene_files(tmp_path, monkeypatch):
    monkeypatch.setitem(
        EFFECTS,
        "sinh_spring",
        Entry("sinh_spring", SinhSpring, {"point": PointByName(), "stiffness": POSITIVE, "length": POSITIVE}),
    )
    file = tmp_path / "scene.toml"
    file.write_text(
        '[[mass]]\nname = "m"\nmass = 1.0\n[[sinh_spring]]\npoint = "m"\nstiffness = 40.0\nlength = 0.1\n'
        '[[point_load]]\npoint = "m"\nf = 1.0\n[run]\nt_end = 1.0\n'
    )
    scene = load_scene(file).scene
    u = vf.equilibrium(scene).displacement(scene.bodies[0])
    assert SinhLaw("", STIFFNESS, LENGTH).reaction(u) == pytest.approx(1.0, rel=1e-12)
