"""What must agree to the last bit."""

import numpy as np
import pytest
from scenes import FORCES, LAWS, cantilever, two_masses

import vofem as vf


def integer_order_masses(case, acts_on, dt, steps):
    """Eq. 9 as an if-else over two sets of equations, by the same scheme; it knows nothing of orders."""
    load = [np.zeros(steps + 1) if f is None else f(np.arange(steps + 1) * dt) for f in FORCES[case]]
    c = (0.1, 0.4)
    inertia = [1.0 + 0.5 * dt * c[0], 1.0 + 0.5 * dt * c[1]]
    x, v = [0.0, 0.0], [-1.0, 0.0]
    a = [load[0][0] - 1.0 * x[0] - c[0] * v[0], load[1][0] - 1.0 * x[1] - c[1] * v[1]]
    history = np.empty((2, steps + 1))
    history[:, 0] = x
    for n in range(1, steps + 1):
        for i in range(2):
            x[i] = (x[i] + dt * v[i]) + dt * dt * 0.5 * a[i]
            v[i] += dt * 0.5 * a[i]
        history[:, n] = x
        f1 = load[0][n] - 1.0 * x[0] - c[0] * v[0]
        f2 = load[1][n] - 1.0 * x[1] - c[1] * v[1]
        if x[0] - x[1] <= 5.0:  # Eq. 9a
            pass
        elif acts_on == "displacement":  # Eq. 9b
            f1 -= 2.0 * (x[0] - x[1])
            f2 += 2.0 * (x[0] - x[1])
        else:
            f1 -= 2.0 * (x[0] - x[1] - 5.0)
            f2 += 2.0 * (x[0] - x[1] - 5.0)
        a = [f1 / inertia[0], f2 / inertia[1]]
        for i in range(2):
            v[i] += dt * 0.5 * a[i]
    return history


@pytest.mark.parametrize("acts_on", LAWS)
@pytest.mark.parametrize("case", ["a", "b", "c"])
def test_variable_order_and_integer_order_masses_agree_bit_for_bit(case, acts_on):
    """The paper's "error is exactly zero" (section 4.1)."""
    dt, steps = 1e-3, 30_000
    first, second, scene = two_masses(case, acts_on)
    times = np.arange(steps + 1) * dt
    result = vf.simulate(scene, steps * dt, method="central_difference", dt=dt, times=times)
    expected = integer_order_masses(case, acts_on, dt, steps)
    assert np.array_equal(result.displacement(first), expected[0])
    assert np.array_equal(result.displacement(second), expected[1])
    if case != "a":
        assert result.counters.events > 0


@pytest.mark.parametrize("method", ["event_driven", "central_difference"])
def test_mirrored_scene_is_the_negative(method):
    step = {"dt": 5e-5} if method == "central_difference" else {}
    outcomes = []
    for side, sign in (("below", 1.0), ("above", -1.0)):
        beam = cantilever(10)
        stop = vf.Contact(beam.at(1.0), gap=0.03, stiffness=10.0, side=side, acts_on="displacement", name="stop")
        scene = vf.Scene([beam], [stop, vf.PointLoad(beam.at(1.0), vf.Sine(sign * 0.1, 1.0))])
        result = vf.simulate(scene, 6.0, method=method, times=np.linspace(0.0, 6.0, 31), **step)
        outcomes.append((sign * result.displacement(beam.at(1.0)), result.contacts["stop"].force))
        assert result.counters.events > 0
    assert np.array_equal(outcomes[0][0], outcomes[1][0])
    assert np.array_equal(outcomes[0][1], outcomes[1][1])
