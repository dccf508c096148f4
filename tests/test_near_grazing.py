"""Special points that lie next to a grazing, the nearer the stiffer the stop.

Just beyond a grazing the value of the parameter changes by ``a r^2 + b r^3`` with the rate r at which the stop is met:
the depth of the touch is as r^2, its impulse as the stiffness K times r^3. So b grows with K, the fold lies at
``r = -2 a/(3 b)``, and its distance from the grazing falls as 1/K^2.
"""

import numpy as np
import pytest
from orbit_scenes import nlvib_03
from populations import away
from scenes import cantilever
from scipy.interpolate import CubicHermiteSpline

import vofem as vf


def followed(stiffness, start, stop):
    scene = nlvib_03(start)
    free = vf.Scene(scene.bodies, [effect for effect in scene.effects if effect not in scene.contacts])
    branch = vf.continuation(
        lambda omega: nlvib_03(omega, stiffness=stiffness), start, stop, guess=vf.periodic(free), max_points=28
    )
    first = branch.special[0]
    assert first.kind == "grazing"
    return branch, first.value


def test_a_fold_less_than_a_trillionth_from_a_grazing():
    """The branch goes through both: it comes back on orbits that hit the stop, not on those that it came from."""
    distances = []
    for stiffness in (1e2, 1e4):
        branch, grazed = followed(stiffness, 0.655, 0.65)
        assert grazed == pytest.approx(0.6534401404162605, abs=1e-13)
        fold = branch.special[1]
        assert fold.kind == "fold"
        distances.append(grazed - fold.value)
        # The fold lies on the impacting side, and the branch turns there once.
        assert branch.values[-1] > grazed + 1e-5
        beyond = branch.orbits[-1]
        assert beyond.result.contacts["stop"].closings.size == 1
        assert np.min(np.abs(fold.orbit.multipliers - 1.0)) < 1e-5
    assert distances[-1] < 1e-12
    assert distances[0] == pytest.approx(5.867e-9, rel=1e-3)
    assert distances[0] == pytest.approx(1e4 * distances[1], rel=2e-3)


def test_a_pair_leaves_the_unit_circle_and_becomes_real_within_one_step():
    """Neimark-Sacker points come as near, and the pair returns through -1 before the next orbit of the branch."""
    distances = []
    for stiffness in (1e3, 1e4):
        branch, grazed = followed(stiffness, 0.57, 0.583)
        pair, flip = branch.special[1:3]
        assert (pair.kind, flip.kind) == ("neimark_sacker", "period_doubling")
        distances.append(pair.value - grazed)
        nearest = pair.orbit.multipliers[np.argmin(np.abs(np.abs(pair.orbit.multipliers) - 1.0))]
        assert abs(nearest) == pytest.approx(1.0, abs=1e-9)
        assert abs(nearest.imag) > 0.1
    assert distances[0] == pytest.approx(100.0 * distances[1], rel=2e-2)


def test_orbits_that_do_not_repeat_are_not_on_a_branch():
    """Two touches that merge: coordinates at an event that ignore other events near it follow orbits that are none."""
    beam = cantilever(2, name="beam")
    point = beam.at(0.6)
    rest = [
        vf.Contact(point, gap=0.00525, stiffness=43000.0, side="above", acts_on="penetration", name="stop"),
        vf.ModalDamping(0.0067),
    ]

    def build(omega):
        return vf.Scene([beam], [*rest, vf.PointLoad(point, vf.Sine(0.00378, omega))])

    displacement, velocity = (
        CubicHermiteSpline([0.0, 0.5, 1.0], values, slopes)
        for values, slopes in (
            ([0.0, -0.00198045845, -0.00555971621], [0.0, -0.00647400334, -0.00737331544]),
            ([0.0, 0.0192928820, 0.0315096969], [0.0, 0.0350380457, 0.0346506882]),
        )
    )
    branch = vf.continuation(build, 3.601837122, 3.6, guess={beam: (displacement, velocity)})
    assert len(branch) > 10
    assert max(away(orbit) for orbit in branch.orbits) < 1e-8
    assert max(away(special.orbit) for special in branch.special) < 1e-8


@pytest.mark.parametrize("share", [0.99, 0.9999, 1.0 - 1e-7])
@pytest.mark.parametrize("ends", [(0.5, 1.7), (1.7, 0.5)])
def test_a_touch_that_begins_and_ends_within_one_step(share, ends):
    """The linear response of a mass reaches the gap near its peak alone, between two values in closed form."""
    damping = 0.1
    # Frequencies at which 1 / |1 - w^2 + 2 i damping w| is the gap.
    peak = 0.5 / (damping * np.sqrt(1.0 - damping**2))
    middle, half = 1.0 - 2.0 * damping**2, np.sqrt((1.0 - 2.0 * damping**2) ** 2 - 1.0 + 1.0 / (share * peak) ** 2)
    expected = np.sqrt([middle - half, middle + half])
    mass = vf.Mass(1.0, stiffness=1.0, damping=2.0 * damping, name="mass")
    stop = vf.Contact(mass, gap=share * peak, stiffness=10.0, side="above", acts_on="penetration", name="stop")
    branch = vf.continuation(lambda w: vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, w))]), *ends)
    found = [special.value for special in branch.special if special.kind == "grazing"]
    assert sorted(found) == pytest.approx(expected, abs=1e-9)
    assert branch.values[-1] == ends[1]
