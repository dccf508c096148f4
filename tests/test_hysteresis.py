"""Hysteretic springs: their laws, paths of equilibria, and what is refused."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import cantilever
from scipy.optimize import brentq

import vofem as vf
from vofem.laws.law import COMMIT, FORCE, LOSS, MEAN, STORED

#: Numbers of section 4.3: K = 1 N/m, d0 = 5 m.
PAPER = {"stiffness": 1.0, "linear_limit": 5.0}


def paper_scene(memory, *more, **changes):
    mass = vf.Mass(1.0, name="m")
    spring = vf.HystereticSpring(mass, **{**PAPER, **changes}, memory=memory, name="s")
    return mass, vf.Scene([mass], [spring, vf.PointLoad(mass, 1.0), *more])


def path(scene, mass, factors):
    return vf.quasi_static(scene, factors).displacement(mass)


def law_of(spring):
    """Return one law, and what a run keeps of it: energy dissipated and internal variables."""
    law = spring._law
    return law, law.virgin()


def asked(what):
    """Return a function that asks a law on the path between two elongations."""
    return lambda law, state, u0, u1: law.function(what, law.parameters, state[1:], float(u0), float(u1))


memory_mean = asked(MEAN)


def at_end(what):
    """Return a function that asks a law at an elongation."""
    return lambda law, state, u: asked(what)(law, state, u, u)


memory_force, memory_stored, memory_loss = at_end(FORCE), at_end(STORED), at_end(LOSS)


def commit(law, state, u):
    state[0] += memory_loss(law, state, u)
    at_end(COMMIT)(law, state, u)


# -- Eqs. 24-26 -------------------------------------------------------------------------------------


@pytest.mark.parametrize("memory", ["printed", "cyclic"])
@pytest.mark.parametrize(("top", "peak", "residual"), [(4.0, 4.0, 0.0), (6.0, 8.0, 2.0), (7.0, 14.0, 7.0)])
@pytest.mark.parametrize("count", [1, 7, 100])
def test_cases_a_b_c(memory, top, peak, residual, count):
    mass, scene = paper_scene(memory)
    factors = np.concatenate([np.linspace(0.0, top, count + 1), np.linspace(top, 0.0, count + 1)[1:]])
    outcome = vf.quasi_static(scene, factors)
    xi = outcome.displacement(mass)
    assert xi[count] == pytest.approx(peak, rel=1e-14)
    assert xi[-1] == pytest.approx(residual, rel=1e-13, abs=1e-13)
    backbone = np.where(factors > 5.0, 4.0 * factors / (9.0 - np.minimum(factors, 8.0)), factors)
    assert xi[: count + 1] == pytest.approx(backbone[: count + 1], rel=1e-13)
    assert outcome.springs["s"].force == pytest.approx(factors, abs=1e-13)
    assert outcome.springs["s"].elongation == pytest.approx(xi, abs=1e-13)


def test_the_operators_equal_the_integer_order_law():
    """Eq. 22's stiffness by two operators on constants, and Eq. 26's by its branches."""
    spring = vf.HystereticSpring(vf.Mass(1.0), **PAPER, memory="printed")
    for xi in np.linspace(0.0, 20.0, 81):
        for force in np.linspace(0.0, 8.9, 90):
            for rising in (True, False):
                assert spring.operator_stiffness(xi, force, rising) == pytest.approx(
                    spring.integer_stiffness(xi, force, rising), rel=1e-15
                )
    mass, scene = paper_scene("printed")
    factors = np.concatenate([np.linspace(0.0, 7.0, 141), np.linspace(7.0, 0.0, 71)[1:]])
    xi, before, direction, integer = path(scene, mass, factors), 0.0, True, []
    top = at_top = 0.0
    for force in factors:
        direction = direction if force == before else force > before
        guess = force if force <= 5.0 else 6.0
        stiffness = spring.integer_stiffness(guess, force, direction)
        integer.append(force / stiffness + (0.0 if direction else top - at_top))
        if integer[-1] > top:
            top, at_top = integer[-1], force
        before = force
    assert xi == pytest.approx(np.array(integer), rel=1e-15)


def test_a_hold_keeps_the_direction():
    """F' = 0 at 6 N: 8 m, as by Eq. 26; Eq. 22 with sgn(0) = 0 would give 6 m."""
    mass, scene = paper_scene("printed")
    assert path(scene, mass, [0.0, 6.0, 6.0, 6.0, 5.0, 5.0]).tolist() == [0.0, 8.0, 8.0, 8.0, 7.0, 7.0]


def test_reloading_forgets_as_printed_and_remembers_as_cyclic():
    factors = [0.0, 7.0, 3.0, 3.0 + 1e-9, 6.0, 7.0, 8.0]
    mass, scene = paper_scene("printed")
    assert path(scene, mass, factors) == pytest.approx([0.0, 14.0, 10.0, 3.0, 8.0, 14.0, 32.0], abs=1e-8)
    mass, scene = paper_scene("cyclic")
    assert path(scene, mass, factors) == pytest.approx([0.0, 14.0, 10.0, 10.0, 13.0, 14.0, 32.0], abs=1e-8)


def test_compression_has_a_largest_force_of_its_own():
    """By hand: plastic parts 4F/(9 - F) - F are 7 m at 7 N, 12.5 m at 7.5 N and 24 m at 8 N."""
    mass, scene = paper_scene("cyclic")
    factors = [7.0, 0.0, -5.0, -7.0, 0.0, 7.0, 8.0, -7.0, -7.5, 0.0]
    expected = [14.0, 7.0, 2.0, -7.0, 0.0, 7.0, 7.0 + 1.0 + 17.0, 10.0, 17.0 - 5.5 - 7.5, 11.5]
    assert path(scene, mass, factors) == pytest.approx(expected, abs=1e-12)
    assert path(scene, mass, -np.array(factors)) == pytest.approx(-np.array(expected), abs=1e-12)


@pytest.mark.parametrize("memory", ["printed", "cyclic"])
@pytest.mark.parametrize("load", [9.0, 9.5, 20.0])
def test_a_limit_load_is_an_error(memory, load):
    mass, scene = paper_scene(memory)
    assert path(scene, mass, [8.999])[0] == pytest.approx(4.0 * 8.999 / 0.001, rel=1e-9)
    with pytest.raises(vf.LimitLoadError, match=f"HystereticSpring 's'.* {load:g} N at load factor {load:g}") as caught:
        vf.quasi_static(scene, [0.0, 5.0, load])
    assert (caught.value.load, caught.value.time, caught.value.limit) == (load, load, 9.0)


def test_sliders_slip_at_their_limit_load():
    """Elastic, perfectly plastic: 2 N/m up to 1 N, and no equilibrium from there on; hardening has no limit."""
    mass = vf.Mass(1.0, name="m")
    plastic = vf.BilinearSpring(mass, stiffness=2.0, linear_limit=0.5, name="p")
    scene = vf.Scene([mass], [plastic, vf.PointLoad(mass, 1.0)])
    assert path(scene, mass, [0.5, 0.999, -0.999]) == pytest.approx([0.25, 0.4995, -0.4995], rel=1e-13)
    for load in (1.0, 1.5, -2.0):
        with pytest.raises(vf.LimitLoadError, match="BilinearSpring 'p'"):
            vf.quasi_static(scene, [0.5, load])
    firm = vf.BilinearSpring(mass, stiffness=2.0, linear_limit=0.5, hardening=0.1)
    assert path(vf.Scene([mass], [firm, vf.PointLoad(mass, 1.0)]), mass, [3.0]) == pytest.approx([0.5 + 2.0 / 0.2])


# -- softening --------------------------------------------------------------------------------------


def test_softening_as_a_function_of_force():
    """A callable of Eq. 24 gives the hyperbola; another one is inverted."""
    factors = [3.0, 5.5, 7.0, 8.9, 2.0]
    mass, scene = paper_scene("cyclic")
    reference = path(scene, mass, factors)
    mass, scene = paper_scene("cyclic", softening=lambda force: (force - 5.0) / 4.0)
    assert path(scene, mass, factors) == pytest.approx(reference, rel=1e-9)
    mass, scene = paper_scene("cyclic", softening=lambda force: 1.0 - (5.0 / force) ** 3)
    # u = F/(K (5/F)^3): no limit load.
    assert path(scene, mass, [6.0, 20.0]) == pytest.approx([6.0**4 / 125.0, 20.0**4 / 125.0], rel=1e-9)
    spring = scene.effects[0]
    assert spring.limit_load == np.inf
    mass, scene = paper_scene("cyclic", softening=vf.LinearSoftening(1.0))
    assert scene.effects[0].limit_load == 6.0
    assert path(scene, mass, [5.5])[0] == pytest.approx(11.0, rel=1e-14)


def test_kinks_of_softening_are_found():
    def kinked(force):
        return 0.0 if force < 6.0 else 0.1 * (force - 6.0)

    mass, scene = paper_scene("cyclic", softening=kinked)
    assert scene.effects[0].limit_load == pytest.approx(16.0, rel=1e-12)
    assert path(scene, mass, [5.9, 6.5, 12.0]) == pytest.approx([5.9, 6.5 / 0.95, 12.0 / 0.4], rel=1e-9)


@pytest.mark.parametrize(
    ("softening", "message"),
    [
        (lambda force: 0.5, r"softening\(5\) is 0.5 at the force of the linear limit, expected 0"),
        (lambda force: np.sin(force - 5.0), "softening falls"),
        (lambda force: np.nan if force > 7.0 else 0.0, "expected a finite number"),
        (lambda force: "x", "raised ValueError"),
        (lambda force: 1.0 / (force - 5.0), "raised ZeroDivisionError"),
        (3.0, "softening is 3.0, expected a LinearSoftening or a callable"),
    ],
)
def test_bad_softening_is_refused(softening, message):
    with pytest.raises(vf.ArgumentError, match=message):
        vf.HystereticSpring(vf.Mass(1.0), **PAPER, softening=softening, memory="cyclic")


# -- properties of all laws -------------------------------------------------------------------------

MASS = vf.Mass(1.0)
SPRINGS = {
    "hysteretic": vf.HystereticSpring(MASS, stiffness=2.0, linear_limit=0.5, memory="cyclic"),
    "steep": vf.HystereticSpring(
        MASS, stiffness=2.0, linear_limit=0.5, softening=vf.LinearSoftening(1e-3), memory="cyclic"
    ),
    "long": vf.HystereticSpring(
        MASS, stiffness=2.0, linear_limit=0.5, softening=vf.LinearSoftening(1e6), memory="cyclic"
    ),
    "tabulated": vf.HystereticSpring(
        MASS, stiffness=2.0, linear_limit=0.5, softening=lambda force: 1.0 - np.exp(1.0 - force), memory="cyclic"
    ),
    "bilinear": vf.BilinearSpring(MASS, stiffness=2.0, linear_limit=0.5, hardening=0.1),
    "plastic": vf.BilinearSpring(MASS, stiffness=2.0, linear_limit=0.5),
    "iwan": vf.IwanSpring(MASS, elongation=[0.2, 0.5, 1.0, 3.0], force=[1.0, 2.0, 2.5, 3.0]),
    "stop": vf.CrushingStop(MASS, gap=0.3, side="above", stiffness=5.0, linear_limit=0.2),
}

turns = st.lists(st.floats(-8.0, 8.0), min_size=1, max_size=8)
kinds = st.sampled_from(sorted(SPRINGS))


@given(kinds, turns)
@settings(max_examples=150)
def test_energy_is_stored_or_lost_and_never_made(kind, points):
    memory, state = law_of(SPRINGS[kind])
    u0 = 0.0
    work = 0.0
    for u1 in points:
        before = memory_stored(memory, state, u0)
        loss = memory_loss(memory, state, u1)
        assert loss >= 0.0
        part = memory_mean(memory, state, u0, u1) * (u1 - u0)
        scale = abs(part) + before + loss + 1e-12
        assert part == pytest.approx(memory_stored(memory, state, u1) - before + loss, abs=2e-13 * scale)
        force = memory_force(memory, state, u1)
        commit(memory, state, u1)
        assert memory_force(memory, state, u1) == pytest.approx(force, abs=1e-13 * (1.0 + abs(force)))
        work += part
        u0 = u1
    held = memory_stored(memory, state, u0)
    assert work - held == pytest.approx(state[0], abs=1e-12 * (1.0 + state[0] + held))
    # Nothing comes back that was not put in.
    assert work >= -1e-13


@given(kinds, turns, st.floats(-8.0, 8.0), st.floats(-8.0, 8.0))
@settings(max_examples=150)
def test_mean_and_end_force_are_monotone(kind, points, first, second):
    """So a step has one solution."""
    memory, state = law_of(SPRINGS[kind])
    for u in points:
        commit(memory, state, u)
    low, high = min(first, second), max(first, second)
    slack = 1e-13 * (1.0 + abs(low) + abs(high))
    assert memory_force(memory, state, low) <= memory_force(memory, state, high) + slack
    means = [memory_mean(memory, state, points[-1], u) for u in (low, high)]
    # Very short paths know their mean to the digits of their ends.
    assert means[0] <= means[1] + 1e-12 * (1.0 + abs(points[-1]))


@given(kinds, turns, st.floats(-8.0, 8.0), st.integers(2, 9))
@settings(max_examples=100)
def test_a_path_may_be_walked_in_pieces(kind, points, end, pieces):
    """The laws do not depend on rates, nor on steps: the state of a monotone path is that of its end."""
    memory, state = law_of(SPRINGS[kind])
    for u in points:
        commit(memory, state, u)
    at_once, trial = state.copy(), state.copy()
    memory_mean(memory, trial, points[-1], end)
    memory_force(memory, trial, end)
    memory_loss(memory, trial, end)
    assert np.array_equal(trial, state)
    commit(memory, at_once, end)
    for u in np.linspace(points[-1], end, pieces + 1)[1:]:
        commit(memory, state, u)
    assert state == pytest.approx(at_once, rel=1e-11, abs=1e-12)


def forces(spring, points):
    """Return the forces along a path that turns at some points, a hundred on every stretch, and the points."""
    memory, state = law_of(spring)
    u = np.concatenate([np.linspace(a, b, 101)[1:] for a, b in pairwise([0.0, *points])])
    found = []
    for x in u:
        found.append(memory_force(memory, state, x))
        commit(memory, state, x)
    return u, np.array(found)


@pytest.mark.parametrize("kind", ["bilinear", "plastic", "iwan"])
def test_masing_s_rules(kind):
    """Branches after a reversal are the first loading, doubled; closed loops are wiped out."""
    spring = SPRINGS[kind]
    first = np.interp  # The first loading, by its points.
    if kind == "iwan":
        u, f = np.array([0.0, 0.2, 0.5, 1.0, 3.0, 8.0]), np.array([0.0, 1.0, 2.0, 2.5, 3.0, 4.25])
    else:
        after = 1.0 + 2.0 * spring.hardening * 7.5
        u, f = np.array([0.0, 0.5, 8.0]), np.array([0.0, 1.0, after])

    def backbone(x):
        return np.sign(x) * first(np.abs(x), u, f)

    x, force = forces(spring, [2.5, -2.5, 2.5])
    assert force[:100] == pytest.approx(backbone(x[:100]), abs=1e-13)
    assert force[100:200] == pytest.approx(backbone(2.5) + 2.0 * backbone((x[100:200] - 2.5) / 2.0), abs=1e-13)
    assert force[200:] == pytest.approx(-backbone(2.5) + 2.0 * backbone((x[200:] + 2.5) / 2.0), abs=1e-13)
    # A small loop within a large one leaves no trace once it is closed; beyond the first reversal the backbone goes on.
    x, force = forces(spring, [2.5, 1.0, 2.0, 1.0, 2.5, 4.0])
    assert force[-1] == pytest.approx(backbone(4.0), abs=1e-13)
    assert force[299] == pytest.approx(backbone(2.5) + 2.0 * backbone((2.0 - 2.5) / 2.0), abs=2.0)
    outer = backbone(2.5) + 2.0 * backbone((1.0 - 2.5) / 2.0)
    assert force[[199, 399]] == pytest.approx([outer, outer], abs=1e-13)


@pytest.mark.parametrize("kind", sorted(SPRINGS))
def test_loops_close_under_a_periodic_load(kind):
    """What one cycle dissipates is the area of its loop, and loops close."""
    spring, cycles = SPRINGS[kind], 40
    scene = vf.Scene([MASS], [spring, vf.Spring(MASS, stiffness=0.5), vf.PointLoad(MASS, 3.0)])
    cycle = np.interp(np.arange(1, 33), [0, 8, 24, 32], [0.0, 1.0, -1.0, 0.0])
    outcome = vf.quasi_static(scene, np.tile(cycle, cycles)).springs[spring.name]
    u = outcome.elongation.reshape(cycles, -1)
    # Beside another spring a law that hardens in both directions settles in the course of many cycles.
    settles = isinstance(spring, vf.HystereticSpring)
    assert u[-1] == pytest.approx(u[-2], abs=2e-3 if settles else 1e-12)
    lost = outcome.dissipated
    assert np.all(np.diff(lost) >= 0.0)
    force, way = outcome.force[-33:], np.diff(outcome.elongation[-33:])
    area = np.sum(0.5 * (force[1:] + force[:-1]) * way)
    assert lost[-1] - lost[-33] == pytest.approx(area, abs=0.02 * area + 1e-9)


def test_a_hysteretic_spring_alone_closes_its_loop_after_one_cycle():
    """Both largest forces are known after it; from then on it is elastic under this load."""
    _, scene = paper_scene("cyclic")
    cycle = np.interp(np.arange(1, 33), [0, 8, 24, 32], [0.0, 7.0, -7.0, 0.0])
    spring = vf.quasi_static(scene, np.tile(cycle, 3)).springs["s"]
    assert spring.elongation[32:64] == pytest.approx(spring.elongation[64:], abs=1e-12)
    assert spring.dissipated[31] == pytest.approx(2.0 * spring.dissipated[8], rel=1e-12)
    assert np.ptp(spring.dissipated[31:]) <= 1e-12 * spring.dissipated[31]


def test_hysteretic_loss_in_closed_form():
    """To 7 N of Eq. 24: work ``12.5 + 9 (9 - 4 ln 2)`` less ``49/2``."""
    found = vf.quasi_static(paper_scene("cyclic")[1], [7.0]).springs["s"]
    assert found.dissipated[0] == pytest.approx(12.5 + 9.0 * (9.0 - 4.0 * np.log(2.0)) - 24.5, rel=1e-14)


# -- paths of scenes --------------------------------------------------------------------------------


def test_a_hysteretic_support_of_a_beam():
    """With the tip compliance L^3/3EI: ``u = G (P - F(u))`` by a scalar solver, loading and unloading."""
    beam = cantilever(8)
    spring = vf.HystereticSpring(
        beam.at(1.0), stiffness=10.0, linear_limit=0.05, softening=vf.LinearSoftening(0.4), memory="cyclic", name="s"
    )
    outcome = vf.quasi_static(vf.Scene([beam], [spring, vf.PointLoad(beam.at(1.0), 1.0)]), [1.0, 2.0, 3.0, 2.0])

    def backbone(u):
        return 10.0 * u if u <= 0.05 else 0.9 * 10.0 * u / (0.4 + 10.0 * u)

    expected = [brentq(lambda u, load=load: u - (load - backbone(u)) / 3.0, 0.0, 2.0, xtol=1e-15) for load in (1, 2, 3)]
    tip = outcome.displacement(beam.at(1.0))
    assert tip[:3] == pytest.approx(expected, rel=1e-9)
    residual = expected[2] - backbone(expected[2]) / 10.0
    assert tip[3] == pytest.approx((2.0 + 10.0 * residual) / 13.0, rel=1e-9)
    assert outcome.deflection([0.5, 1.0])[1] == pytest.approx(tip, rel=1e-14)


def test_hysteretic_springs_and_contacts_together():
    """Two masses: a spring to ground that yields, then a contact that closes and passes load on."""
    first, second = vf.Mass(1.0, name="a"), vf.Mass(1.0, 2.0, name="b")
    effects = [
        vf.HystereticSpring(first, **PAPER, memory="cyclic", name="s"),
        vf.Contact(first, second, gap=7.0, stiffness=4.0, acts_on="penetration", name="c"),
        vf.PointLoad(first, 1.0),
    ]
    outcome = vf.quasi_static(vf.Scene([first, second], effects), [6.0, 10.0, 6.0, 0.0])

    def hyperbola(u):
        return 9.0 * u / (4.0 + u)

    # Contact and second spring in series: 4/3 N/m.
    top = [brentq(lambda u, f=f: hyperbola(u) + 4.0 / 3.0 * (u - 7.0) - f, 5.0, 20.0, xtol=1e-14) for f in (6.0, 10.0)]
    assert outcome.displacement(first)[:2] == pytest.approx(top, rel=1e-12)
    residual = top[1] - hyperbola(top[1])
    back = (6.0 + residual + 28.0 / 3.0) / (7.0 / 3.0)
    assert outcome.displacement(first)[2:] == pytest.approx([back, residual], rel=1e-12)
    assert outcome.contacts["c"].closed.tolist() == [True, True, True, False]
    assert outcome.contacts["c"].force[1] == pytest.approx(4.0 / 3.0 * (top[1] - 7.0), rel=1e-12)
    assert outcome.displacement(second)[1] == pytest.approx(2.0 / 3.0 * (top[1] - 7.0), rel=1e-12)
    assert outcome.springs["s"].force[3] == pytest.approx(0.0, abs=1e-12)


def test_a_pinned_contact_on_the_path():
    """Under the jump law the reaction makes up for what the spring does not carry, at the gap exactly."""
    mass = vf.Mass(1.0, name="m")
    effects = [
        vf.HystereticSpring(mass, **PAPER, memory="cyclic", name="s"),
        vf.Contact(mass, gap=6.0, stiffness=0.5, side="above", acts_on="displacement", name="c"),
        vf.PointLoad(mass, 1.0),
    ]
    outcome = vf.quasi_static(vf.Scene([mass], effects), [5.0, 6.0, 8.0, 10.0])
    at_gap = 9.0 * 6.0 / 10.0
    assert outcome.contacts["c"].pinned.tolist() == [False, True, True, False]
    assert outcome.displacement(mass)[1:3].tolist() == [6.0, 6.0]
    assert outcome.contacts["c"].force[1:3] == pytest.approx([6.0 - at_gap, 8.0 - at_gap], rel=1e-12)
    u = outcome.displacement(mass)[3]
    assert 9.0 * u / (4.0 + u) + 0.5 * u == pytest.approx(10.0, rel=1e-12)


def test_a_crushing_stop():
    """Behind its gap it is crushed, and stays so: the next load finds it later."""
    mass = vf.Mass(1.0, 1.0, name="m")
    stop = vf.CrushingStop(mass, gap=1.0, side="below", stiffness=1.0, linear_limit=5.0, name="k")
    outcome = vf.quasi_static(vf.Scene([mass], [stop, vf.PointLoad(mass, -1.0)]), [1.0, 16.0, 0.0, 8.0, 16.0, -3.0])
    u = brentq(lambda u: u + 9.0 * (u - 1.0) / (4.0 + (u - 1.0)) - 16.0, 1.0, 16.0, xtol=1e-14)
    dent = u - 1.0 - 9.0 * (u - 1.0) / (3.0 + u)
    expected = np.array([1.0, u, 0.0, (8.0 + 1.0 + dent) / 2.0 if 1.0 + dent < 8.0 else 8.0, u, -3.0])
    assert outcome.displacement(mass) == pytest.approx(-expected, rel=1e-12, abs=1e-12)
    assert outcome.springs["k"].force[[0, 2, 5]].tolist() == [0.0, 0.0, 0.0]
    assert outcome.springs["k"].elongation == pytest.approx(expected, rel=1e-12, abs=1e-12)
    lost = outcome.springs["k"].dissipated
    assert lost[0] == 0.0
    assert lost[1] > 0.0
    assert lost[1:] == pytest.approx(lost[1], rel=1e-12)


def test_several_springs_hold_a_loose_structure():
    """A rod on two springs, free otherwise: each bears what the levers say, to its own residual."""
    rod = vf.Beam(2.0, 1e6, 1.0, 4, {})
    springs = [vf.HystereticSpring(rod.at(x), **PAPER, memory="cyclic", name=str(x)) for x in (0.0, 2.0)]
    outcome = vf.quasi_static(vf.Scene([rod], [*springs, vf.PointLoad(rod.at(1.5), 1.0)]), [8.0, 0.0])
    assert outcome.springs["0.0"].force == pytest.approx([2.0, 0.0], abs=1e-6)
    assert outcome.springs["2.0"].force == pytest.approx([6.0, 0.0], abs=1e-6)
    assert outcome.displacement(rod.at(2.0)) == pytest.approx([8.0, 2.0], abs=1e-4)
    with pytest.raises(vf.SingularSystemError, match="can move freely"):
        vf.quasi_static(vf.Scene([rod], [springs[0], vf.PointLoad(rod.at(1.5), 1.0)]), [1.0])


def test_a_path_without_memory():
    mass = vf.Mass(1.0, 2.0, name="m")
    outcome = vf.quasi_static(vf.Scene([mass], [vf.PointLoad(mass, 4.0)]), [0.5, 1.0])
    assert outcome.displacement(mass).tolist() == [1.0, 2.0]
    stop = vf.Contact(mass, gap=1.0, stiffness=2.0, side="above", acts_on="penetration", name="c")
    outcome = vf.quasi_static(vf.Scene([mass], [stop, vf.PointLoad(mass, 4.0)]), [0.5, 1.0])
    assert outcome.displacement(mass) == pytest.approx([1.0, 1.5], rel=1e-14)


# -- refusals ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda m: vf.HystereticSpring(m, **PAPER), "memory is missing, expected one of 'printed', 'cyclic'"),
        (lambda m: vf.HystereticSpring(m, **PAPER, memory="cycle"), "did you mean 'cyclic'"),
        (lambda m: vf.HystereticSpring(m, stiffness=0.0, linear_limit=5.0, memory="cyclic"), "stiffness"),
        (lambda m: vf.HystereticSpring(m, stiffness=1.0, linear_limit=np.nan, memory="cyclic"), "linear_limit is NaN"),
        (lambda m: vf.LinearSoftening(0.0), "span"),
        (lambda m: vf.BilinearSpring(m, **PAPER, hardening=1.0), "hardening is 1, expected"),
        (lambda m: vf.IwanSpring(m, elongation=[1.0, 1.0], force=[1.0, 2.0]), r"elongation\[1\] is 1 m"),
        (lambda m: vf.IwanSpring(m, elongation=[1.0, 2.0], force=[1.0, 3.0]), "bends upward at 1 m, from 1 to 2 N/m"),
        (lambda m: vf.IwanSpring(m, elongation=[1.0, 2.0], force=[1.0, 0.5]), "force falls to 0.5 N"),
        (lambda m: vf.IwanSpring(m, elongation=[1.0, 2.0], force=[1.0]), "the same length"),
        (lambda m: vf.CrushingStop(m, gap=1.0, **PAPER), "side is missing"),
        (lambda m: vf.CrushingStop(m, vf.Mass(1.0), gap=1.0, side="below", **PAPER), "has none; remove it"),
    ],
)
def test_bad_arguments(make, message):
    with pytest.raises(vf.ArgumentError, match=message):
        make(vf.Mass(1.0))


def test_what_cannot_treat_memory_says_so():
    _, scene = paper_scene("cyclic")
    with pytest.raises(vf.MethodError, match=r"HystereticSpring 's' remembers its past.*energy_conserving"):
        vf.simulate(scene, 1.0, method="event_driven")
    with pytest.raises(vf.ArgumentError, match="HystereticSpring 's' has no modes"):
        vf.modes(scene, 1)
    with pytest.raises(vf.ArgumentError, match="quasi_static"):
        vf.equilibrium(scene)
    assert vf.explain(scene).method == "energy_conserving"
    assert "HystereticSpring 's' from Mass 'm' to ground: 1 N/m, linear to 5 m, limit load 9 N" in str(
        vf.explain(scene)
    )
    assert "hysteretic springs" not in vf.explain(scene).absent


def test_the_printed_law_is_for_a_single_loaded_mass():
    one, two = vf.Mass(1.0, name="a"), vf.Mass(1.0, 1.0, name="b")
    printed = vf.HystereticSpring(one, **PAPER, memory="printed", name="s")
    cases = [
        ([one, two], [printed], "2 degrees of freedom"),
        ([one], [printed, vf.Spring(one, stiffness=1.0)], "another spring"),
        ([one], [printed, vf.BilinearSpring(one, **PAPER)], "another hysteretic spring"),
        ([one], [printed, vf.Contact(one, gap=1.0, stiffness=1.0, side="above", acts_on="penetration", name="c")],
         "Contact 'c'"),
    ]  # fmt: skip
    for bodies, effects, what in cases:
        with pytest.raises(vf.ArgumentError, match=f"HystereticSpring 's'.*{what}. Use memory='cyclic'"):
            vf.quasi_static(vf.Scene(bodies, [*effects, vf.PointLoad(one, 1.0)]), [1.0])
    _, scene = paper_scene("printed")
    for method in ("energy_conserving", "generalized_alpha", "central_difference", "event_driven"):
        with pytest.raises(vf.MethodError, match="force_driven"):
            vf.simulate(scene, 1.0, method=method)
    with pytest.raises(vf.MethodError, match="choose method='auto'"):
        vf.simulate(paper_scene("cyclic")[1], 1.0, method="force_driven")


def test_a_path_says_where_elongations_turn_between_its_load_factors():
    """A stop closes within a step: the spring between the masses lengthens until then, and shortens beyond."""
    a, b = vf.Mass(1.0, stiffness=3.0, name="a"), vf.Mass(1.0, name="b")
    between = vf.BilinearSpring(b, a, stiffness=10.0, linear_limit=0.002, hardening=0.1, name="between")
    stop = vf.Contact(b, gap=0.1, stiffness=1e3, side="above", acts_on="penetration", name="stop")
    effects = [between, stop, vf.PointLoad(a, 1.0), vf.PointLoad(b, 0.5)]
    scene = vf.Scene([a, b], effects)
    coarse, fine = vf.quasi_static(scene, [0.3]), vf.quasi_static(scene, np.linspace(0.0, 0.3, 4001))
    forces = fine.springs["between"].force
    assert abs(coarse.springs["between"].force[-1] - forces[-1]) > 0.2 * np.max(forces)
    assert fine.notes == []
    assert any("give more factors" in note and "spring 'between' at load factor 0.3" in note for note in coarse.notes)
    # A step in which every elongation goes one way gives the same as many.
    once = vf.quasi_static(scene, [0.15, -1.0])
    many = vf.quasi_static(scene, np.concatenate([np.linspace(0.0, 0.15, 11), np.linspace(0.15, -1.0, 101)[1:]]))
    assert once.notes == many.notes == []
    assert once.springs["between"].force[-1] == pytest.approx(many.springs["between"].force[-1], rel=1e-12)


def test_quasi_static_refuses_what_it_cannot_do():
    mass, scene = paper_scene("cyclic")
    with pytest.raises(vf.ArgumentError, match="load_factors"):
        vf.quasi_static(scene, [0.0, np.nan])
    with pytest.raises(vf.ArgumentError, match="load_factors"):
        vf.quasi_static(scene, [])
    spring = scene.effects[0]
    with pytest.raises(vf.ArgumentError, match="are zero at t = 0"):
        vf.quasi_static(vf.Scene([mass], [spring, vf.PointLoad(mass, vf.Sine(1.0, 1.0))]), [1.0])
    with pytest.raises(vf.ArgumentError, match="the scene has no loads"):
        vf.quasi_static(vf.Scene([mass], [spring]), [1.0])
    with pytest.raises(vf.ArgumentError, match="springs named 's' occur more than once"):
        vf.quasi_static(vf.Scene([mass], [spring, spring, vf.PointLoad(mass, 1.0)]), [1.0])
    with pytest.raises(vf.ArgumentError, match=r"no hysteretic spring is named 't'"):
        vf.quasi_static(scene, [1.0]).springs["t"]
