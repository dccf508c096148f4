"""Steady states by shooting, against independent orbits, independent integrations and closed forms."""

import numpy as np
import pytest
from orbit_scenes import bilinear, impact_oscillator, nlvib_03, state_at_cosine
from reference_integration import Reference
from scenes import cantilever, on_stop, reference
from scipy.integrate import solve_ivp

import vofem as vf


def sorted_pairs(values):
    return np.array(sorted(np.asarray(values, dtype=complex), key=lambda z: (z.real, z.imag)))


def test_sixty_orbits_of_the_bilinear_oscillator():
    """P1 of the reference data: states to 1e-9, multipliers to 1e-6 of their size, extremes of the displacement."""
    known = reference("orbits/P1")
    assert known["omega"].size == 60
    for k, omega in enumerate(known["omega"]):
        scene = bilinear(omega)
        mass = scene.bodies[0]
        y0 = known["y0"][k]
        guess = {mass: (1.003 * y0[0], 0.998 * y0[1])}
        orbit = vf.periodic(scene, periods=int(known["k"][k]), guess=guess)
        q, v = (float(part[0]) for part in orbit.state_of(mass.name))
        assert [q, v] == pytest.approx(y0, abs=1e-9)
        theirs = sorted_pairs(known["mult"][k])
        assert np.all(np.abs(sorted_pairs(orbit.multipliers) - theirs) <= 1e-6 * np.maximum(1.0, np.abs(theirs)))
        assert orbit.extremes(mass) == pytest.approx((known["umin"][k], known["umax"][k]), abs=1e-9)
        assert orbit.residual < 1e-12
        assert orbit.stable == bool(np.abs(theirs).max() < 1.0)
        assert np.prod(orbit.multipliers) == pytest.approx(np.exp(-0.1 * orbit.period), rel=1e-9)


def test_two_masses_on_a_stop_from_rest():
    """NLvib's example 03 at 0.635 rad/s: the attractor, its state, multipliers and event times."""
    scene = nlvib_03(0.635)
    orbit = vf.periodic(scene)
    expected = [0.9613616024620069, 0.6578832109672325, 0.3167908536144315, 0.08600155491013046]
    assert state_at_cosine(orbit) == pytest.approx(expected, abs=1e-11)
    pair, other = 0.276285689169 + 0.841558041219j, -0.478347493661 + 0.542523869351j
    assert sorted_pairs(orbit.multipliers) == pytest.approx(
        sorted_pairs([pair, pair.conjugate(), other, other.conjugate()]), abs=1e-10
    )
    assert orbit.stable is True
    assert orbit.result.contacts["stop"].closings == pytest.approx([0.13058796101729508], abs=1e-11)
    assert orbit.result.contacts["stop"].openings == pytest.approx([0.41961965845270605], abs=1e-11)
    assert orbit.result.times.size == 1001
    assert orbit.result.times[[0, -1]] == pytest.approx([0.0, orbit.period])


def test_an_unstable_orbit_from_a_guess():
    scene = nlvib_03(0.75)
    a, b = scene.bodies
    orbit = vf.periodic(scene, guess={a: (0.094, 0.724), b: (-0.207, 1.131)})
    expected = [0.0939864803011672, -0.206897023350189, 0.7243288503020249, 1.1311997031368195]
    assert state_at_cosine(orbit) == pytest.approx(expected, abs=1e-10)
    assert orbit.multipliers[0] == pytest.approx(-1.18331929, abs=1e-7)
    assert orbit.stable is False


@pytest.mark.parametrize(("omega", "stable", "state"), [
    (1.0084669916, True, (1.4817865255, 0.2937856805)),
    (0.8027683334, False, None),
])  # fmt: skip
def test_the_impact_oscillator_of_ing(omega, stable, state):
    """Ing, Pavlovskaia, Wiercigroch 2008 at a = 0.7, phase where the load's cosine is 1."""
    scene = impact_oscillator(omega)
    if stable:
        orbit = vf.periodic(scene)
        assert state_at_cosine(orbit) == pytest.approx(state, abs=1e-9)
    else:
        near = vf.continuation(impact_oscillator, 0.78, 0.804)
        (orbit,) = near.at(omega)
        assert orbit.multipliers[0] == pytest.approx(-3.489456, abs=1e-6)
    assert orbit.stable is stable


def test_an_orbit_of_a_beam_against_an_independent_integration():
    beam = cantilever(2, name="beam")
    tip = beam.at(1.0)
    effects = [
        vf.Contact(tip, gap=0.03, stiffness=20.0, side="below", acts_on="penetration", name="stop"),
        vf.PointLoad(tip, vf.Sine(0.3, 5.0, 0.4)),
        vf.RayleighDamping(0.2, 2e-3),
    ]
    orbit = vf.periodic(vf.Scene([beam], effects))
    assert orbit.stable is True
    assert orbit.result.contacts["stop"].closings.size
    start = vf.Scene([beam], effects, initial=orbit)
    outcome = Reference(start, orbit.period).run()
    assert outcome.why == "end"
    free = scene_state(start, orbit)
    assert outcome.q[-1] == pytest.approx(free[0], abs=1e-10)
    assert outcome.v[-1] == pytest.approx(free[1], abs=1e-9)
    closings = orbit.result.contacts["stop"].closings
    assert [event.time for event in outcome.events if event.closed] == pytest.approx(closings[closings > 0], abs=1e-9)


def scene_state(scene, orbit):
    state = scene.initial_state()
    assert np.any(state.q)
    return state.q, state.v


def test_a_run_from_an_orbit_stays_on_it():
    orbit = vf.periodic(nlvib_03(0.635))
    scene = nlvib_03(0.635)
    run = vf.simulate(scene, 5.0 * orbit.period, initial=orbit)
    a = scene.bodies[0]
    times = np.linspace(0.0, orbit.period, 7)
    for k in range(5):
        later = run.displacement(a, k * orbit.period + times)
        assert later == pytest.approx(orbit.result.displacement(a, times), abs=1e-10)


def test_amplitudes_and_harmonics_of_a_linear_oscillator():
    """One harmonic and a mean in closed form: nothing else, and no contact is needed."""
    mass = vf.Mass(2.0, stiffness=8.0, damping=0.4)
    load = vf.Sine(3.0, 1.3, 0.7) + 5.0
    orbit = vf.periodic(vf.Scene([mass], [vf.PointLoad(mass, load)]))
    response = 3.0 * np.exp(1j * (0.7 - np.pi / 2)) / (8.0 - 2.0 * 1.3**2 + 1.3j * 0.4)
    found = orbit.harmonics(mass, 3)
    assert found == pytest.approx([5.0 / 8.0, response, 0.0, 0.0], abs=1e-13)
    assert orbit.amplitude(mass) == pytest.approx(abs(response), rel=1e-12)
    assert orbit.omega == 1.3
    assert orbit.period == pytest.approx(2.0 * np.pi / 1.3)


def test_harmonics_of_an_impacting_orbit():
    """The equation of motion holds harmonic by harmonic, with the contact force from its closed phase."""
    scene = bilinear(1.5)
    mass = scene.bodies[0]
    orbit = vf.periodic(scene)
    c = orbit.harmonics(mass, 6)
    times = np.linspace(0.0, orbit.period, 400_001)[:-1]
    force = orbit.result.solution.contacts(times).force[0]
    for k in range(7):
        wave = np.exp(-1j * k * 1.5 * times)
        push = (1.0 if k == 0 else 2.0) * np.mean(force * wave)
        load = -1j if k == 1 else 0.0
        left = (1.0 - (1.5 * k) ** 2 + 0.1j * 1.5 * k) * c[k]
        assert left == pytest.approx(load - push, abs=1e-9)


def test_loads_with_a_common_period():
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.2)
    loads = [vf.PointLoad(mass, vf.Sine(1.0, 2.0)), vf.PointLoad(mass, vf.Sine(0.5, 3.0))]
    orbit = vf.periodic(vf.Scene([mass], loads))
    assert orbit.omega == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize(("load", "words"), [
    (vf.Ramp(1.0), "Ramp"),
    (vf.Pulse(1.0, 0.0, 0.5), "Pulse"),
    (vf.Sine(1.0, np.sqrt(2.0)), "no common period"),
])  # fmt: skip
def test_loads_that_are_not_periodic_are_named(load, words):
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.2)
    scene = vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, 1.0)), vf.PointLoad(mass, load)])
    with pytest.raises(vf.ArgumentError, match=words):
        vf.periodic(scene)


def test_without_loads_there_is_no_period():
    mass = vf.Mass(1.0, stiffness=1.0)
    with pytest.raises(vf.ArgumentError, match="backbone"):
        vf.periodic(vf.Scene([mass]))


def test_bad_arguments():
    scene = bilinear(1.0)
    with pytest.raises(vf.ArgumentError, match="periods"):
        vf.periodic(scene, periods=0)
    with pytest.raises(vf.ArgumentError, match="method"):
        vf.periodic(scene, method="shoot")
    with pytest.raises(vf.ArgumentError, match="harmonics"):
        vf.periodic(scene, method="shooting", harmonics=5)
    with pytest.raises(vf.ArgumentError, match="period"):
        vf.periodic(scene, period=-1.0)
    with pytest.raises(vf.ArgumentError, match="not periodic"):
        vf.periodic(scene, period=1.0)
    for count in (-1, 10**400):
        with pytest.raises(vf.ArgumentError, match="a whole number from 0 to 1000"):
            vf.periodic(scene).harmonics(scene.bodies[0], count)


def test_a_guess_is_named_in_messages():
    with pytest.raises(vf.ArgumentError, match="periodic: guess is 3"):
        vf.periodic(bilinear(1.5), guess=3)
    with pytest.raises(vf.ArgumentError, match="continuation: guess names"):
        vf.continuation(bilinear, 1.5, 1.6, guess={vf.Mass(1.0, name="other"): (0.0, 0.0)})
    stranger = vf.simulate(vf.Scene([vf.Mass(1.0, name="stranger")]), 1.0)
    with pytest.raises(vf.ArgumentError, match="periodic: guess: no body is named"):
        vf.periodic(bilinear(1.5), guess=stranger)
    with pytest.raises(vf.ArgumentError, match=r"this one repeats after 4\.18879"):
        vf.periodic(bilinear(1.5), period=5.0)


def test_a_resonance_without_damping_has_no_orbit():
    """Closed form beside it: the amplitude ``1/|1 - omega^2|``."""
    mass = vf.Mass(1.0, stiffness=1.0, name="mass")
    near = vf.periodic(vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, 1.0 + 1e-6))]))
    assert near.amplitude(mass) == pytest.approx(1.0 / (2e-6 + 1e-12), rel=1e-8)
    for guess in (None, near):
        with pytest.raises(vf.ConvergenceError, match="natural frequency of a structure without damping"):
            vf.periodic(vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, 1.0))]), guess=guess)


@pytest.mark.parametrize("omega", [1.4, 1.52, 1.7])
def test_an_orbit_as_a_guess_gives_the_orbit_of_its_state(omega):
    """Newton's method begins with the segments of the orbit, or with a run where they are others."""
    known = vf.periodic(bilinear(1.5))
    near, from_state = (vf.periodic(bilinear(omega), guess=guess) for guess in (known, known.as_start()))
    assert near.residual < 1e-12
    assert np.abs(state_at_cosine(near) - state_at_cosine(from_state)).max() < 1e-9
    assert sorted_pairs(near.multipliers) == pytest.approx(sorted_pairs(from_state.multipliers), rel=1e-8, abs=1e-10)


def test_subharmonics_are_minimal():
    """Near a stable orbit over one period nothing else is found over two; beyond the flip there is one."""
    scene = bilinear(1.5)
    with pytest.raises(vf.ConvergenceError, match="repeats after 1"):
        vf.periodic(scene, periods=2)
    scene = bilinear(2.45)
    orbit = vf.periodic(scene, periods=2)
    assert orbit.stable is True
    assert orbit.periods == 2
    assert orbit.period == pytest.approx(4.0 * np.pi / 2.45)
    first, second = orbit.result.displacement(scene.bodies[0], np.array([0.0, 0.5 * orbit.period]))
    assert abs(first - second) > 0.01


def test_a_chaotic_motion_comes_near_to_an_orbit():
    """It is not stable. What a walk from smaller loads ends in begins inside a stop as if it were open, and is none."""
    mass = vf.Mass(1.0, name="m")
    stops = [
        vf.Contact(mass, gap=0.05, stiffness=100.0, side=side, acts_on="penetration") for side in ("above", "below")
    ]
    orbit = vf.periodic(vf.Scene([mass], [*stops, vf.PointLoad(mass, vf.Sine(0.1, 1.0))]), method="shooting")
    assert orbit.stable is False
    assert any("where the motion nearly repeats; motions need not settle on it" in note for note in orbit.notes)
    start = [of(mass, [0.0])[0] for of in (orbit.result.displacement, orbit.result.velocity)]

    def rate(t, y):
        return [y[1], 0.1 * np.sin(t) - 100.0 * (max(y[0] - 0.05, 0.0) + min(y[0] + 0.05, 0.0))]

    run = solve_ivp(rate, (0.0, 2.0 * np.pi), start, rtol=1e-11, atol=1e-13, max_step=5e-3)
    assert run.y[:, -1] == pytest.approx(start, abs=1e-8)


@pytest.mark.parametrize(("omega", "gap"), [(0.75, 0.1), (1.0, 0.0), (2.5, 0.1)])
def test_contacts_that_close_at_one_time(omega, gap):
    """Two stops between the same points, one of them with a damper."""
    masses = [vf.Mass(1.0, stiffness=1.0, damping=0.05, name=name) for name in "ab"]
    soft = vf.Contact(*masses, gap=gap, stiffness=1.4, damping=0.2, acts_on="penetration", name="p")
    hard = vf.Contact(*masses, gap=gap, stiffness=30.0, acts_on="penetration", name="q")
    load = vf.PointLoad(masses[0], vf.Sine(0.4, omega))
    orbit = vf.periodic(vf.Scene(masses, [vf.Spring(*masses, stiffness=0.7), soft, hard, load]))
    run = vf.simulate(orbit.scene, 20 * orbit.period, initial=orbit, times=[0.0, 20 * orbit.period])
    assert np.ptp(run.displacement(masses[0])) < 1e-9


def test_what_does_not_settle_is_told():
    """Without damping no motion from rest settles: the orbit is found from the linear response."""
    mass = vf.Mass(1.0, stiffness=1.0)
    orbit = vf.periodic(vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, 0.3))]))
    assert any("200 periods" in note for note in orbit.notes)
    assert orbit.amplitude(mass) == pytest.approx(1.0 / (1.0 - 0.09), rel=1e-12)
    # Its multipliers lie on the unit circle.
    assert orbit.stable is None


def test_an_orbit_with_too_many_switches_is_told():
    """With thousands of unknown times one step of Newton's method would take minutes."""
    mass, scene = on_stop(vf.Mass(1.0, 1.0, 0.2), load=vf.Sine(1.0, 1.0), gap=0.5, stiffness=5.0)
    words = "from the guess. contacts switch 2200 times in an orbit, and Newton's method takes at most 2000"
    with pytest.raises(vf.ConvergenceError, match=words):
        vf.periodic(scene, periods=1100, guess={mass: (0.5, 0.0)})


def test_a_guess_may_be_a_run_that_ends_anywhere():
    """The state at the last full period of the loads counts, also where the run began at another time of them."""
    scene = nlvib_03(0.635)
    run = vf.simulate(scene, 300.0, t_start=3.0)
    orbit = vf.periodic(scene, guess=run)
    assert state_at_cosine(orbit)[0] == pytest.approx(0.9613616024620069, abs=1e-10)


def test_an_orbit_as_a_guess_lends_its_modes(monkeypatch):
    """At another frequency, or with another gap, no eigenvalue problem is solved; the orbit is that found without."""

    def build(omega, gap=0.03):
        beam = cantilever(5, name="beam")
        tip = beam.at(1.0)
        stop = vf.Contact(tip, gap=gap, stiffness=10.0, side="below", acts_on="penetration", name="stop")
        return vf.Scene([beam], [stop, vf.PointLoad(tip, vf.Sine(0.05, omega)), vf.RayleighDamping(0.1, 1e-3)])

    first = vf.periodic(build(4.5))
    # The state alone lends nothing.
    known = {(w, gap): vf.periodic(build(w, gap), guess=first.as_start()) for w, gap in ((4.6, 0.03), (4.5, 0.031))}

    def never(*_):
        raise AssertionError("an eigenvalue problem was solved again")

    from vofem.integrators.event_driven import modal_space

    monkeypatch.setattr(modal_space, "modal_basis", never)
    for (omega, gap), orbit in known.items():
        found = vf.periodic(build(omega, gap), guess=first)
        assert found.unknowns == pytest.approx(orbit.unknowns, abs=1e-12)
        assert found.omega == omega
        assert found.result.contacts["stop"].closings == pytest.approx(
            orbit.result.contacts["stop"].closings, abs=1e-11
        )


def test_a_periodic_table_is_treated_by_harmonic_balance():
    """Shooting follows one closed form over a period, so it refuses corners by name."""
    period, count = 2.0 * np.pi, 400
    saw = vf.Tabulated(np.arange(4 * count + 1) * period / 4.0, 0.8 * np.array([0, 1, 0, -1] * count + [0]))
    mass = vf.Mass(1.3, stiffness=2.0, damping=0.5, name="mass")
    scene = vf.Scene([mass], [vf.PointLoad(mass, saw)])
    orbit = vf.periodic(scene, period=period)
    harmonics = np.arange(1, 200, 2)
    signs = np.where(harmonics % 4 == 1, 1.0, -1.0)
    terms = 0.8 * 8.0 / np.pi**2 * signs / harmonics**2 / (2.0 - 1.3 * harmonics**2 + 0.5j * harmonics)
    times = np.linspace(0.0, period, 2001)
    expected = np.imag(np.exp(1j * np.outer(times, harmonics)) @ terms)
    assert orbit.amplitude(mass) == pytest.approx(0.5 * np.ptp(expected), rel=1e-5)
    assert orbit.method == "harmonic_balance"
    assert orbit.stable
    with pytest.raises(vf.MethodError, match=r"Tabulated.* has corners or jumps, and shooting takes sums of Sine"):
        vf.periodic(scene, period=period, method="shooting")
    with pytest.raises(vf.ArgumentError, match="no harmonics that set its period; give period="):
        vf.periodic(scene)


@pytest.mark.parametrize("load", [0.0, 1e-9, 1e-3])
def test_orbits_that_hardly_move_about_a_deflection(load):
    """Velocities of rounding are no motion that does not settle."""
    mass = vf.Mass(1.0, stiffness=2.0, damping=0.15, name="mass")
    scene = vf.Scene([mass], [vf.Gravity(9.81), vf.PointLoad(mass, vf.Sine(load, 3.0))])
    orbit = vf.periodic(scene)
    assert orbit.stable
    assert orbit.amplitude(mass) == pytest.approx(load / abs(2.0 - 9.0 + 0.45j), rel=1e-5, abs=1e-14)
    beam = vf.Beam(1.0, EI=1.0, rhoA=1.0, elements=10, supports={"left": "clamped"}, name="beam")
    stop = vf.Contact(beam.at(1.0), gap=1.0, stiffness=50.0, side="below", acts_on="penetration", name="stop")
    effects = [vf.Gravity(9.81), vf.ModalDamping(0.02), stop, vf.PointLoad(beam.at(1.0), vf.Sine(load, 3.0))]
    assert vf.periodic(vf.Scene([beam], effects)).stable
