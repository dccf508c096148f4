"""Scenes whose steady states are known, for tests and benchmarks."""

from types import SimpleNamespace

import numpy as np

import vofem as vf


def masses_at(states):
    """Return a guess of a motion from displacements and velocities of masses by their names."""
    return SimpleNamespace(state_of=lambda name: tuple(np.array([number]) for number in states[name]))


def bilinear(omega, amplitude=1.0, gap=0.0, acts_on="penetration", damping=0.1):
    """P1 of the reference data: one mass on a stop, load ``sin(omega t)``."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=damping, name="mass")
    stop = vf.Contact(mass, gap=gap, stiffness=8.0, side="above", acts_on=acts_on, name="stop")
    return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(amplitude, omega))])


def nlvib_03(
    omega, amplitude=0.1, stiffness=100.0, *, dashpot=0.03, damping=0.0, phase=np.pi / 2, sides=("above",), pushed=()
):
    """NLvib's example 03: two masses, a stop on the first, a load ``cos(omega t)`` on the second.

    `dashpot`, `damping`: dampers between the masses and of the stops. `pushed`: further loads of both masses.
    """
    a, b = vf.Mass(1.0, name="a"), vf.Mass(1.0, stiffness=1.0, damping=0.03, name="b")
    names = {"above": "stop", "below": "other"}
    stop = {"gap": 1.0, "stiffness": stiffness, "damping": damping, "acts_on": "penetration"}
    effects = [
        vf.Spring(a, b, stiffness=1.0),
        vf.Dashpot(a, b, damping=dashpot),
        *(vf.Contact(a, side=side, name=names[side], **stop) for side in sides),
        vf.PointLoad(b, vf.Sine(amplitude, omega, phase=phase)),
        *(vf.PointLoad(mass, load) for mass, load in zip((a, b), pushed, strict=False) if load is not None),
    ]
    return vf.Scene([a, b], effects)


def impact_oscillator(omega, a=0.7):
    """Ing, Pavlovskaia, Wiercigroch 2008: load ``a omega^2 cos(omega t)``."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.02, name="mass")
    stop = vf.Contact(mass, gap=1.26, stiffness=29.0, side="above", acts_on="penetration", name="stop")
    return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(a * omega**2, omega, phase=np.pi / 2))])


def state_at_cosine(orbit):
    """Return displacements, then velocities, of all masses at t = 0 of the loads, where their cosine is 1."""
    states = [orbit.state_of(body.name) for body in orbit.scene.bodies]
    return np.array([float(part[k][0]) for k in range(2) for part in states])
