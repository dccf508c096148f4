"""A mass on a spring and a springpot, beside the solution in Mittag-Leffler functions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from vofem.bodies import Mass
from vofem.effects import Constant, PointLoad, Springpot
from vofem.scene import Scene
from vofem.verification.case import CONSERVING, EVENT_DRIVEN, REFUSED, Case, How, Quantity, Run, stepping

#: Mass in kg, coefficient in N s^(1/2)/m and stiffness in N/m.
MASS, COEFFICIENT, STIFFNESS = 1.0, 0.7, 4.0

_SOURCE = (
    "Mittag-Leffler functions of order 1/2, by R. L. Bagley, P. J. Torvik, AIAA J. 21 (1983) 741, "
    "https://doi.org/10.2514/3.8142"
)


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _case("released", 1.0, 0.0, 0.0)
    yield _case("struck", 0.0, 1.0, 0.0)
    yield _case("loaded", 0.0, 0.0, 1.0)


def displacement(t: float, u0: float, v0: float, force: float) -> float:
    """Return the displacement in m of the oscillator at rest before t = 0, under a constant force in N.

    With ``z = sqrt(s)`` the transform is a rational function of z, a sum of
    poles ``1/(z - r)``, each of which is ``1/sqrt(pi t) + r E_{1/2}(r sqrt(t))``.
    """
    from scipy.special import wofz

    # The displacement from the place where the force of the spring is that of the load.
    start = u0 - force / STIFFNESS
    bottom = np.array([MASS, 0.0, 0.0, COEFFICIENT, STIFFNESS])
    roots = np.roots(bottom)
    slopes = np.polyval(np.polyder(bottom), roots)
    # A pole at z = 0 adds nothing: its function is the first one, and these cancel in the sum of all poles.
    top = MASS * (start * roots**2 + v0) + COEFFICIENT * start / roots
    functions = wofz(-1j * roots * np.sqrt(t))
    return force / STIFFNESS + float(np.sum(top / slopes * roots * functions).real)


def _case(name: str, u0: float, v0: float, force: float) -> Case:
    times = np.array([0.5, 2.0, 6.0])

    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(MASS, stiffness=STIFFNESS)
        springpot = Springpot(mass, coefficient=COEFFICIENT, order=0.5, name="springpot")
        scene = Scene([mass], [springpot, PointLoad(mass, Constant(force))], initial={mass: (u0, v0)})
        result = run.simulate(scene, 6.0, times=np.append(0.0, times))
        found = result.displacement(mass)[1:]
        return {f"displacement at {t:g} s [m]": float(u) for t, u in zip(times, found, strict=True)}

    quantities = tuple(
        Quantity(f"displacement at {t:g} s [m]", displacement(t, u0, v0, force), relative=False) for t in times
    )
    how = stepping(1e-3, 5e-6) | {EVENT_DRIVEN: How(expected=REFUSED, says=CONSERVING)}
    return Case(None, f"fractional oscillator of order 1/2, {name}", _SOURCE, quantities, measure, how)
