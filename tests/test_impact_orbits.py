"""Orbits with impacts on rigid stops, against the closed forms of the impact oscillator.

For x'' + 2 z x' + x = sin(w t) with a stop at x = g, the orbits with one impact an orbit of n periods are known
(S. W. Shaw, P. J. Holmes, J. Sound Vib. 90 (1983) 129). With the transition P of the free motion over the orbit, the
forced response (p, q) and the speed of approach V at the impact,

    P (g - p, -e V - q) = (g - p, V - q),

so that (g - p, -q) = V (a, b). The amplitude of the response, p^2 + (q/w)^2 = R^2, is then a quadratic equation for V.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import expm

import vofem as vf

Z, E = 0.05, 0.7


def oscillator(omega: float, gap: float, restitution: float = E) -> vf.Scene:
    """Return the impact oscillator."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=2.0 * Z, name="mass")
    stop = vf.RigidStop(mass, gap=gap, restitution=restitution, side="above", name="stop")
    return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, omega))])


class Closed(NamedTuple):
    """The closed form for one impact an orbit of n periods: V = ratio g at multiplier 1 or -1, and what it needs."""

    omega: float
    transition: np.ndarray
    a: float
    b: float

    @property
    def amplitude(self) -> float:
        """Amplitude of the forced response."""
        return float(1.0 / np.hypot(1.0 - self.omega**2, 2.0 * Z * self.omega))

    def speeds(self, gap: float) -> np.ndarray:
        """Return both speeds of approach, ascending."""
        square = self.a**2 + (self.b / self.omega) ** 2
        return np.sort(np.roots([square, -2.0 * self.a * gap, gap**2 - self.amplitude**2]))

    def _trace(self, gap: float) -> tuple[float, float]:
        """Return constants of the trace of the monodromy matrix, ``c0 + c1/V``."""
        turned = (1.0 + E) * self.transition[0, 1]
        push = self.a * (1.0 - self.omega**2) + 2.0 * Z * self.b
        return -E * float(np.trace(self.transition)) - turned * push, -turned * gap * self.omega**2

    def multipliers(self, gap: float, speed: float) -> np.ndarray:
        """Return the multipliers of the orbit, the larger one first."""
        constant, pole = self._trace(gap)
        found = np.roots([1.0, -(constant + pole / speed), E**2 * np.linalg.det(self.transition)])
        return found[np.argsort(-np.abs(found))]

    def gap_at(self, multiplier: float) -> float:
        """Return the gap, positive with V, at which a multiplier is 1 or -1."""
        constant, pole = self._trace(1.0)
        ratio = pole / (multiplier * (1.0 + E**2 * np.linalg.det(self.transition)) - constant)
        sign = np.sign(ratio)
        return float(sign * self.amplitude / np.hypot(1.0 - self.a * ratio, self.b * ratio / self.omega))


def closed(omega: float, periods: int = 1) -> Closed:
    """Return the closed form."""
    transition = expm(np.array([[0.0, 1.0], [-1.0, -2.0 * Z]]) * 2.0 * np.pi * periods / omega)
    kick = np.array([0.0, 1.0])
    a, b = np.linalg.solve(transition - np.eye(2), kick + E * transition @ kick)
    return Closed(omega, transition, float(a), float(b))


def assert_closed(orbit: vf.PeriodicOrbit, known: Closed, gap: float) -> None:
    """Check speed and multipliers of an orbit with one impact."""
    speed = orbit.result.contacts["stop"].impacts.approach_speed
    assert len(speed) == 1
    expected = min(known.speeds(gap), key=lambda v: abs(v - speed[0]))
    assert expected > 0.0
    np.testing.assert_allclose(speed[0], expected, rtol=1e-11)
    multipliers = np.asarray(orbit.multipliers)
    np.testing.assert_allclose(
        multipliers[np.argsort(-np.abs(multipliers))], known.multipliers(gap, speed[0]), rtol=1e-10
    )


@pytest.mark.parametrize("gap", [0.1, -0.2])
def test_an_orbit_with_one_impact_is_that_of_the_closed_form(gap: float) -> None:
    """At a gap of 0.1 it is unstable: a multiplier of -3.8; at -0.2 it is stable, and the spring presses it on."""
    orbit = vf.periodic(oscillator(2.6, gap))
    assert_closed(orbit, closed(2.6), gap)
    assert orbit.residual < 1e-12
    assert orbit.stable is (gap < 0.0)


@pytest.mark.parametrize("ends", [(0.5, -0.3), (-0.3, 0.5)])
def test_a_branch_passes_the_grazing_and_the_doubling_in_both_directions(ends: tuple[float, float]) -> None:
    """The impacting orbits begin at the amplitude of the free response, unstable, and double at a known gap."""
    known = closed(2.6)
    branch = vf.continuation(lambda gap: oscillator(2.6, gap), *ends)
    marks = {mark.kind: mark.value for mark in branch.special}
    assert sorted(mark.kind for mark in branch.special) == ["grazing", "period_doubling"]
    assert marks["grazing"] == pytest.approx(known.amplitude, rel=1e-13)
    assert marks["period_doubling"] == pytest.approx(known.gap_at(-1.0), rel=1e-11)
    for gap in (0.15, 0.05, -0.1):
        (orbit,) = branch.at(gap)
        assert_closed(orbit, known, gap)
    (free,) = branch.at(0.4)
    assert free.result.contacts["stop"].impacts.approach_speed.size == 0


def test_a_branch_turns_at_its_fold_and_comes_back_to_the_grazing() -> None:
    """Below resonance large impacts and the free response exist side by side, and an unstable orbit between them."""
    omega = 1.7
    known = closed(omega)
    branch = vf.continuation(lambda gap: oscillator(omega, gap), 0.3, 1.2)
    assert [mark.kind for mark in branch.special] == ["fold", "grazing"]
    assert branch.special[0].value == pytest.approx(known.gap_at(1.0), rel=1e-12)
    assert branch.special[1].value == pytest.approx(known.amplitude, rel=1e-13)
    fast, slow, free = branch.at(0.8)
    for orbit in (fast, slow):
        assert_closed(orbit, known, 0.8)
    assert [orbit.stable for orbit in (fast, slow, free)] == [True, False, True]


def test_an_orbit_over_two_periods_is_found_from_rest() -> None:
    """One impact in two periods: its doubling and its fold are those of the closed form."""
    omega = 4.4
    known = closed(omega, 2)
    orbit = vf.periodic(oscillator(omega, 0.0), periods=2)
    assert_closed(orbit, known, 0.0)
    up = vf.continuation(lambda gap: oscillator(omega, gap), 0.0, 0.2, guess=orbit, periods=2)
    assert [mark.kind for mark in up.special] == ["period_doubling", "grazing", "grazing"]
    assert up.special[0].value == pytest.approx(known.gap_at(-1.0), rel=1e-11)
    # Both peaks of the free response touch at once, and more than one branch begins there.
    assert up.special[1].value == pytest.approx(known.amplitude, rel=1e-13)
    assert "one orbit grazes 'stop' several times" in up.notes[0]
    down = vf.continuation(lambda gap: oscillator(omega, gap), 0.0, -0.2, guess=orbit, periods=2, max_points=60)
    assert [mark.kind for mark in down.special][:2] == ["fold", "grazing"]
    assert down.special[0].value == pytest.approx(known.gap_at(1.0), rel=1e-12)
    # Beyond the grazing the stop is hit twice.
    assert len(down.orbits[-1].result.contacts["stop"].impacts) == 2
    assert down.orbits[-1].residual < 1e-8


def test_loci_of_grazings_and_doublings_follow_the_closed_form() -> None:
    """Both special points over the frequency as well."""
    branch = vf.continuation(lambda gap: oscillator(2.6, gap), 0.3, -0.1)
    other = closed(2.4)
    for mark, expected in zip(branch.special, (other.amplitude, other.gap_at(-1.0)), strict=True):
        locus = vf.locus(lambda gap, omega: oscillator(omega, gap), mark, 2.6, 2.4)
        np.testing.assert_allclose(locus.values[-1], [expected, 2.4], rtol=1e-10)


def test_a_mass_that_a_jump_of_force_lets_go_of_has_the_multipliers_of_its_run() -> None:
    """One mass rests at its stop until another one meets it under the displacement law and pushes it off at once."""
    period = 2.0 * np.pi / 4.5

    def pushed(amplitude: float) -> vf.Scene:
        rests = vf.Mass(1.0, stiffness=30.0, damping=2.5, name="rests")
        moves = vf.Mass(0.9, stiffness=25.0, damping=0.8, name="moves")
        stop = vf.RigidStop(rests, gap=0.05, restitution=0.0, side="below", name="stop")
        jump = vf.Contact(moves, rests, gap=0.06, stiffness=90.0, acts_on="displacement", name="jump")
        loads = [vf.PointLoad(rests, vf.Constant(-4.0)), vf.PointLoad(moves, vf.Sine(amplitude, 4.5))]
        return vf.Scene([rests, moves], [stop, jump, *loads])

    def after(scene: vf.Scene, state: np.ndarray) -> tuple[np.ndarray, vf.Result]:
        rests, moves = scene.bodies
        run = vf.simulate(
            scene, period, method="event_driven", times=np.array([period]),
            initial={rests: (-0.05, 0.0), moves: tuple(state)},
        )  # fmt: skip
        return np.array([run.displacement(moves)[-1], run.velocity(moves)[-1]]), run

    settled = vf.simulate(pushed(2.0), 40.0 * period, method="event_driven", times=np.array([40.0 * period]))
    branch = vf.continuation(pushed, 2.0, 2.3, guess=settled)
    assert not branch.notes
    for orbit, amplitude in ((branch.orbits[0], 2.0), (branch.orbits[-1], 2.3)):
        scene = pushed(amplitude)
        state = np.array(orbit.state_of("moves"), dtype=float).ravel()
        back, run = after(scene, state)
        assert back == pytest.approx(state, abs=1e-10)
        released = run.contacts["stop"].pinned[0, 1]
        assert released == run.contacts["jump"].closings[0]
        steps = 1e-6 * np.eye(2)
        change = np.array([(after(scene, state + d)[0] - after(scene, state - d)[0]) / 2e-6 for d in steps]).T
        expected = np.linalg.eigvals(change)
        found = orbit.multipliers[np.abs(orbit.multipliers) > 1e-9]
        assert np.sort_complex(found) == pytest.approx(np.sort_complex(expected), abs=1e-6)


def test_two_masses_that_one_jump_lets_go_of_have_the_multipliers_of_their_run() -> None:
    """The jump lifts one mass off the other, which its own load then lifts off the floor; both return in a period."""
    period = 2.0 * np.pi / 4.5
    low, high, moves = (
        vf.Mass(mass, stiffness=stiffness, damping=damping, name=name)
        for mass, stiffness, damping, name in (
            (1.0, 30.0, 2.5, "low"), (0.8, 20.0, 2.0, "high"), (0.9, 25.0, 0.8, "moves"),
        )
    )  # fmt: skip
    floor = vf.RigidStop(low, gap=0.0, restitution=0.0, side="below", name="floor")
    between = vf.RigidStop(low, high, gap=0.0, restitution=0.0, name="between")
    jump = vf.Contact(moves, high, gap=0.1, stiffness=90.0, acts_on="displacement", name="jump")
    pushes = vf.Constant(0.6), vf.Constant(-2.0), vf.Sine(2.0, 4.5)
    loads = [vf.PointLoad(mass, push) for mass, push in zip((low, high, moves), pushes, strict=True)]
    scene = vf.Scene([low, high, moves], [floor, between, jump, *loads])

    def after(state: np.ndarray) -> tuple[np.ndarray, vf.Result]:
        initial = {low: (0.0, 0.0), high: (0.0, 0.0), moves: tuple(state)}
        run = vf.simulate(scene, period, method="event_driven", times=np.array([period]), initial=initial)
        return np.array([run.displacement(moves)[-1], run.velocity(moves)[-1]]), run

    settled = vf.simulate(scene, 40.0 * period, method="event_driven", times=np.array([40.0 * period]))
    orbit = vf.periodic(scene, guess=settled)
    state = np.array(orbit.state_of("moves"), dtype=float).ravel()
    back, run = after(state)
    assert back == pytest.approx(state, abs=1e-10)
    lifted = [run.contacts[name].pinned[0, 1] for name in ("between", "floor")]
    assert lifted == [run.contacts["jump"].closings[0]] * 2
    steps = 1e-6 * np.eye(2)
    change = np.array([(after(state + d)[0] - after(state - d)[0]) / 2e-6 for d in steps]).T
    found = orbit.multipliers[np.abs(orbit.multipliers) > 1e-9]
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(np.linalg.eigvals(change)), abs=1e-6)


@pytest.mark.parametrize(
    ("change", "start", "stop"), [("gap", 0.1, 0.11), ("gap", 0.1, 0.09), ("restitution", 0.6, 0.5)]
)
def test_a_locus_of_grazings_is_that_of_branches_beside_it(change: str, start: float, stop: float) -> None:
    """Rounding decides whether a run of such an orbit hits the stop that it grazes."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.08, name="m")

    def scene(omega: float, value: float) -> vf.Scene:
        stop = vf.RigidStop(mass, side="above", name="r", **{"gap": 0.1, "restitution": 0.6, change: value})
        return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, omega))])

    def grazing(value: float) -> vf.SpecialPoint:
        branch = vf.continuation(lambda omega: scene(omega, value), 0.9, 1.1)
        (found,) = [one for one in branch.special if one.kind == "grazing"]
        return found

    locus = vf.locus(scene, grazing(start), start, stop)
    assert not locus.notes
    assert locus.values[-1] == pytest.approx([grazing(stop).value, stop], rel=1e-12)


def test_an_elastic_contact_switches_at_an_impact() -> None:
    """An impact turns no other contact's motion: their order changes, and the branch goes on in the same direction."""

    def scene(gap: float) -> vf.Scene:
        a, b = vf.Mass(1.0, stiffness=1.0, damping=0.05, name="a"), vf.Mass(0.5, stiffness=0.8, damping=0.03, name="b")
        wall = vf.Contact(b, gap=gap, stiffness=10.0, side="above", acts_on="penetration", name="wall")
        stop = vf.RigidStop(a, b, gap=0.2, restitution=0.6, name="stop")
        return vf.Scene([a, b], [stop, wall, vf.Spring(a, b, stiffness=0.3), vf.PointLoad(a, vf.Sine(0.5, 1.1))])

    there = vf.continuation(scene, 1.0, 0.01)
    both = [there, vf.continuation(scene, 0.01, 1.0, guess=there.orbits[-1])]
    for branch, end in zip(both, (0.01, 1.0), strict=True):
        assert branch.values[-1] == end
        assert not branch.notes
        assert [one.kind for one in branch.special] == ["period_doubling"]
        assert branch.special[0].value == pytest.approx(0.6262318397706832, rel=1e-9)
    # The last impact comes after the wall is left, and beyond before it.
    first, last = (orbit.result.contacts for orbit in (both[0].orbits[0], both[0].orbits[-1]))
    assert first["wall"].openings[-1] < first["stop"].impacts.closing[-1]
    assert last["wall"].openings[-1] > last["stop"].impacts.closing[-1]


@pytest.mark.parametrize(("side", "gap", "kinds"), [("below", 0.3, 1), ("above", 0.55, 3)])
def test_an_impact_throws_a_body_against_an_elastic_contact(side: str, gap: float, kinds: int) -> None:
    """The gap has a corner at the impact: a touch around it begins with speeds on both sides, and no square root."""

    def scene(load: float, at: float = gap) -> vf.Scene:
        a, b = vf.Mass(1.0, stiffness=1.0, damping=0.08, name="a"), vf.Mass(0.5, stiffness=0.8, damping=0.05, name="b")
        wall = vf.Contact(b, gap=at, stiffness=30.0, side=side, acts_on="penetration", name="wall")
        stop = vf.RigidStop(a, b, gap=0.2, restitution=0.6, name="stop")
        return vf.Scene([a, b], [stop, wall, vf.Spring(a, b, stiffness=0.4), vf.PointLoad(a, vf.Sine(load, 1.1))])

    up = vf.continuation(scene, 0.25, 0.75)
    down = vf.continuation(scene, 0.75, 0.25, guess=up.orbits[-1])
    assert not up.notes
    assert not down.notes
    assert len(up.special) == kinds
    for one, other in zip(up.special, reversed(down.special), strict=True):
        assert (one.kind, one.contact) == (other.kind, other.contact)
        assert one.value == pytest.approx(other.value, rel=1e-9)
    (grazing,) = [one for one in up.special if one.contact == "wall"]
    locus = vf.locus(scene, grazing, gap, gap - 0.01)
    beside = vf.continuation(lambda load: scene(load, gap - 0.01), 0.25, 0.75)
    assert locus.values[-1, 1] == gap - 0.01
    assert locus.values[-1, 0] == pytest.approx(
        next(one.value for one in beside.special if one.contact == "wall"), rel=1e-12
    )
    touch = grazing.orbit.result
    hits = touch.contacts["stop"].impacts.closing
    height = {"above": 1.0, "below": -1.0}[side] * touch.displacement(touch.scene.bodies[1], hits)
    assert np.min(np.abs(height - gap)) < 1e-12


def test_a_long_step_to_a_grazing_of_a_rigid_stop_is_examined() -> None:
    """Downwards a Neimark-Sacker point lies between the last orbit before the grazing at 1.273 and that grazing."""
    a, b = vf.Mass(1.0, stiffness=1.0, damping=0.08, name="a"), vf.Mass(0.3118, stiffness=1.171, damping=0.05, name="b")
    wall = vf.Contact(b, gap=0.3721, stiffness=2.96, side="above", acts_on="penetration", name="wall")
    effects = [vf.RigidStop(a, b, gap=0.3036, restitution=0.7885, name="stop"), wall, vf.Spring(a, b, stiffness=0.4712)]

    def scene(load: float) -> vf.Scene:
        return vf.Scene([a, b], [*effects, vf.PointLoad(a, vf.Sine(0.564 * load, 0.9874))])

    up = vf.continuation(scene, 0.5, 1.5)
    down = vf.continuation(scene, 1.5, 0.5, guess=up.orbits[-1])
    assert len(up.special) == 36
    for one, other in zip(up.special, reversed(down.special), strict=True):
        assert one.kind == other.kind
        assert one.value == pytest.approx(other.value, rel=1e-8)
