"""Orbits in which a body bounces on a rigid stop until it rests there, against a motion computed from its rest on.

For x'' + 2 z x' + x = F sin(w t) + P with a stop at x = g, a body at rest is let go where F sin(w t) = g - P. What
follows is known in closed form up to each impact, whose time a root search finds.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

import vofem as vf

Z, E, F, P, G = 0.05, 0.6, 1.0, 0.4, 0.1


def shaken(omega: float, press: float = P, restitution: float = E) -> vf.Scene:
    """Return a mass that is pressed on a stop and shaken."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=2.0 * Z, name="mass")
    stop = vf.RigidStop(mass, gap=G, restitution=restitution, side="above", name="stop")
    return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(F, omega)), vf.PointLoad(mass, press)])


def bounced(omega: float, least: float = 1e-2) -> tuple[np.ndarray, float]:
    """Return the speeds of the impacts after a rest that are faster than a least one, and the smallest displacement."""
    matrix = np.array([[0.0, 1.0], [-1.0, -2.0 * Z]])
    response = F / complex(1.0 - omega**2, 2.0 * Z * omega)

    def forced(t: float) -> np.ndarray:
        turned = response * np.exp(1j * omega * t)
        return np.array([turned.imag + P, (1j * omega * turned).imag])

    time, state = (np.pi - np.arcsin((G - P) / F)) / omega, np.array([G, 0.0])
    speeds, lowest = [], G
    while not speeds or speeds[-1] > least:
        begun, free = time, state - forced(time)

        def moved(t: float, begun: float = begun, free: np.ndarray = free) -> np.ndarray:
            return expm(matrix * (t - begun)) @ free + forced(t)

        step = 1e-3 * max(speeds[-1] if speeds else 1.0, 1e-3)
        now = time + step
        while moved(now)[0] < G:
            before, now = now, now + step
        for one, other in zip(np.linspace(time, now, 400)[:-1], np.linspace(time, now, 400)[1:], strict=True):
            if moved(one)[1] < 0.0 < moved(other)[1]:
                lowest = min(lowest, moved(brentq(lambda t: moved(t)[1], one, other, xtol=1e-15))[0])
        time = brentq(lambda t: moved(t)[0] - G, before, now, xtol=1e-15)
        approach = moved(time)[1]
        speeds.append(approach)
        state = np.array([G, -E * approach])
    return np.array(speeds[:-1]), lowest


@pytest.fixture(scope="module")
def up() -> vf.Branch:
    return vf.continuation(shaken, 0.2, 0.5)


def test_a_branch_of_orbits_that_come_to_rest_arrives_in_both_directions(up: vf.Branch) -> None:
    down = vf.continuation(shaken, 0.5, 0.2)
    for branch, end in ((up, 0.5), (down, 0.2)):
        assert branch.values[-1] == end
        assert not branch.notes
        assert not branch.special
        assert max(orbit.residual for orbit in branch.orbits) < 1e-9
    for omega in (0.25, 0.41):
        (one,), (other,) = up.at(omega), down.at(omega)
        np.testing.assert_allclose(one.extremes(one.scene.bodies[0]), other.extremes(other.scene.bodies[0]), rtol=1e-10)


@pytest.mark.parametrize("omega", [0.23, 0.31, 0.47])
def test_each_orbit_has_the_impacts_of_the_motion_from_its_rest(up: vf.Branch, omega: float) -> None:
    (orbit,) = up.at(omega)
    speeds, lowest = bounced(omega)
    found = orbit.result.contacts["stop"].impacts.approach_speed
    first = int(np.argmin(np.abs(found - speeds[0])))
    np.testing.assert_allclose(np.roll(found, -first)[: speeds.size], speeds, rtol=1e-9)
    np.testing.assert_allclose(orbit.extremes(orbit.scene.bodies[0]), (lowest, G), rtol=1e-9)
    assert orbit.stable is True
    # What rests forgets all that was before.
    assert np.abs(orbit.multipliers).max() < 1e-12


def test_where_no_rest_is_left_special_points_accumulate_and_a_note_says_so() -> None:
    """Grazings approach that place like a geometric series (Dankowicz and Fotsch 2017); from below it is passed."""
    up = vf.continuation(lambda omega: shaken(omega, 0.1, 0.3), 0.94, 0.98)
    down = vf.continuation(lambda omega: shaken(omega, 0.1, 0.3), 0.98, 0.953)
    assert (up.values[-1], down.values[-1]) == (0.98, 0.953)
    (note,) = up.notes
    assert note.startswith("near 0.9524")
    assert "'stop' become infinitely many" in note
    assert not down.notes
    found = [sorted((m.kind, m.value) for m in branch.special if m.value > 0.953) for branch in (up, down)]
    assert [kind for kind, _ in found[0]] == ["fold"] * 3 + ["grazing"] * 3
    np.testing.assert_allclose([v for _, v in found[0]], [v for _, v in found[1]], rtol=0.0, atol=1e-9)
    grazings = np.array([m.value for m in up.special if m.kind == "grazing"])
    np.testing.assert_allclose(np.diff(grazings)[:-1] / np.diff(grazings)[1:], 0.3, rtol=0.05)


def test_a_branch_does_not_end_where_the_state_at_t_0_comes_close_to_the_first_one() -> None:
    branch = vf.continuation(lambda omega: shaken(omega, 0.4, 0.7), 0.1, 0.5, max_points=20)
    assert not any("closed" in note for note in branch.notes)
    assert len(branch.values) == 20


@pytest.mark.parametrize("ends", [(0.27115, 0.271244), (0.271244, 0.27115)])
def test_a_body_that_leaves_its_stop_for_a_moment_is_followed(ends: tuple[float, float]) -> None:
    """A second mass swings on while the first one rests. From 0.27124 rad/s on it lifts that off, first for no time."""

    def build(omega: float) -> vf.Scene:
        a, b = vf.Mass(1.0, stiffness=1.0, damping=0.0713, name="a"), vf.Mass(0.5, name="b")
        stop = vf.RigidStop(a, gap=0.196, restitution=0.62, side="above", name="stop")
        between = [vf.Spring(a, b, stiffness=2.0), vf.Dashpot(a, b, damping=0.1)]
        return vf.Scene([a, b], [*between, stop, vf.PointLoad(b, vf.Sine(0.4158, omega)), vf.PointLoad(a, 0.4364)])

    branch = vf.continuation(build, *ends)
    assert branch.values[-1] == ends[1]
    assert max(orbit.residual for orbit in branch.orbits) < 1e-8
    rests = [len(branch.at(value)[0].result.contacts["stop"].pinned) for value in (0.2712, 0.271243)]
    assert rests == [1, 2]
