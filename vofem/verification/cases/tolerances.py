"""Hard case 32: a free mass between two stops so stiff that impacts are far shorter than what a tolerance suggests."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from vofem.bodies import Mass
from vofem.effects import Contact
from vofem.scene import Scene
from vofem.verification.case import ALPHA, CENTRAL, CONSERVING, REFUSED, Case, How, Quantity, Run, exact

#: Gap on both sides, m, and end of the run, s. The speed is 1 m/s.
_GAP, _T_END = 0.5, 9.7

#: Tolerance of the steps.
_TOL = 1e-4


def cases() -> Iterator[Case]:
    """Yield the cases."""
    for stiffness in (1e4, 1e6, 1e8, 1e12):
        yield _case(stiffness)


def _case(stiffness: float) -> Case:
    omega = np.sqrt(stiffness)
    touch, deepest = np.pi / omega, _GAP + 1.0 / omega

    def measure(run: Run) -> Mapping[str, float]:
        mass = Mass(1.0)
        stops = [
            Contact(mass, gap=_GAP, stiffness=stiffness, side=side, acts_on="penetration", name=side)
            for side in ("above", "below")
        ]
        # A time within the last contact is included, because the displacement is largest there.
        times = np.append(np.linspace(0.0, _T_END, 1001), _GAP + 0.5 * touch)
        result = run.simulate(Scene([mass], stops, initial={mass: (0.0, 1.0)}), _T_END, times=np.sort(times))
        return {
            "displacement at the end [m]": float(result.displacement(mass)[-1]),
            "largest displacement [m]": float(np.max(np.abs(result.displacement(mass)))),
            "largest speed [m/s]": float(np.max(np.abs(result.velocity(mass)))),
        }

    # The motion from one stop to the other takes one second and the duration of a contact.
    crossings, since = divmod(_T_END - _GAP, 2.0 * _GAP + touch)
    inside = _GAP + np.sin(omega * since) / omega if since < touch else _GAP - (since - touch)
    quantities = (
        Quantity("displacement at the end [m]", (-1.0) ** crossings * inside, relative=False),
        Quantity("largest displacement [m]", deepest, relative=False),
        Quantity("largest speed [m/s]", 1.0, relative=False),
    )
    within = _TOL * deepest
    speed = {"displacement at the end [m]": within, "largest displacement [m]": within, "largest speed [m/s]": 1e-3}
    how = exact(1e-8) | {CONSERVING: How(speed, {"tol": _TOL})}
    how |= {ALPHA: How(speed, {"tol": _TOL})}
    # This method has no steps under a tolerance, and refuses the argument.
    how |= {CENTRAL: How(0.0, {"tol": _TOL}, REFUSED, "tol was given")}
    return Case(32, f"free mass between stops of {stiffness:.0e} N/m, tol = {_TOL:g}", "closed form", quantities,
                measure, how)  # fmt: skip
