"""Scenes for diagrams; in a module of their own, so that other processes can import them."""

import numpy as np
from scenes import on_stop

import vofem as vf

#: The masses by which points are found.
FIRST, SECOND = vf.Mass(1.0, name="first"), vf.Mass(1.0, 1.0, 0.03, name="second")


def two_masses(omega):
    """Example 03 of NLvib: Krack and Gross, Harmonic Balance for Nonlinear Vibration Problems, 2019."""
    first, second = vf.Mass(1.0, name="first"), vf.Mass(1.0, 1.0, 0.03, name="second")
    effects = [
        vf.Spring(first, second, stiffness=1.0),
        vf.Dashpot(first, second, damping=0.03),
        vf.Contact(first, gap=1.0, stiffness=100.0, side="above", acts_on="penetration", name="stop"),
        vf.PointLoad(second, vf.Sine(0.1, omega, phase=np.pi / 2)),
    ]
    return vf.Scene([first, second], effects)


def oscillator(omega, gap):
    return on_stop(vf.Mass(1.0, 1.0, 0.1, name="m"), load=vf.Sine(1.0, omega), gap=gap, stiffness=8.0)[1]


def start(q1):
    return {FIRST: (q1, 0.0), SECOND: (0.0, 0.0)}


def transient(omega):
    """No steady state: the load is not periodic."""
    return on_stop(vf.Mass(1.0, 1.0, 0.1, name="m"), load=vf.Pulse(1.0, 0.5, 0.1 * omega), gap=0.1, stiffness=8.0)[1]
