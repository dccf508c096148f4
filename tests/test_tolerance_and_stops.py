"""Steps that follow a tolerance against stiff stops: closed forms, and motion that is exact between events."""

import numpy as np
import pytest
from scenes import between_stops, on_stop

import vofem as vf
from vofem.integrators.stepped import interpolated

METHOD = {"method": "energy_conserving"}


def to_and_fro(stiffness, law="penetration"):
    """Return a free mass of 1 kg that flies to and fro between two stops 0.5 m away, and its scene."""
    mass = vf.Mass(1.0, name="mass")
    return between_stops(mass, start=(0.0, 1.0), gap=0.5, stiffness=stiffness, acts_on=law)


def crushed(stiffness):
    """Return the same mass and scene with stops that could yield, which act as contacts within their linear limit."""
    mass = vf.Mass(1.0, name="mass")
    how = {"gap": 0.5, "stiffness": stiffness, "linear_limit": 1.0}
    stops = [vf.CrushingStop(mass, side=side, name=side, **how) for side in ("above", "below")]
    return mass, vf.Scene([mass], stops, {mass: (0.0, 1.0)})


def flight(t, stiffness):
    """Return the displacement between two stops under the penetration law: straight lines and half sines."""
    omega = np.sqrt(stiffness)
    touch = np.pi / omega
    # From one stop to the other, from the first closing on.
    period = 1.0 + touch
    since = np.mod(t - 0.5, period)
    side = np.where(np.floor((t - 0.5) / period) % 2 == 0, 1.0, -1.0)
    inside = 0.5 + np.sin(omega * np.minimum(since, touch)) / omega
    return np.where(t < 0.5, t, side * np.where(since < touch, inside, 0.5 - (since - touch)))


#: Hard case 32 of the catalogue has 1e4, 1e6, 1e8 and 1e12 N/m with a tolerance of 1e-4.
PAIRS = [*((stiffness, 1e-2) for stiffness in (1e2, 1e4, 1e8, 1e12)), (1e2, 1e-4)]


@pytest.mark.parametrize(("stiffness", "tol"), PAIRS)
def test_a_mass_between_two_stops(stiffness, tol):
    mass, scene = to_and_fro(stiffness)
    times = np.linspace(0.0, 5.7, 601)
    result = vf.simulate(scene, 5.7, tol=tol, times=times, **METHOD)
    right = flight(times, stiffness)
    assert np.max(np.abs(result.displacement(mass) - right)) < tol * np.max(np.abs(right))
    assert np.max(np.abs(result.velocity(mass))) < 1.0 + 1e-3
    assert result.notes == []
    # Flights cost next to nothing, however many impacts there are.
    assert result.counters.steps < 500 / np.sqrt(tol)


@pytest.mark.parametrize(("stiffness", "tol"), PAIRS)
def test_generalized_alpha_between_two_stops_is_right_or_told(stiffness, tol):
    mass, scene = to_and_fro(stiffness)
    times = np.linspace(0.0, 9.7, 1001)
    result = vf.simulate(scene, 9.7, tol=tol, times=times, method="generalized_alpha")
    right = flight(times, stiffness)
    off = np.max(np.abs(result.displacement(mass) - right)) / np.max(np.abs(right))
    assert off < 5.0 * tol or any(note.startswith("tol: displacements may") for note in result.notes)
    # Where the stop is stiff, rounding decides whether the coarser run stays as near.
    assert tol > 1e-3 or (off < 5.0 * tol and (stiffness > 1e4 or result.notes == []))
    assert np.max(np.abs(result.velocity(mass))) < 1.0 + 1e-3
    assert result.counters.steps < 200 / np.sqrt(tol)


@pytest.mark.parametrize("stiffness", [1e4, 1e8])
def test_the_jump_law_between_two_stops(stiffness):
    mass, scene = to_and_fro(stiffness, "displacement")
    times = np.linspace(0.0, 9.7, 501)
    exact = vf.simulate(scene, 9.7, times=times).displacement(mass)
    result = vf.simulate(scene, 9.7, tol=1e-4, times=times, **METHOD)
    assert np.max(np.abs(result.displacement(mass) - exact)) < 1e-4 * np.max(np.abs(exact))
    assert result.counters.steps < 20_000


@pytest.mark.parametrize("made", [to_and_fro, crushed])
def test_samples_between_stored_times_stay_in_front_of_the_stop(made):
    _, scene = made(1e8)
    result = vf.simulate(scene, 4.0, tol=1e-4, times=np.linspace(0.0, 4.0, 401), **METHOD)
    t = np.linspace(0.0, 4.0, 7919)
    assert np.max(np.abs(result.solution.sample(t).q)) < 0.5 + 1.1e-4


@pytest.mark.parametrize("law", ["penetration", "displacement"])
@pytest.mark.parametrize("stiffness", [1e4, 1e8])
def test_masses_that_hit_each_other_and_stops(law, stiffness):
    """Before the first event that magnifies an error; event_driven is exact."""
    first, second = vf.Mass(1.0, name="first"), vf.Mass(2.3, stiffness=40.0, name="second")
    how = {"stiffness": stiffness, "acts_on": law}
    effects = [
        vf.Contact(first, second, gap=0.2, name="between", **how),
        vf.Contact(first, gap=0.5, side="below", name="floor", **how),
        vf.Contact(second, gap=0.3, side="above", name="ceiling", **how),
        vf.Gravity(9.81),
    ]
    scene = vf.Scene([first, second], effects, {first: (0.0, 1.0), second: (0.0, -0.4)})
    times = np.linspace(0.0, 0.8, 161)
    exact = vf.simulate(scene, 0.8, times=times)
    assert exact.counters.events > 5
    size = np.max(np.abs(exact.displacement(second)))
    for tol in (1e-2, 1e-4):
        result = vf.simulate(scene, 0.8, tol=tol, times=times, **METHOD)
        for body in (first, second):
            assert np.max(np.abs(result.displacement(body) - exact.displacement(body))) < 10.0 * tol * size


def test_a_damped_stop():
    mass = vf.Mass(1.0, name="mass")
    stop = vf.Contact(
        mass, gap=0.0, stiffness=1e8, damping=2e3, side="below", acts_on="penetration", name="floor"
    )  # fmt: skip
    scene = vf.Scene([mass], [stop, vf.Gravity(9.81)], {mass: (0.5, 0.0)})
    times = np.linspace(0.0, 1.5, 301)
    exact = vf.simulate(scene, 1.5, times=times).displacement(mass)
    result = vf.simulate(scene, 1.5, tol=1e-4, times=times, **METHOD)
    assert np.max(np.abs(result.displacement(mass) - exact)) < 1e-4 * 0.5
    assert result.contacts["floor"].closings.size > 3


@pytest.mark.parametrize("resolution", [1e4, 1e6])
def test_a_resolved_switch(resolution):
    """A stiff stop whose switch is smooth gives the speed back, and is left after the time that its own law takes."""
    from scipy.integrate import solve_ivp

    from vofem.fractional.constants import resolved

    mass, stiffness = vf.Mass(1.0, name="mass"), 1e6
    stop = vf.Contact(
        mass, gap=0.5, stiffness=stiffness, side="above", acts_on="penetration", switch=vf.Resolved(resolution),
        name="stop",
    )  # fmt: skip
    times = np.linspace(0.0, 3.0, 301)
    result = vf.simulate(vf.Scene([mass], [stop], {mass: (0.0, 1.0)}), 3.0, tol=1e-4, times=times, **METHOD)

    def motion(t, y):
        s = y[0] - 0.5
        return [y[1], -float(resolved(stiffness, np.array(s), resolution)) * s if s > 0.0 else 0.0]

    right = solve_ivp(motion, (0.0, 3.0), [0.0, 1.0], t_eval=times, rtol=1e-10, atol=1e-12, max_step=1e-3).y[0]
    assert np.max(np.abs(result.displacement(mass) - right)) < 1e-4 * np.max(np.abs(right))


@pytest.mark.parametrize(("stiffness", "tol"), [(1e2, 1e-2), (1e4, 1e-4), (1e8, 1e-2), (1e8, 1e-4)])
def test_a_mass_between_two_stops_that_could_yield(stiffness, tol):
    mass, scene = crushed(stiffness)
    times = np.linspace(0.0, 3.7, 401)
    result = vf.simulate(scene, 3.7, tol=tol, times=times, **METHOD)
    right = flight(times, stiffness)
    assert np.max(np.abs(result.displacement(mass) - right)) < tol * np.max(np.abs(right))
    assert np.max(np.abs(result.velocity(mass))) < 1.0 + 1e-3
    assert result.notes == []
    assert result.counters.steps < 400 / np.sqrt(tol)


#: The last pair of stops is hit often enough for a run that resolves impacts half as finely to differ.
IMPACTS = [("contact", 1e6, 3.7, False, 400), ("crushing", 1e8, 7.7, False, 1000), ("crushing", 1e8, 9.7, True, 1400)]


@pytest.mark.parametrize(("law", "stiffness", "t_end", "told", "most"), IMPACTS)
def test_a_step_across_an_impact_is_not_taken_for_resolved(law, stiffness, t_end, told, most):
    """Steps of many radians leave almost no displacement behind, and turn the velocity round."""
    mass, scene = to_and_fro(stiffness) if law == "contact" else crushed(stiffness)
    times = np.linspace(0.0, t_end, 1001)
    result = vf.simulate(scene, t_end, tol=1e-2, times=times, method="generalized_alpha")
    right = flight(times, stiffness)
    assert np.max(np.abs(result.displacement(mass) - right)) < 2e-2 * np.max(np.abs(right))
    assert any(note.startswith("tol: displacements may") for note in result.notes) is told
    assert result.counters.steps < most


@pytest.mark.parametrize(("stiffness", "law"), [(1e4, "penetration"), (1e8, "displacement")])
def test_a_mass_that_hits_a_beam_is_right_or_told(stiffness, law):
    """The beam's fast modes, which hardly move anything, decide on the next impact; event_driven is exact."""
    beam = vf.Beam(1.0, 1.0, 1.0, 4, {"left": "pinned", "right": "pinned"}, name="beam")
    mass = vf.Mass(0.3, name="m")
    stop = vf.Contact(mass, beam.at(0.5), gap=0.1, stiffness=stiffness, acts_on=law, name="stop")
    scene = vf.Scene([beam, mass], [stop], {mass: (0.0, 1.0)})
    times = np.linspace(0.0, 2.0, 401)
    exact = vf.simulate(scene, 2.0, times=times).displacement(mass)
    result = vf.simulate(scene, 2.0, tol=1e-2, times=times, **METHOD)
    off = np.max(np.abs(result.displacement(mass) - exact)) / np.max(np.abs(exact))
    assert off < 10.0 * 1e-2 or any(note.startswith("tol: displacements may") for note in result.notes)


def test_times_may_be_asked_for_twice():
    """The comparison with a coarser run takes each of its own times once."""
    mass, scene = on_stop(vf.Mass(1.0), gap=0.5, stiffness=1e6, start=(0.0, 1.0))
    result = vf.simulate(scene, 3.0, tol=1e-2, times=[0.0, 0.0, 1.5, 3.0, 3.0], **METHOD)
    assert result.displacement(mass)[-1] == result.displacement(mass)[-2]
    assert abs(result.displacement(mass)[-1] + 2.0) < 10.0 * 1e-2 * 2.0


def test_a_load_faster_than_the_rough_run_does_not_spoil_the_size():
    """The rough run takes a hundredth of a second a step, the load turns every hundredth; loads enter by moments."""
    mass = vf.Mass(1.0, stiffness=4.0)
    omega = 2.0 * np.pi * 100.0 + 2.0
    scene = vf.Scene([mass], [vf.PointLoad(mass, lambda t: 100.0 * np.sin(omega * t))])
    times = np.linspace(0.0, 10.0, 301)
    result = vf.simulate(scene, 10.0, tol=1e-3, times=times, **METHOD)
    right = 100.0 / (4.0 - omega**2) * (np.sin(omega * times) - 0.5 * omega * np.sin(2.0 * times))
    assert np.max(np.abs(result.displacement(mass) - right)) < 1e-2 * np.max(np.abs(right))
    assert not any(note.startswith("tol:") for note in result.notes)


def test_interpolation_between_contradicting_ends_stays_between_them():
    x = np.linspace(0.0, 1.0, 101)
    for v0, v1 in ((1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)):
        ends = np.array([[0.4], [v0], [0.0]]), np.array([[0.45], [v1], [-1e6]])
        inside = interpolated(x, 0.1, *ends)[0]
        assert inside.min() >= 0.4
        assert inside.max() <= 0.45
        assert np.all(np.diff(inside) >= -1e-15)
        value, rate, _ = interpolated(np.zeros(1), 0.1, *ends)
        assert (value[0], rate[0]) == (0.4, v0)


def test_smooth_motion_keeps_the_quintic():
    """Between steps of a quarter of a radian samples are as right as the states at their ends."""
    mass, scene = on_stop(vf.Mass(1.0, stiffness=1.0), gap=5.0, stiffness=1.0, start=(0.0, 1.0))
    result = vf.simulate(scene, 3.0, dt=0.25, **METHOD)
    t = np.linspace(0.0, 3.0, 211)
    at_ends = np.interp(t, result.times, result.displacement(mass) - np.sin(result.times))
    assert np.max(np.abs(result.displacement(mass, t) - np.sin(t) - at_ends)) < 5e-4


@pytest.mark.parametrize(("law", "load"), [
    ("bilinear", "pulse"), ("iwan", "pulse"), ("resolved", "pulse"), ("bilinear", "hump"), ("iwan", "ramp"),
])  # fmt: skip
def test_a_break_away_after_a_long_rest_is_not_jumped_over(law, load):
    """At rest nothing moves, so errors are zero and steps grow; a short load then makes the slider slip."""
    force = {
        "pulse": vf.Pulse(3.0, 4.5, 0.02), "ramp": vf.Tabulated([0.0, 3.0, 6.0], [0.0, 0.9, 1.2]),
        "hump": vf.Tabulated([0.0, 4.48, 4.5, 4.52, 6.0], [0.0, 0.0, 3.0, 0.0, 0.0]),
    }[load]  # fmt: skip
    mass = vf.Mass(1.0, damping=20.0)
    effect = {
        "bilinear": lambda: vf.BilinearSpring(mass, stiffness=100.0, linear_limit=0.01, hardening=0.01),
        "iwan": lambda: vf.IwanSpring(mass, elongation=[0.01, 0.02, 4.0], force=[0.9, 1.0, 1.2]),
        "resolved": lambda: vf.Contact(mass, gap=1e-3, stiffness=100.0, side="above", acts_on="penetration",
                                       switch=vf.Resolved(1e4)),
    }[law]()  # fmt: skip
    scene = vf.Scene([mass], [effect, vf.Spring(mass, stiffness=0.1), vf.PointLoad(mass, force)])
    times = np.linspace(0.0, 6.0, 61)
    right = vf.simulate(scene, 6.0, method="energy_conserving", dt=5e-3, times=times).displacement(mass)
    result = vf.simulate(scene, 6.0, method="energy_conserving", tol=0.01, times=times)
    assert np.abs(result.displacement(mass) - right).max() < 0.02 * np.abs(right).max()


@pytest.mark.parametrize(("method", "cure"), [("energy_conserving", ""), ("generalized_alpha", "may have blown up")])
def test_a_step_without_a_solution_names_its_size_and_the_laws_that_may_leave_none(method, cure):
    """A spring that softens without end throws the mass to infinity within 1.4 s."""
    mass = vf.Mass(1.0)
    spring = vf.NonlinearSpring(mass, potential=lambda u: -(u**4) / 4.0, force=lambda u: -(u**3))
    match = rf"{method} found no solution of the step from t = [\d.]+ s at dt = 0\.05 s: reduce dt\..*{cure}.*softens"
    with pytest.raises(vf.ConvergenceError, match=match):
        vf.simulate(vf.Scene([mass], [spring], {mass: (1.0, 1.0)}), 4.0, method=method, dt=0.05)
