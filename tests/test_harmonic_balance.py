"""Periodic orbits by harmonic balance: exact and independent orbits, transients, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from orbit_scenes import bilinear, nlvib_03

import vofem as vf
from vofem.studies.steady.harmonic.balance import HarmonicBalance

P7 = json.loads((Path(__file__).parent / "data" / "orbits" / "P7.json").read_text())


def oscillator(load, *effects, damping=0.02, stiffness=1.0):
    """Return a scene of one mass of 1 kg; effects are functions of the mass."""
    mass = vf.Mass(1.0, stiffness=stiffness, damping=damping, name="m")
    return vf.Scene([mass], [vf.PointLoad(mass, load), *(make(mass) for make in effects)]), mass


# -- known orbits -----------------------------------------------------------------------------------


@pytest.mark.parametrize("row", P7["springpot"]["rows"], ids=lambda row: f"omega={row[0]}")
def test_springpot_oscillator(row):
    omega, size, angle = map(float, row)
    scene, mass = oscillator(vf.Sine(1.0, omega), lambda m: vf.Springpot(m, coefficient=0.3, order=0.5))
    orbit = vf.periodic(scene, method="harmonic_balance", harmonics=3)
    # u = Im(H exp(i omega t)) is Re(-i H exp(i omega t)).
    assert abs(orbit.harmonics(mass, 1)[1] / (-1j * size * np.exp(1j * angle)) - 1.0) < 1e-12
    assert orbit.result.energy.balance_error < 1e-12
    assert vf.periodic(scene).method == "harmonic_balance"


def duffing(omega):
    beta = P7["duffing"]["beta"]
    return oscillator(
        vf.Sine(P7["duffing"]["F"], omega),
        lambda m: vf.NonlinearSpring(m, potential=lambda u: beta * u**4 / 4, force=lambda u: beta * u**3),
        damping=P7["duffing"]["c"],
    )


@pytest.mark.parametrize("row", P7["duffing"]["rows"], ids=lambda row: f"{row[0]}-{row[3]:.3f}")
def test_duffing_oscillator_on_all_its_sheets(row):
    omega, u, v, first, largest = row[:5]
    scene, mass = duffing(omega)
    # One period of a run that starts on the orbit, also where it is unstable.
    orbit = vf.periodic(scene, guess=vf.simulate(scene, 2.0001 * np.pi / omega, initial={mass: (u, v)}, dt=0.005))
    assert orbit.residual < 1e-12
    assert abs(orbit.result.displacement(mass)[0] - u) < 1e-11
    assert abs(orbit.result.velocity(mass)[0] - v) < 1e-11
    assert abs(abs(orbit.harmonics(mass, 1)[1]) - first) < 1e-11
    assert abs(orbit.extremes(mass)[1] - largest) < 1e-7
    assert orbit.truncation.largest < 1e-13


def test_folds_of_the_duffing_oscillator():
    data = P7["duffing"]
    mass = vf.Mass(1.0, stiffness=data["k"], damping=data["c"], name="m")
    beta = data["beta"]
    cubic = vf.NonlinearSpring(mass, potential=lambda u: beta * u**4 / 4, force=lambda u: beta * u**3)
    load = data["F"]
    branch = vf.continuation(
        lambda omega: vf.Scene([mass], [cubic, vf.PointLoad(mass, vf.Sine(load, omega))]), 0.5, 2.0, harmonics=15
    )
    assert [point.kind for point in branch.special] == ["fold", "fold"]
    np.testing.assert_allclose([point.value for point in branch.special], data["folds"], rtol=1e-11)
    for omega in (1.3, 1.4, 1.5):
        known = sorted(row[3] for row in data["rows"] if row[0] == omega)
        found = sorted(abs(orbit.harmonics(mass, 1)[1]) for orbit in branch.at(omega))
        np.testing.assert_allclose(found, known, rtol=1e-10)
    # Only the frequency changes along the branch.
    assert branch.counters.eigensolves == 1


def jenkins(omega, harmonics):
    data = P7["jenkins_exact"]
    scene, mass = oscillator(
        vf.Sine(data["F"], omega),
        lambda m: vf.BilinearSpring(m, stiffness=data["kt"], linear_limit=data["fy"] / data["kt"]),
        damping=data["c"],
    )
    return vf.periodic(scene, harmonics=harmonics), mass


def test_jenkins_oscillator_converges_to_exact_orbits():
    """Forces with kinks have harmonics like k^-2, displacements like k^-4, whose tail falls like H^-3 or faster."""
    rows = [tuple(map(float, row[:2])) for row in P7["jenkins_exact"]["rows"][::16]]
    counts = np.array([8, 16, 32])
    errors = []
    for harmonics in counts.tolist():
        found = [jenkins(omega, harmonics) for omega, _ in rows]
        off = [abs(orbit.amplitude(m) / peak - 1.0) for (orbit, m), (_, peak) in zip(found, rows, strict=True)]
        errors.append(max(off))
        assert max(off) <= max(orbit.truncation.largest for orbit, _ in found)
    assert errors[-1] < 16.0 * 3e-8  # with twice as many it is a sixteenth, as the next test shows
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert -5.0 < slope < -3.0


def test_exact_orbits_of_the_jenkins_oscillator():
    """With 64 harmonics each is met within what the orbit says of itself; three of the 33 are enough for a test."""
    for omega, peak in (map(float, row[:2]) for row in P7["jenkins_exact"]["rows"][5::10]):
        orbit, mass = jenkins(omega, 64)
        off = abs(orbit.amplitude(mass) / peak - 1.0)
        assert off < 3e-8, omega
        assert off <= orbit.truncation.largest + 1e-12, omega


def test_one_harmonic_is_the_describing_function():
    """Amplitudes at all frequencies that the describing function gives for them, on both sides of the resonance."""
    data = P7["jenkins_describing_function"]

    def build(omega):
        mass = vf.Mass(data["m"], stiffness=data["k"], damping=data["c"], name="m")
        slider = vf.BilinearSpring(mass, stiffness=data["kt"], linear_limit=data["fy"] / data["kt"], name="slider")
        return vf.Scene([mass], [slider, vf.PointLoad(mass, vf.Sine(data["F"], omega))])

    branch = vf.continuation(build, 0.9, 1.6, harmonics=1)
    assert not branch.notes
    roots = [(float(row[0]), float(omega)) for row in data["rows"] for omega in row[1:]]
    assert len(roots) == 8
    for amplitude, omega in roots:
        known = [float(np.hypot(*orbit.unknowns[1:])) for orbit in branch.at(omega)]
        assert min(abs(one - amplitude) for one in known) < 1e-9, (amplitude, omega)


# -- agreement with shooting ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("law", "order", "last"), [("penetration", (2.7, 4.0), 1e-6), ("displacement", (1.7, 2.6), 1e-5)]
)
def test_contacts_agree_with_shooting_as_harmonics_grow(law, order, last):
    """The displacement's harmonics fall like k^-4 where the force has kinks and like k^-3 where it jumps."""
    scene, mass = oscillator(
        vf.Sine(1.0, 1.3),
        lambda m: vf.Contact(m, gap=0.1, stiffness=8.0, side="above", acts_on=law, name="stop"),
        damping=0.1,
    )
    exact = vf.periodic(scene, method="shooting")
    counts = np.array([10, 20, 40, 80])
    errors = []
    for harmonics in counts.tolist():
        orbit = vf.periodic(scene, method="harmonic_balance", harmonics=harmonics, guess=exact)
        errors.append(np.abs(orbit.result.displacement(mass) - exact.result.displacement(mass)).max())
    assert errors[-1] < last
    assert order[0] < -np.polyfit(np.log(counts), np.log(errors), 1)[0] < order[1]
    assert orbit.multipliers == pytest.approx(exact.multipliers, abs=1e-12)
    assert orbit.stable
    found, known = (one.result.contacts["stop"].closings for one in (orbit, exact))
    np.testing.assert_allclose(found, known, atol=1e-4)


@pytest.mark.parametrize("amplitude", [0.3, 3.0])
def test_multipliers_along_a_smooth_spring(amplitude):
    """Duffing's oscillator with its linear equations for small perturbations, integrated to 1e-12."""
    from scipy.integrate import solve_ivp

    scene, mass = oscillator(
        vf.Sine(amplitude, 1.4),
        lambda m: vf.NonlinearSpring(m, potential=lambda u: 0.25 * u**4, force=lambda u: u**3, name="cubic"),
        damping=0.1,
    )
    orbit = vf.periodic(scene, harmonics=40)
    start = [float(orbit.result.displacement(mass, [0.0])[0]), float(orbit.result.velocity(mass, [0.0])[0])]

    def rates(t, y):
        x, v, *columns = y
        moved = np.reshape(columns, (2, 2))
        tangent = np.array([[0.0, 1.0], [-1.0 - 3.0 * x * x, -0.1]])
        return [v, amplitude * np.sin(1.4 * t) - 0.1 * v - x - x**3, *(tangent @ moved).ravel()]

    end = solve_ivp(rates, (0.0, orbit.period), [*start, 1.0, 0.0, 0.0, 1.0], method="DOP853", rtol=1e-12, atol=1e-13)
    assert end.y[:2, -1] == pytest.approx(start, abs=1e-9)
    known = np.linalg.eigvals(end.y[2:, -1].reshape(2, 2))
    assert np.sort_complex(orbit.multipliers) == pytest.approx(np.sort_complex(known), abs=1e-8)
    assert orbit.stable == bool(np.all(np.abs(known) < 1.0))


@pytest.mark.parametrize("damped", [False, True])
def test_multipliers_of_a_beam_agree_with_shooting(damped):
    """A stop, with a damper and a dashpot beside it or without: few harmonics give the same multipliers as many."""
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=5, supports={"left": "clamped"}, name="beam")
    tip = beam.at(1.0)
    effects = [
        vf.Contact(
            tip,
            gap=0.03,
            stiffness=10.0,
            damping=0.05 if damped else 0.0,
            side="below",
            acts_on="penetration",
            name="s",
        ),
        vf.PointLoad(tip, vf.Sine(0.05, 3.4)),
        vf.RayleighDamping(0.1, 1e-3),
        *([vf.Dashpot(beam.at(0.4), damping=0.2)] if damped else []),
    ]
    scene = vf.Scene([beam], effects)
    exact = vf.periodic(scene)
    for harmonics in (15, 60):
        orbit = vf.periodic(scene, harmonics=harmonics, guess=exact)
        assert orbit.multipliers == pytest.approx(exact.multipliers, abs=1e-12)
        assert orbit.stable


def test_special_points_along_a_branch():
    """A flip lies where it lies by shooting, however few the harmonics are, and orbits over two periods begin there."""
    (exact,) = vf.continuation(bilinear, 2.5, 2.2).special
    for harmonics in (10, 20):
        branch = vf.continuation(bilinear, 2.5, 2.2, method="harmonic_balance", harmonics=harmonics)
        (flip,) = branch.special
        assert flip.kind == exact.kind == "period_doubling"
        assert np.min(np.abs(flip.orbit.multipliers + 1.0)) < 1e-9
        assert flip.value == pytest.approx(exact.value, abs=1e-9)
    (orbit,) = branch.switch(flip).at(2.45)
    doubled = vf.periodic(bilinear(2.45), periods=2)
    assert orbit.periods == 2
    assert orbit.amplitude(orbit.scene.bodies[0]) == pytest.approx(doubled.amplitude(doubled.scene.bodies[0]), rel=1e-4)
    assert orbit.multipliers == pytest.approx(doubled.multipliers, abs=1e-9)


def test_two_folds_within_one_step():
    """A soft stop bends the response so little that its folds are 7e-6 rad/s apart; exact orbits have none there."""

    def build(omega):
        stop = lambda mass: vf.Contact(mass, gap=1.0, stiffness=1.0, side="above", acts_on="penetration")  # noqa: E731
        return oscillator(vf.Sine(0.02075362, omega), stop)[0]

    ways = (0.95, 1.05), (1.05, 0.95)
    up, down = (vf.continuation(build, *way, method="harmonic_balance", harmonics=3) for way in ways)
    assert [one.kind for one in up.special] == [one.kind for one in down.special] == ["fold", "fold"]
    values = [one.value for one in up.special]
    assert [one.value for one in down.special[::-1]] == pytest.approx(values, abs=1e-8)
    assert 0.0 < values[0] - values[1] < 1e-5
    assert [len(branch.at(0.5 * sum(values))) for branch in (up, down)] == [3, 3]


@pytest.mark.parametrize("harmonics", [8, 50])
def test_multipliers_do_not_depend_on_the_number_of_harmonics(harmonics):
    """NLvib's example 03 is stable at 0.635 rad/s; perturbations of the motion of 8 harmonics itself would grow."""
    scene = nlvib_03(0.635)
    exact = vf.periodic(scene)
    orbit = vf.periodic(scene, harmonics=harmonics, guess=exact)
    assert orbit.multipliers == pytest.approx(exact.multipliers, abs=1e-11)
    assert orbit.stable


def test_without_an_exact_orbit_the_stability_is_not_decided(tmp_path):
    """NLvib's example 03 has its upper fold at 0.755627353 rad/s, and with 25 harmonics at 0.755632."""
    orbit = None
    for omega in (0.635, 0.7, 0.74, 0.755):
        orbit = vf.periodic(nlvib_03(omega), guess=orbit)
    branch = vf.continuation(nlvib_03, 0.755, 0.757, harmonics=25, guess=orbit)
    (fold,) = (special for special in branch.special if special.kind == "fold")
    assert fold.value > 0.75563
    assert fold.orbit.multipliers is None
    assert fold.orbit.stable is None
    assert "no exact orbit lies within the error of the harmonics" in fold.orbit.stability
    assert branch.orbits[0].stable is False
    assert branch.orbits[0].multipliers == pytest.approx(orbit.multipliers, abs=1e-9)
    loaded = vf.load(branch.save(tmp_path / "branch.h5"))
    assert loaded.special[branch.special.index(fold)].orbit.multipliers is None
    assert loaded.special[branch.special.index(fold)].orbit.stability == fold.orbit.stability
    np.testing.assert_array_equal(loaded.orbits[0].multipliers, branch.orbits[0].multipliers)


@pytest.mark.parametrize(("law", "damping", "error"), [("penetration", 0.3, 1e-6), ("displacement", 0.0, 2e-3)])
def test_multipliers_beside_a_spring_that_shooting_does_not_take(law, damping, error):
    """A spring without a force, so that the exact multipliers are known."""
    one, two = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="one"), vf.Mass(1.0, damping=0.1, name="two")
    effects = [
        vf.Spring(one, two, stiffness=1.0),
        vf.Dashpot(one, two, damping=0.05),
        vf.Contact(one, gap=0.1, stiffness=8.0, damping=damping, side="above", acts_on=law, name="stop"),
        vf.PointLoad(one, vf.Sine(1.0, 1.3)),
    ]
    none = vf.NonlinearSpring(two, potential=lambda u: 0.0 * u, force=lambda u: 0.0 * u, name="none")
    exact = vf.periodic(vf.Scene([one, two], effects))
    orbit = vf.periodic(vf.Scene([one, two], [*effects, none]), harmonics=40, guess=exact)
    assert orbit.method == "harmonic_balance"
    assert np.abs(orbit.multipliers - exact.multipliers).max() < error
    assert orbit.stable


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda m: vf.BilinearSpring(m, stiffness=0.5, linear_limit=0.02, name="slip"), "slip"),
        (lambda m: vf.Springpot(m, coefficient=0.3, order=0.5, name="pot"), "pot"),
    ],
)
def test_laws_with_a_memory_leave_the_stability_open(make, name):
    scene, _ = oscillator(vf.Sine(1.0, 1.3), make)
    orbit = vf.periodic(scene, harmonics=5)
    assert orbit.multipliers is None
    assert orbit.stable is None
    assert orbit.stability == "stability not decided"
    assert any(name in note and "past" in note for note in orbit.notes)


def test_a_body_that_only_stops_hold():
    mass = vf.Mass(1.0, damping=0.3, name="m")
    stops = [
        vf.Contact(mass, gap=0.5, stiffness=30.0, damping=0.2, side=side, acts_on="penetration", name=side)
        for side in ("above", "below")
    ]
    scene = vf.Scene([mass], [*stops, vf.PointLoad(mass, vf.Sine(1.0, 1.0))])
    orbit = vf.periodic(scene, method="harmonic_balance", harmonics=30)
    exact = vf.periodic(scene, method="shooting", guess=orbit)
    assert np.abs(orbit.result.displacement(mass) - exact.result.displacement(mass)).max() < 1e-4
    closings = [result.contacts["above"].closings for result in (orbit.result, exact.result)]
    np.testing.assert_allclose(*closings, atol=1e-3)


def test_subharmonic_orbits():
    """Beyond the doubling at 2.338157973 the oscillator without a gap repeats after two periods."""
    scene, mass = oscillator(
        vf.Sine(1.0, 2.45),
        lambda m: vf.Contact(m, gap=0.0, stiffness=8.0, side="above", acts_on="penetration"),
        damping=0.1,
    )
    exact = vf.periodic(scene, periods=2)
    orbit = vf.periodic(scene, periods=2, guess=exact, method="harmonic_balance", harmonics=60)
    assert orbit.period == pytest.approx(4.0 * np.pi / 2.45, rel=1e-15)
    assert np.abs(orbit.result.displacement(mass) - exact.result.displacement(mass)).max() < 1e-4
    once = vf.periodic(scene, method="harmonic_balance", harmonics=20, guess=None)
    with pytest.raises(vf.ConvergenceError, match="repeats after 1"):
        vf.periodic(scene, periods=2, guess=once, method="harmonic_balance", harmonics=40)


# -- agreement with transients ----------------------------------------------------------------------

LAWS = {
    "penetration": lambda m: vf.Contact(m, gap=0.3, stiffness=5.0, damping=0.2, side="above", acts_on="penetration"),
    "displacement": lambda m: vf.Contact(m, gap=0.3, stiffness=5.0, side="below", acts_on="displacement"),
    "resolved": lambda m: vf.Contact(
        m, gap=0.3, stiffness=5.0, damping=0.1, side="above", acts_on="penetration", switch=vf.Resolved(20.0)
    ),
    "resolved, displacement": lambda m: vf.Contact(
        m, gap=0.3, stiffness=5.0, side="above", acts_on="displacement", switch=vf.Resolved(20.0)
    ),
    "bilinear": lambda m: vf.BilinearSpring(m, stiffness=1.0, linear_limit=0.2, hardening=0.1),
    "Iwan": lambda m: vf.IwanSpring(m, elongation=[0.1, 0.3, 0.7], force=[0.2, 0.4, 0.5]),
    "springpot": lambda m: vf.Springpot(m, coefficient=0.4, order=0.6),
    "smooth": lambda m: vf.NonlinearSpring(m, potential=lambda u: u**4, force=lambda u: 4 * u**3),
}


@pytest.mark.parametrize("law", LAWS)
def test_orbits_are_where_transients_settle(law):
    """The transient has errors of second order in the step, here 1e-4 or less; it starts far from the orbit."""
    # The load makes all sliders slip: those that do not keep what they remember of the transient.
    scene, mass = oscillator(vf.Sine(1.5 if law == "Iwan" else 0.5, 0.8), LAWS[law], damping=0.25)
    orbit = vf.periodic(scene, method="harmonic_balance", harmonics=40)
    period = orbit.period
    run = vf.simulate(scene, 14.0 * period, method="energy_conserving", dt=period / 1500)
    times = orbit.result.times[::20]
    off = run.displacement(mass, 13.0 * period + times) - orbit.result.displacement(mass, times)
    # A springpot's past fades like a power of time.
    assert np.abs(off).max() < (3e-3 if law == "springpot" else 2e-4) * orbit.amplitude(mass)
    # Velocities converge one order more slowly than displacements, and under forces that jump like 1/H only.
    assert orbit.result.energy.balance_error < (2e-2 if law.endswith("displacement") else 3e-3)


def test_chain_with_all_laws():
    """NLvib's example 07: friction, cubic springs, a one-sided spring; M. Krack, J. Gross, Harmonic Balance, 2019."""
    masses = [vf.Mass(1.0, stiffness=s, damping=0.02 * s, name=f"m{k}") for k, s in enumerate((1.0, 0.0, 1.0))]
    one, two, three = masses
    cubic = {"potential": lambda u: u**4 / 4, "force": lambda u: u**3}
    effects = [
        *(part for a, b in ((one, two), (two, three)) for part in (
            vf.Spring(a, b, stiffness=1.0), vf.Dashpot(a, b, damping=0.02))),
        vf.BilinearSpring(one, stiffness=20.0, linear_limit=0.05),
        vf.BilinearSpring(one, two, stiffness=20.0, linear_limit=0.05),
        vf.NonlinearSpring(two, **cubic), vf.NonlinearSpring(two, three, **cubic),
        vf.Contact(three, gap=0.25, stiffness=1.0, side="above", acts_on="penetration"),
    ]  # fmt: skip
    omega = 1.5
    scene = vf.Scene(masses, [*effects, vf.PointLoad(two, vf.Sine(1.0, omega, phase=np.pi / 2))])
    steps = {"method": "energy_conserving", "dt": 2.0 * np.pi / omega / 160}
    # A guess, because the way from smaller loads would take most of the time.
    orbit = vf.periodic(scene, harmonics=25, guess=vf.simulate(scene, 80.0, **steps))
    run = vf.simulate(scene, 4 * orbit.period, initial=orbit, **steps)
    for mass in masses:
        off = run.displacement(mass, 3 * orbit.period + orbit.result.times) - orbit.result.displacement(mass)
        assert np.abs(off).max() < 2e-3 * orbit.amplitude(mass)


# -- the size of the problem ------------------------------------------------------------------------


def test_a_fine_mesh_costs_no_more_unknowns():
    def cantilever(elements):
        beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=elements, supports={"left": "clamped"})
        tip = beam.at(1.0)
        effects = [
            vf.Contact(tip, gap=0.01, stiffness=20.0, side="below", acts_on="penetration"),
            vf.PointLoad(tip, vf.Sine(0.1, omega=3.0)),
            vf.RayleighDamping(alpha=0.0, beta=0.02),
        ]
        return vf.Scene([beam], effects), tip

    amplitudes = []
    for elements in (30, 3000):
        scene, tip = cantilever(elements)
        problem = HarmonicBalance("test", scene, harmonics=12)
        assert problem.size == 25
        assert problem.evaluate(problem.from_rest()).jacobian.shape == (25, 25)
        orbit = vf.periodic(scene, method="harmonic_balance", harmonics=12)
        amplitudes.append(orbit.amplitude(tip))
        assert orbit.result.samples.along(scene.model.system.contacts.rows, "q").shape == (1, 1001)
    assert abs(amplitudes[0] / amplitudes[1] - 1.0) < 1e-5


# -- derivatives ------------------------------------------------------------------------------------


@settings(max_examples=15, deadline=None)
@given(law=st.sampled_from(sorted(LAWS)), seed=st.integers(0, 10_000))
def test_jacobian_is_the_derivative(law, seed):
    scene, _ = oscillator(vf.Sine(0.5, 0.8), LAWS[law])
    problem = HarmonicBalance("test", scene, harmonics=4)
    random = np.random.default_rng(seed)
    x = 0.6 * random.standard_normal(problem.size) / (1.0 + np.arange(problem.size) % 5) ** 1.5
    jacobian = problem.evaluate(x).jacobian
    step = 1e-6
    for k in range(problem.size):
        change = step * np.eye(problem.size)[k]
        up, down = (problem.evaluate(x + sign * change, derivative=False).residual for sign in (1.0, -1.0))
        np.testing.assert_allclose(
            (up - down) / (2 * step), jacobian[:, k], atol=2e-5 * max(1.0, np.abs(jacobian).max())
        )


# -- what is refused --------------------------------------------------------------------------------


def test_what_harmonic_balance_cannot_treat():
    def refused(error, pattern, load, *effects, **options):
        scene, _ = oscillator(load, *effects)
        with pytest.raises(error, match=pattern):
            vf.periodic(scene, **({"method": "harmonic_balance"} | options))

    sine = vf.Sine(1.0, 1.0)
    refused(vf.ArgumentError, "harmonics is 0", sine, harmonics=0)
    refused(vf.ArgumentError, "harmonics is 2.5", sine, harmonics=2.5)
    refused(vf.ArgumentError, "harmonics was given", sine, harmonics=3, method="shooting")
    refused(vf.ArgumentError, "is harmonic 9", sine + vf.Sine(0.1, 9.0), harmonics=2)
    refused(vf.ArgumentError, "not periodic", vf.Ramp(1.0) + sine)
    refused(vf.ArgumentError, "nothing sets the period", vf.Constant(1.0))
    refused(
        vf.ArgumentError,
        "varies in time",
        sine,
        lambda m: vf.Springpot(m, coefficient=1.0, order=lambda t: 0.5 + 0 * t),
    )
    mass = vf.Mass(1.0)
    printed = vf.HystereticSpring(mass, stiffness=1.0, linear_limit=0.1, memory="printed")
    with pytest.raises(vf.MethodError, match="no law that harmonic balance knows"):
        vf.periodic(vf.Scene([mass], [printed, vf.PointLoad(mass, sine)]))
    refused(vf.ArgumentError, "takes a PeriodicOrbit", sine, LAWS["bilinear"], guess=3.0)
    scene, _ = oscillator(sine, LAWS["bilinear"])
    refused(vf.ArgumentError, "holds no whole", sine, LAWS["bilinear"], guess=vf.simulate(scene, 1.0))


def test_loads_without_closed_form_need_their_period():
    with pytest.raises(vf.ArgumentError, match="period is not known"):
        vf.periodic(oscillator(lambda t: np.sin(2 * t), LAWS["smooth"])[0])
    given = vf.periodic(oscillator(lambda t: np.sin(2 * t), LAWS["smooth"])[0], period=np.pi)
    known = vf.periodic(oscillator(vf.Sine(1.0, 2.0), LAWS["smooth"])[0])
    np.testing.assert_allclose(
        given.result.displacement(given.scene.bodies[0]), known.result.displacement(known.scene.bodies[0]), atol=1e-12
    )


def test_a_branch_goes_on_where_a_slider_begins_to_slip():
    """There it has a corner, which no step is short enough to round."""

    def build(omega):
        beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=20, supports={"left": "clamped"}, name="beam")
        slider = vf.BilinearSpring(beam.at(0.5), stiffness=40.0, linear_limit=0.002, name="slider")
        return vf.Scene([beam], [slider, vf.ModalDamping(0.02), vf.PointLoad(beam.at(1.0), vf.Sine(0.02, omega))])

    branch = vf.continuation(build, 2.5, 5.5, harmonics=5)
    assert branch.values[-1] == 5.5
    assert not branch.notes
    middle = build(1.0).bodies[0].at(0.5)
    reached = branch.amplitude(middle)
    assert reached[0] < 0.002 < reached.max()
    known = vf.periodic(build(4.2), harmonics=5)
    (found,) = branch.at(4.2)
    assert found.amplitude(middle) == pytest.approx(known.amplitude(middle), rel=1e-9)


def test_branches_are_saved_with_their_harmonics(tmp_path):
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="m")
    spring = vf.BilinearSpring(mass, stiffness=0.5, linear_limit=0.5, name="s")
    branch = vf.continuation(
        lambda omega: vf.Scene([mass], [spring, vf.PointLoad(mass, vf.Sine(0.3, omega))]), 0.8, 0.9, harmonics=7
    )
    loaded = vf.load(branch.save(tmp_path / "branch.h5"))
    np.testing.assert_array_equal(loaded.values, branch.values)
    for one, other in zip(loaded.orbits, branch.orbits, strict=True):
        np.testing.assert_allclose(
            one.result.displacement(one.scene.bodies[0]), other.result.displacement(mass), rtol=0, atol=1e-13
        )


def test_an_orbit_alone_is_not_saved_as_a_run(tmp_path):
    """The message names both ways to keep it."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="mass")
    stop = vf.Contact(mass, gap=0.5, stiffness=8.0, side="above", acts_on="penetration", name="stop")
    scene = vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, 0.6))])
    orbit = vf.periodic(scene, method="harmonic_balance", harmonics=15)
    with pytest.raises(vf.ArgumentError, match=r"continuation.*initial=orbit"):
        orbit.result.save(tmp_path / "orbit.vtkhdf")
    assert not list(tmp_path.iterdir())
    run = vf.simulate(scene, orbit.period, initial=orbit)
    run.save(tmp_path / "run.vtkhdf")
    assert vf.load(tmp_path / "run.vtkhdf").displacement(mass)[-1] == pytest.approx(run.displacement(mass)[0], abs=1e-3)


def test_a_spring_with_a_law_in_python_has_the_same_branch_in_all_units_of_length() -> None:
    """Folds and multipliers of Duffing's oscillator in metres and in micrometres that are given in metres."""

    def branch(length: float) -> vf.Branch:
        mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="a")
        law = {
            "potential": vf.Polynomial((0, 0, 0, 0, 0.25 / length**2)),
            "force": vf.Polynomial((0, 0, 0, length**-2)),
        }
        spring = vf.NonlinearSpring(mass, name="n", **law)
        return vf.continuation(
            lambda omega: vf.Scene([mass], [spring, vf.PointLoad(mass, vf.Sine(0.3 * length, omega))]),
            0.8, 2.2, method="harmonic_balance", harmonics=9,
        )  # fmt: skip

    metres, micrometres = branch(1.0), branch(1e-6)
    assert [mark.kind for mark in micrometres.special] == ["fold", "fold"]
    for mine, known in zip(micrometres.special, metres.special, strict=True):
        assert mine.value == pytest.approx(known.value, rel=1e-7)
    for mine, known in zip(micrometres.at(1.6), metres.at(1.6), strict=True):
        np.testing.assert_allclose(mine.multipliers, known.multipliers, rtol=1e-6)
        assert mine.stability == known.stability


@pytest.mark.parametrize(("harmonics", "reference"), [(25, 0.279492), (60, 0.279492)])
def test_the_error_is_told_where_a_law_is_stiff(harmonics, reference):
    """What is left out changes the harmonics that are kept more than it adds; the reference is a settled exact run."""
    a, b = vf.Mass(1.0, stiffness=1.5, damping=0.04, name="a"), vf.Mass(0.7, damping=0.05, name="b")
    floor = vf.Friction(a, coefficient=1.0, normal=0.6, stiffness=1e4, name="floor")
    scene = vf.Scene([a, b], [vf.Spring(a, b, stiffness=1.2), floor, vf.PointLoad(b, vf.Sine(0.4, 1.3))])
    orbit = vf.periodic(scene, harmonics=harmonics)
    error = abs(orbit.amplitude(a) - reference) / reference
    assert 0.5 < orbit.truncation.error / error < 2.0


@pytest.mark.parametrize("sides", [("above",), ("above", "below")], ids=len)
def test_a_branch_that_is_lost_at_a_jump_holds_no_orbit_that_is_none(sides):
    """Few harmonics cannot follow a force that jumps through a grazing; all orbits before it solve the equations."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.03, name="m")
    stops = [vf.Contact(mass, gap=0.5, stiffness=1.0, side=side, acts_on="displacement", name=side) for side in sides]
    branch = vf.continuation(
        lambda omega: vf.Scene([mass], [*stops, vf.PointLoad(mass, vf.Sine(0.1, omega))]),
        0.6, 2.0, method="harmonic_balance", harmonics=10,
    )  # fmt: skip
    assert "lost" in branch.notes[-1]
    assert max(orbit.residual for orbit in branch.orbits) < 1e-9


@pytest.mark.parametrize("ends", [(0.3, 3.0), (3.0, 0.3)])
def test_a_branch_goes_on_where_the_stops_of_a_slider_become_more(ends):
    """At 0.4399 rad/s the branch turns by nearly a right angle, as seen in a wide interval."""

    def scene(omega):
        load = vf.Sine(1.0, omega)
        return oscillator(load, lambda m: vf.Friction(m, coefficient=0.5, normal=1.2, stiffness=2.0), damping=0.05)

    branch = vf.continuation(lambda omega: scene(omega)[0], *ends)
    assert branch.values[-1] == ends[-1]
    assert not branch.notes
    assert not branch.special
    for value in (0.43, 0.45):
        (found,), (own, mass) = branch.at(value), scene(value)
        assert found.amplitude(found.scene.bodies[0]) == pytest.approx(vf.periodic(own).amplitude(mass), rel=1e-9)


@pytest.mark.parametrize(("amplitude", "slips"), [(0.1, False), (2.0, True)])
def test_what_came_before_a_motion_is_told_where_it_stays(amplitude, slips):
    """A slider that a pulse has moved holds the mass aside, unless the steady motion moves it again."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.2, name="m")
    slider = vf.Friction(mass, coefficient=0.5, normal=1.0, stiffness=2.0, name="slider")
    load = vf.PointLoad(mass, vf.Sine(amplitude, 1.5))
    orbit = vf.periodic(vf.Scene([mass], [slider, load]), method="harmonic_balance")
    run = vf.simulate(vf.Scene([mass], [slider, load, vf.PointLoad(mass, vf.Pulse(3.0, 0.0, 5.0))]), 40 * orbit.period)
    times = np.linspace(38.0, 39.0, 101) * orbit.period
    aside = np.abs(run.displacement(mass, times) - orbit.result.displacement(mass, times % orbit.period)).max()
    assert (aside < 1e-3) == slips
    assert any("Friction 'slider' keeps traces" in note for note in orbit.notes) != slips


def chain_on_a_slider():
    """Return a function of a frequency: a chain of three masses with a stop and a slider at the first one."""
    masses = [vf.Mass(1.0, stiffness=0.94, name="a"), vf.Mass(1.83, name="b"), vf.Mass(1.68, name="c")]
    first, second, third = masses
    rest = [
        vf.Spring(first, second, stiffness=1.2),
        vf.Spring(second, third, stiffness=1.7),
        vf.ModalDamping(0.03),
        vf.Contact(first, side="below", gap=-33.1, stiffness=19.0, damping=0.6, acts_on="penetration", name="stop"),
        vf.Friction(first, coefficient=1.0, normal=10.6, stiffness=2.54, name="slider"),
        vf.PointLoad(third, vf.Constant(-0.7512), name="weight"),
    ]
    return lambda omega: vf.Scene(masses, [*rest, vf.PointLoad(third, vf.Sine(12.3, omega, 1.57), name="load")])


def test_no_step_leaves_out_a_loop():
    """The branch turns twice within 5e-4 rad/s, as it does where a shorter interval makes its steps shorter."""
    branch = vf.continuation(chain_on_a_slider(), 0.4345, 0.42, harmonics=10)
    assert {point.kind for point in branch.special} == {"fold"}
    values = [point.value for point in branch.special]
    np.testing.assert_allclose(values[:2], [0.4328448, 0.4333321], atol=1e-7)


def test_a_branch_turns_at_a_corner():
    """Where a slider stops once more, the branch turns at once: a fold without a level tangent, listed both ways."""
    build = chain_on_a_slider()
    lists = []
    for start, stop in ((0.438, 0.442), (0.442, 0.438)):
        branch = vf.continuation(build, start, stop, harmonics=3)
        assert branch.values[-1] == stop
        assert not branch.notes
        lists.append(sorted((point.value, point.kind) for point in branch.special))
    assert [kind for _, kind in lists[0]] == ["fold"] * 4
    np.testing.assert_allclose([value for value, _ in lists[0]], [value for value, _ in lists[1]], rtol=1e-11)
    # The second one is the corner: just beside it rates of the parameter are far from zero on both sides.
    corner = lists[0][0][0]
    assert corner == pytest.approx(0.4396395612, rel=1e-9)
    near = np.abs(branch.values - corner) < 1e-5
    assert near.sum() >= 2


def test_a_spring_that_saturates_has_the_same_multipliers_in_all_units_of_length() -> None:
    """Where the force is constant, differences of it must not reach to where it is not."""

    def multipliers(length: float) -> np.ndarray:
        mass = vf.Mass(1.0, stiffness=1.0, damping=0.05)
        spring = vf.NonlinearSpring(
            mass,
            potential=lambda u: length**2 * np.log(np.cosh(u / length)),
            force=lambda u: length * np.tanh(u / length),
        )
        scene = vf.Scene([mass], [spring, vf.PointLoad(mass, vf.Sine(8.0 * length, 0.7))])
        return np.sort_complex(vf.periodic(scene, method="harmonic_balance", harmonics=15).multipliers)

    with np.errstate(over="ignore"):
        np.testing.assert_allclose(multipliers(2.0**-30), multipliers(1.0), rtol=1e-9)
