"""Hard case 31: loads that are shorter, or faster, than a step."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from vofem.bodies import Mass
from vofem.effects import BaseMotion, PointLoad, Pulse, Sine, Tabulated, TimeFunction
from vofem.scene import Scene
from vofem.verification.case import Case, Quantity, Run, exact, stepping

Array = NDArray[np.float64]

#: Angular frequency of a mass of 1 kg on 4 N/m, 1/s.
_OMEGA = 2.0

#: Step of all stepping methods, ten times as long as the loads.
_DT = 0.01

#: When displacements are compared, s.
_TIMES = (6.0, 8.0, 10.0)

#: Begin in s, width in s and height of the pulse and of the spikes.
_BEGIN, _WIDTH, _HEIGHT = 5.0123, 1e-3, 1000.0

#: Angular frequency of the fast sine, 1/s: with steps of 0.01 s its values pass for a slow motion near resonance.
_FAST = 630.3


def cases() -> Iterator[Case]:
    """Yield the cases."""
    corners = np.array([0.0, _BEGIN, _BEGIN + 0.5 * _WIDTH, _BEGIN + _WIDTH, 10.0])
    spike = Tabulated(corners, np.array([0.0, 0.0, _HEIGHT, 0.0, 0.0]))
    yield _case("pulse of 1 ms", Pulse(_HEIGHT, _BEGIN, _WIDTH), _pulse, 1e-3)
    yield _case("spike of 1 ms in a table", spike, _spike, 1e-3)
    yield _case("spike of 1 ms in the motion of the base", spike, lambda t: -_spike(t), 1e-3, base=True)
    yield _case("sine faster than the step", Sine(100.0, _FAST), _sine, 1e-3)


def _case(name: str, load: TimeFunction, right: Callable[[Array], Array], within: float, base: bool = False) -> Case:
    """Return a case of an oscillator under a load in N, or on a base with an acceleration in m/s^2."""
    names = [f"displacement at {t:g} s [m]" for t in _TIMES]

    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0, stiffness=_OMEGA**2)
        effect = BaseMotion(mass, load) if base else PointLoad(mass, load)
        found = run.simulate(Scene([mass], [effect]), 10.0, times=[0.0, *_TIMES]).displacement(mass)[1:]
        return dict(zip(names, found.tolist(), strict=True))

    values = right(np.array(_TIMES)).tolist()
    quantities = tuple(Quantity(*pair, relative=False) for pair in zip(names, values, strict=True))
    how = exact(1e-9) | stepping(_DT, within, says=r"^load: .* less than a step")
    return Case(31, name, "closed form", quantities, measure, how)


def _pulse(t: Array) -> Array:
    """Return the displacement in m after the pulse; sums of cosines are written as products, which lose no digits."""
    middle = t - (_BEGIN + 0.5 * _WIDTH)
    return 2.0 * _HEIGHT / _OMEGA**2 * np.sin(0.5 * _OMEGA * _WIDTH) * np.sin(_OMEGA * middle)


def _spike(t: Array) -> Array:
    """Return the displacement in m after a triangle, which is the convolution of two pulses of half its width."""
    middle = t - (_BEGIN + 0.5 * _WIDTH)
    share = np.sin(0.25 * _OMEGA * _WIDTH) / (0.25 * _OMEGA * _WIDTH)
    return 0.5 * _HEIGHT * _WIDTH / _OMEGA * share**2 * np.sin(_OMEGA * middle)


def _sine(t: Array) -> Array:
    """Return the displacement in m of a mass at rest at t = 0 under the fast sine."""
    return 100.0 / (_OMEGA**2 - _FAST**2) * (np.sin(_FAST * t) - _FAST / _OMEGA * np.sin(_OMEGA * t))
