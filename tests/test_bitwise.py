"""What must agree to the last bit."""

from __future__ import annotations

import types

import numba
import numpy as np
import pytest
from scenes import FORCES, LAWS, paper_beam, two_masses

import vofem as vf
from vofem.integrators.central_difference import setting, step


def integer_order_masses(case, acts_on, dt, steps):
    """Eq. 9 as an if-else over two sets of equations, by the same scheme; it knows nothing of orders."""
    load = [np.zeros(steps + 1) if f is None else f(np.arange(steps + 1) * dt) for f in FORCES[case]]
    c = (0.1, 0.4)
    inertia = [1.0 + 0.5 * dt * c[0], 1.0 + 0.5 * dt * c[1]]
    x = [0.0, 0.0]
    # Half a step back from the initial velocity (-1, 0), with the initial acceleration.
    start = [load[0][0] - 1.0 * x[0] - c[0] * -1.0, load[1][0] - 1.0 * x[1] - c[1] * 0.0]
    v = [-1.0 - 0.5 * dt * start[0], 0.0 - 0.5 * dt * start[1]]
    history = np.empty((2, steps + 1))
    for n in range(steps + 1):
        history[:, n] = x
        f1 = load[0][n] - 1.0 * x[0]
        f2 = load[1][n] - 1.0 * x[1]
        if x[0] - x[1] <= 5.0:  # Eq. 9a
            pass
        elif acts_on == "displacement":  # Eq. 9b
            f1 -= 2.0 * (x[0] - x[1])
            f2 += 2.0 * (x[0] - x[1])
        else:
            f1 -= 2.0 * (x[0] - x[1] - 5.0)
            f2 += 2.0 * (x[0] - x[1] - 5.0)
        f1 -= c[0] * v[0]
        f2 -= c[1] * v[1]
        v[0] += dt * (f1 / inertia[0])
        v[1] += dt * (f2 / inertia[1])
        x[0] += dt * v[0]
        x[1] += dt * v[1]
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


@pytest.fixture(scope="module")
def advance_by_if_else():
    """The kernel of central differences, with an if-else in place of the operator."""

    @numba.njit
    def if_else(law, resolved, s):
        if s > 0.0:
            return law["stiffness"]
        return 0.0

    kernel = step.advance.py_func
    assert "equivalent_stiffness" in kernel.__code__.co_names
    replaced = types.FunctionType(kernel.__code__, {**kernel.__globals__, "equivalent_stiffness": if_else})
    return numba.njit(replaced)


@pytest.mark.parametrize("acts_on", LAWS)
def test_variable_order_and_integer_order_beams_agree_bit_for_bit(acts_on, advance_by_if_else, monkeypatch):
    """The same compiled kernel, with an if-else in place of the operator (section 4.2)."""
    beam, scene = paper_beam(acts_on)
    arguments = {"method": "central_difference", "dt": 5e-5, "times": np.arange(801) * 5e-3}
    operator = vf.simulate(scene, 4.0, **arguments).displacement(beam.at(1.0))
    monkeypatch.setattr(setting, "advance", advance_by_if_else)
    plain = vf.simulate(scene, 4.0, **arguments)
    assert plain.counters.events > 0
    assert np.array_equal(plain.displacement(beam.at(1.0)), operator)


@pytest.mark.parametrize("method", ["event_driven", "central_difference"])
@pytest.mark.parametrize("acts_on", LAWS)
def test_a_gap_that_is_never_reached_changes_nothing(method, acts_on):
    arguments = {"method": method, "times": np.linspace(0.0, 2.0, 101)}
    if method == "central_difference":
        arguments["dt"] = 5e-5
    beam, free = paper_beam(acts_on, contact=False)
    tip = vf.simulate(free, 2.0, **arguments).displacement(beam.at(1.0))
    beam, far = paper_beam(acts_on, gap=10.0)
    result = vf.simulate(far, 2.0, **arguments)
    assert result.counters.events == 0
    assert result.counters.gap_evaluations > 0
    assert np.array_equal(result.displacement(beam.at(1.0)), tip)


@pytest.mark.parametrize("method", ["event_driven", "central_difference"])
def test_mirrored_scene_is_the_negative(method):
    step = {"dt": 5e-5} if method == "central_difference" else {}
    outcomes = []
    for side, sign in (("below", 1.0), ("above", -1.0)):
        beam = vf.Beam(1.0, 1.0, 1.0, 10, {"left": "clamped"})
        stop = vf.Contact(beam.at(1.0), gap=0.03, stiffness=10.0, side=side, acts_on="displacement", name="stop")
        scene = vf.Scene([beam], [stop, vf.PointLoad(beam.at(1.0), vf.Sine(sign * 0.1, 1.0))])
        result = vf.simulate(scene, 6.0, method=method, times=np.linspace(0.0, 6.0, 31), **step)
        outcomes.append((sign * result.displacement(beam.at(1.0)), result.contacts["stop"].force))
        assert result.counters.events > 0
    assert np.array_equal(outcomes[0][0], outcomes[1][0])
    assert np.array_equal(outcomes[0][1], outcomes[1][1])
