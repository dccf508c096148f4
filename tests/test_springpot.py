"""Springpots: the fractional oscillator, dashpots and springs as limits, the whole past, energies."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import cantilever
from scipy.integrate import quad
from scipy.linalg import eigh
from scipy.optimize import newton

import vofem as vf
from vofem.fractional import StreamingDerivative, TabulatedOrder, rl_derivative

METHODS = ("energy_conserving", "generalized_alpha", "central_difference")

#: Released, struck, loaded: u(0), v(0) and a constant force.
STARTS = {"released": (1.0, 0.0, 0.0), "struck": (0.0, 1.0, 0.0), "loaded": (0.0, 0.0, 1.0)}


def exact(t, m, c, order, k, u0=0.0, v0=0.0, force=0.0):
    """``m u'' + c D^a u + k u = f``: two poles and the branch cut of the Laplace transform along the negative axis."""

    def bottom(s):
        return m * s**2 + c * s**order + k

    def slope(s):
        return 2.0 * m * s + c * order * s ** (order - 1.0)

    def top(s):
        return m * (s * u0 + v0) + c * s ** (order - 1.0) * u0 + force / s

    pole = newton(bottom, 1j * np.sqrt(k / m) - 0.05, slope, tol=1e-15, maxiter=200)
    turn = np.exp(1j * np.pi * order)

    def cut(x):
        r = math.exp(x)
        power = c * r**order * turn
        return math.exp(-r * t) * ((m * (v0 - r * u0) - power * u0 / r - force / r) / (m * r**2 + power + k)).imag * r

    spectrum = quad(cut, -60.0 / order, math.log(800.0 / t), limit=4000, epsabs=1e-14, epsrel=1e-12)[0]
    return 2.0 * (top(pole) / slope(pole) * np.exp(pole * t)).real - spectrum / np.pi + force / k


def oscillator(order, start, coefficient=0.7, **options):
    u0, v0, force = start
    mass = vf.Mass(1.0, stiffness=4.0, name="m")
    effects = [vf.Springpot(mass, coefficient=coefficient, order=order, name="s")]
    effects += [vf.PointLoad(mass, force)] if force else []
    return mass, vf.Scene([mass], effects, {mass: (u0, v0)}, **options)


@pytest.mark.parametrize("order", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("method", METHODS)
def test_second_order_to_the_exact_solution(method, order):
    """For all orders and starts, one with a velocity too, where the force begins like a root."""
    times = np.linspace(0.0, 4.0, 6)
    for start in STARTS.values():
        right = [exact(t, 1.0, 0.7, order, 4.0, *start) for t in times[1:]]
        errors = []
        for count in (100, 200, 400):
            mass, scene = oscillator(order, start)
            result = vf.simulate(scene, 4.0, method=method, dt=4.0 / count, times=times)
            errors.append(np.max(np.abs(result.displacement(mass)[1:] - right)))
        observed = np.log2(np.divide(errors[:-1], errors[1:]))
        assert np.all((observed > 1.93) & (observed < 2.07)), (start, observed)
        assert errors[-1] < 3e-4


def test_forces_are_those_of_the_exact_motion():
    """At steps and between; from the equation of motion, the exact displacement differentiated by differences."""
    errors = []
    for dt in (0.02, 0.01, 0.005):
        _, scene = oscillator(0.4, STARTS["released"])
        result = vf.simulate(scene, 3.0, dt=dt, times=[0.0, 1.0, 2.0 + 0.3 * dt, 2.9])
        assert result.springs["s"].force[0] == 0.0
        h, found = 1e-3, []
        for t in result.times[1:]:
            u = [exact(x, 1.0, 0.7, 0.4, 4.0, 1.0) for x in (t - 2 * h, t - h, t, t + h, t + 2 * h)]
            acceleration = (-u[0] + 16 * u[1] - 30 * u[2] + 16 * u[3] - u[4]) / (12 * h**2)
            found.append(-acceleration - 4.0 * u[2])
        errors.append(np.max(np.abs(result.springs["s"].force[1:] - found)))
    assert np.all(np.abs(np.log2(np.divide(errors[:-1], errors[1:])) - 2.0) < 0.15)
    assert errors[-1] < 1e-4


#: End of the runs of this beam, s. By then it has hit its stop twice.
T_END = 0.9
STEP = {"energy_conserving": 2e-3, "generalized_alpha": 1e-3, "central_difference": 4e-4}


def contact_beam(effect, initial=True):
    beam = cantilever(6, name="deck")
    stop = vf.Contact(
        beam.at(1.0), gap=0.05, stiffness=100.0, damping=0.3, side="above", acts_on="penetration", name="stop"
    )
    load = vf.PointLoad(beam.at(1.0), vf.Sine(1.0, 3.0))
    start = {beam: (0.0, lambda x: x**2)} if initial else None
    return beam, vf.Scene([beam], [effect(beam.at(0.7)), stop, load], start)


@pytest.mark.parametrize(("method", "within"), list(zip(METHODS, (1e-12, 2e-6, 1e-12), strict=True)))
def test_order_one_is_a_dashpot(method, within):
    """On a beam that hits a damped stop, between nodes; generalized_alpha has dashpots at another time."""
    dt = STEP[method]
    beam, scene = contact_beam(lambda point: vf.Dashpot(point, damping=0.5))
    dashpot = vf.simulate(scene, T_END, method=method, dt=dt)
    beam, scene = contact_beam(lambda point: vf.Springpot(point, coefficient=0.5, order=1.0, name="s"))
    result = vf.simulate(scene, T_END, method=method, dt=dt)
    assert dashpot.contacts["stop"].closings.size > 1
    difference = result.displacement(beam.at(1.0)) - dashpot.displacement(beam.at(1.0))
    assert np.max(np.abs(difference)) < within
    assert result.energy.dissipated == pytest.approx(dashpot.energy.dissipated, abs=100.0 * within)
    assert result.springs["s"].force == pytest.approx(0.5 * result.velocity(beam.at(0.7)), abs=3e-3)
    assert np.all(result.springs["s"].stored == 0.0)


@pytest.mark.parametrize(("method", "within"), list(zip(METHODS, (1e-12, 1e-6, 1e-6), strict=True)))
def test_order_zero_is_a_spring(method, within):
    dt = STEP[method]
    beam, scene = contact_beam(lambda point: vf.Spring(point, stiffness=5.0), initial=False)
    spring = vf.simulate(scene, T_END, method=method, dt=dt)
    beam, scene = contact_beam(
        lambda point: vf.Springpot(point, coefficient=5.0, order=lambda t: 0.0 * t, name="s"), initial=False
    )
    result = vf.simulate(scene, T_END, method=method, dt=dt)
    found = result.springs["s"]
    assert np.max(np.abs(result.displacement(beam.at(1.0)) - spring.displacement(beam.at(1.0)))) < within
    assert found.force == pytest.approx(5.0 * found.elongation, abs=2e-4)
    assert found.stored == pytest.approx(2.5 * found.elongation**2, abs=1e-12)
    assert np.max(np.abs(found.dissipated)) < (1e-12 if method != "central_difference" else 1e-6)


@pytest.mark.parametrize("order", [1e-9, 1.0 - 1e-12])
def test_orders_next_to_the_ends(order):
    ends = {1e-9: lambda m: vf.Spring(m, stiffness=0.7), 1.0 - 1e-12: lambda m: vf.Dashpot(m, damping=0.7)}
    mass, scene = oscillator(order, STARTS["struck"])
    other = vf.Scene([mass], [ends[order](mass)], scene.initial)
    one, two = (vf.simulate(s, 4.0, method="energy_conserving", dt=0.01).displacement(mass) for s in (scene, other))
    assert one == pytest.approx(two, abs=1e-8)


def test_an_elongation_at_the_start_is_without_force():
    """Everything was at rest before t = 0, in its place: a mass on springpots alone stays there."""
    a, b = vf.Mass(1.0, name="a"), vf.Mass(1.0, name="b")
    effects = [vf.Springpot(a, coefficient=3.0, order=0.3, name="s"), vf.Springpot(a, b, coefficient=3.0, order=0.7)]
    for method in METHODS:
        result = vf.simulate(vf.Scene([a, b], effects, {a: (0.5, 0.0)}), 2.0, method=method, dt=0.01)
        assert np.all(result.displacement(a) == 0.5)
        assert np.all(result.springs["s"].force == 0.0)
        assert np.all(result.springs["s"].elongation == 0.5)


# -- the whole past ---------------------------------------------------------------------------------


def dense(dt, count, orders, m, c, k, u0, v0):
    """The midpoint rule with the means of the force summed over all steps, order frozen in each: O(n^2).

    ``I^(2-a)`` of a step of unit rate, differenced, is the mean of its force over later steps.
    """
    u, v, rates, path = u0, v0, np.zeros(count), [u0]
    for n in range(count):
        q = 2.0 - orders[n]
        x = dt * np.arange(n + 2.0) ** 1.0
        ramp = x**q / math.gamma(q + 1.0)
        weight = np.diff(ramp, n=2) / dt
        slope, rest = ramp[1] / dt, float(weight @ rates[:n][::-1]) if n else 0.0
        p = (2.0 * m * v / dt - k * u - c * rest) / (2.0 * m / dt + 0.5 * k * dt + c * slope)
        rates[n], u, v = p, u + dt * p, 2.0 * p - v
        path.append(u)
    return np.array(path)


@pytest.mark.parametrize(
    "law",
    [
        0.37,
        lambda t: 0.5 + 0.45 * np.sin(2.0 * t),
        TabulatedOrder([0.0, 1.0, 3.0], [0.0, 1.0, 0.2]),
        lambda t: np.where(t < 2.0, 0.9, 0.1),
    ],
    ids=["constant", "sine", "table", "jump"],
)
def test_the_past_is_that_of_a_dense_sum(law):
    """Some fifty numbers stand for all of 1500 steps, under an order that varies too."""
    count, dt = 1500, 4e-3
    mass, scene = oscillator(law, (1.0, -0.5, 0.0))
    result = vf.simulate(scene, count * dt, dt=dt)
    middles = (np.arange(count) + 0.5) * dt
    orders = np.broadcast_to(law(middles) if callable(law) else law, count)
    assert result.displacement(mass) == pytest.approx(dense(dt, count, orders, 1.0, 0.7, 4.0, 1.0, -0.5), abs=1e-10)
    assert result.counters.history_terms < 60
    assert result.energy.balance_error < 1e-12


@pytest.mark.parametrize("method", METHODS)
def test_forces_of_an_order_that_varies(method):
    """What is told of the force is the derivative, under the order of each time, of what is told of the motion."""

    def law(t):
        return 0.6 + 0.3 * np.cos(1.5 * t)

    errors = []
    for dt in (0.02, 0.01, 0.005):
        mass, scene = oscillator(law, STARTS["loaded"])
        result = vf.simulate(scene, 4.0, method=method, dt=dt)
        right = 0.7 * rl_derivative(result.displacement(mass), result.times, law)
        errors.append(np.max(np.abs(result.springs["s"].force - right)[result.times > 1.0]))
    assert np.all(np.abs(np.log2(np.divide(errors[:-1], errors[1:])) - 2.0) < 0.2)
    assert errors[-1] < 5e-5


@pytest.mark.parametrize("method", METHODS)
def test_a_springpot_on_a_beam(method):
    """Against a beam in modes by the trapezoidal rule, with a `StreamingDerivative` driven by hand.

    Its mean over both ends of a step, of rates that are linear, is the mean over the step of rates that are
    constant: energy_conserving agrees to rounding, the others as their order says.
    """
    beam = cantilever(4)
    point = beam.at(0.61)
    scene = vf.Scene([beam], [vf.Springpot(point, coefficient=2.0, order=0.45), vf.PointLoad(beam.at(1.0), 1.0)])
    system = scene.model.system
    squares, shapes = eigh(system.stiffness.toarray(), system.mass.toarray())
    b = shapes.T @ system.laws[0].rows.toarray()[0]
    push = shapes.T @ system.loads[0].vector

    def by_hand(dt, count):
        """Newmark's average acceleration in modes."""
        stream = StreamingDerivative(dt, count * dt, 0.45)
        z, rate = np.zeros(8), np.zeros(8)
        acceleration, bottom = push.copy(), 1.0 + 0.25 * dt**2 * squares
        for _ in range(count):
            slope, rest = stream.affine()
            ahead = z + dt * rate + 0.25 * dt**2 * acceleration
            half = rate + 0.5 * dt * acceleration
            free = (push - squares * ahead) / bottom
            answer = b / bottom
            # The force at the end, affine in the velocity of the point there.
            force = 2.0 * (rest + slope * (b @ (half + 0.5 * dt * free)))
            force /= 1.0 + 2.0 * slope * 0.5 * dt * (b @ answer)
            acceleration = free - answer * force
            z, rate = ahead + 0.25 * dt**2 * acceleration, half + 0.5 * dt * acceleration
            stream.commit(float(b @ rate))
        return float(b @ z)

    differences = []
    for count in (4000, 8000):
        result = vf.simulate(scene, 2.0, method=method, dt=2.0 / count, times=[0.0, 2.0])
        differences.append(abs(result.displacement(point)[-1] - by_hand(2.0 / count, count)))
    if method == "energy_conserving":
        assert max(differences) < 1e-11
    else:
        assert differences[1] < {"generalized_alpha": 1e-6, "central_difference": 1e-5}[method]
        assert differences[0] > 3.0 * differences[1]


# -- energies ---------------------------------------------------------------------------------------


@given(
    st.lists(st.floats(0.001, 1.0), min_size=1, max_size=3), st.floats(-3.0, 1.0), st.integers(0, 2**32 - 1),
    st.floats(-2.0, 3.0), st.booleans(),
)  # fmt: skip
@settings(max_examples=40)
def test_springpots_only_take_energy(orders, log_dt, seed, log_coefficient, yields):
    """From rest, under random loads and whatever the step, beside contacts, a dashpot and a spring that yields.

    The kinds of laws are those of the scene with all laws in test_kernel_modes.py, so both use the same kernels.
    """
    random = np.random.default_rng(seed)
    masses = [vf.Mass(10.0 ** random.uniform(-1, 1), 0.1) for _ in orders]
    effects = [
        vf.Springpot(a, b, coefficient=10.0**log_coefficient, order=order)
        for a, b, order in zip(masses, [None, *masses], orders, strict=False)
    ]
    dt = 10.0**log_dt
    load = vf.Tabulated(np.arange(101) * 2.0 * dt, random.standard_normal(101))
    more = [
        vf.PointLoad(masses[-1], load),
        vf.Contact(masses[0], gap=0.01, stiffness=50.0, damping=0.2, side="above", acts_on="penetration"),
        vf.Contact(masses[0], gap=0.02, stiffness=30.0, side="below", acts_on="penetration", switch=vf.Resolved(100.0)),
        vf.Dashpot(masses[0], damping=0.1),
        vf.NonlinearSpring(masses[0], potential=lambda u: u**4, force=lambda u: 4.0 * u**3),
        vf.BilinearSpring(masses[-1], stiffness=3.0, linear_limit=0.02 if yields else 1e6),
    ]
    scene = vf.Scene(masses, effects + more)
    result = vf.simulate(scene, 200 * dt, method="energy_conserving", dt=dt)
    assert result.energy.balance_error < 1e-10
    size = np.max(np.abs(result.energy.work)) + 1e-300
    for effect in effects:
        spring = result.springs[effect.name]
        assert np.all(spring.stored >= 0.0)
        assert np.all(np.diff(spring.dissipated) >= -1e-13 * size)
        # Up to order 1 the elements take what the force's work is, at any step.
        assert np.all(spring.dissipated + spring.stored >= -1e-13 * size)
    assert result.counters.history_updates == 200 * len(orders)


def test_what_is_held_and_what_is_lost():
    """Stretched at a constant rate: ``F = c t^(1-a)/Gamma(2-a)``, and twice the work at t less that at 2t is held.

    What exponentials hold, ``sum w y^2/2``, is the double integral of the kernel at the sum of both ages:
    ``c t^(2-a) (2^(2-a) - 2)/(2 Gamma(3-a))``.
    """
    a, c, t = 0.4, 3.0, 2.0
    heavy = vf.Mass(1e12, name="m")
    scene = vf.Scene([heavy], [vf.Springpot(heavy, coefficient=c, order=a, name="s")], {heavy: (0.0, 1.0)})
    for method in METHODS:
        spring = vf.simulate(scene, t, method=method, dt=t / 4000).springs["s"]
        absorbed = c * t ** (2.0 - a) / math.gamma(3.0 - a)
        held = absorbed * (2.0 ** (1.0 - a) - 1.0)
        assert spring.force[-1] == pytest.approx(c * t ** (1.0 - a) / math.gamma(2.0 - a), rel=1e-4)
        assert spring.stored[-1] == pytest.approx(held, rel=1e-7)
        assert spring.dissipated[-1] == pytest.approx(absorbed - held, rel=2e-5)


@pytest.mark.parametrize("method", METHODS)
def test_the_balance_of_energy_of_every_method(method):
    beam, scene = contact_beam(lambda point: vf.Springpot(point, coefficient=0.5, order=0.5, name="s"))
    result = vf.simulate(scene, T_END, method=method, dt=STEP[method])
    assert result.energy.balance_error < {"energy_conserving": 1e-12}.get(method, 1e-4)
    assert result.springs["s"].dissipated[-1] > 0.01
    assert result.energy.dissipated[-1] > result.springs["s"].dissipated[-1]
    assert beam in scene.bodies


def test_central_differences_keep_their_critical_step():
    """However strong the springpot: it is implicit, and what it leaves of the fastest motion dies out."""
    mass = vf.Mass(1.0, stiffness=4.0)
    for order in (0.01, 0.5, 1.0):
        scene = vf.Scene([mass], [vf.Springpot(mass, coefficient=1e2, order=order), vf.PointLoad(mass, 1.0)])
        result = vf.simulate(scene, 2000.0, method="central_difference", dt=0.8)
        u = result.displacement(mass)
        assert np.max(np.abs(u)) < 2.0
        assert np.all(np.abs(u[-100:]) <= 0.25 + 1e-9)
        assert result.energy.balance_error < 1e-9
        with pytest.raises(vf.StepSizeError):
            vf.simulate(scene, 10.0, method="central_difference", dt=1.001)


@pytest.mark.parametrize("rho", [0.8, 1.0])
def test_hard_springpots_in_generalized_alpha(rho):
    """Nearly springs, 1e5 times as stiff as the beam: it stops with an error, or keeps the balance."""
    beam = cantilever(10)
    hard = [vf.Springpot(beam.at(x), coefficient=1e6, order=1e-3) for x in (0.33, 0.7, 1.0)]
    scene = vf.Scene([beam], [*hard, vf.PointLoad(beam.at(0.5), vf.Sine(1.0, 3.0))])
    options = {"method": "generalized_alpha", "dt": 1e-3, "rho_infinity": rho}
    if rho < 1.0:
        with pytest.raises(vf.InstabilityError, match=r"generalized_alpha blew up .*energy_conserving"):
            vf.simulate(scene, 10.0, **options)
    else:
        assert vf.simulate(scene, 1.0, **options).energy.balance_error < 1e-12


# -- steps that follow a tolerance, cost ------------------------------------------------------------


@pytest.mark.parametrize("start", STARTS)
def test_steps_that_follow_a_tolerance(start):
    times = np.linspace(0.0, 8.0, 9)
    right = [exact(t, 1.0, 0.7, 0.6, 4.0, *STARTS[start]) for t in times[1:]]
    for tol in (1e-3, 1e-5):
        mass, scene = oscillator(0.6, STARTS[start])
        result = vf.simulate(scene, 8.0, tol=tol, times=times)
        assert np.max(np.abs(result.displacement(mass)[1:] - right)) < tol * max(
            STARTS[start][0], np.max(np.abs(right))
        )
        assert result.counters.history_updates == result.counters.steps


def test_tolerance_with_rejected_steps_keeps_the_balance():
    """A stop that the steps run into; at times that are steps the balance closes to rounding."""
    mass = vf.Mass(1.0, stiffness=4.0)
    effects = [
        vf.Springpot(mass, coefficient=0.5, order=lambda t: 0.5 + 0.4 * np.sin(t), name="s"),
        vf.Contact(mass, gap=0.2, stiffness=1e4, side="above", acts_on="penetration"),
    ]
    result = vf.simulate(vf.Scene([mass], effects, {mass: (0.0, 1.0)}), 1.0, tol=1e-4, times=[0.0, 0.5, 1.0])
    assert result.counters.rejected > 0
    assert result.energy.balance_error < 1e-11
    fixed = vf.simulate(vf.Scene([mass], effects, {mass: (0.0, 1.0)}), 1.0, dt=1e-3, times=[0.0, 0.5, 1.0])
    assert result.displacement(mass) == pytest.approx(fixed.displacement(mass), abs=1e-4)


def test_the_past_grows_like_the_logarithm():
    terms = []
    for dt in (1e-1, 1e-3, 1e-5):
        _, scene = oscillator(0.5, STARTS["struck"])
        counters = vf.simulate(scene, 1.0, dt=dt, times=[0.0, 1.0]).counters
        terms.append(counters.history_terms)
        assert counters.history_updates == counters.steps == round(1.0 / dt)
    assert terms[2] - terms[1] == pytest.approx(terms[1] - terms[0], abs=1)
    assert terms[2] < 70


@given(st.sampled_from(METHODS), st.floats(0.01, 1.0), st.integers(-3, 3))
@settings(max_examples=15)
def test_mirror_and_units_change_no_bit(method, order, power):
    """Forces, masses and stiffnesses by a power of four; all in the other direction."""
    results = []
    for scale, sign in ((1.0, 1.0), (4.0**power, 1.0), (1.0, -1.0)):
        mass = vf.Mass(scale, scale)
        effects = [
            vf.Springpot(mass, coefficient=0.3 * scale, order=order),
            vf.PointLoad(mass, vf.Sine(sign * scale, 0.8)),
        ]
        scene = vf.Scene([mass], effects, {mass: (0.3 * sign, sign)})
        results.append(sign * vf.simulate(scene, 10.0, method=method, dt=0.05).displacement(mass))
    assert np.array_equal(results[0], results[1])
    assert np.array_equal(results[0], results[2])
