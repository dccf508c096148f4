"""The flow of a system and its exact derivative, against differences of flows and what mechanics says of them."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scenes import on_stop

import vofem as vf
from vofem.integrators.event_driven.flow import Start, flow, modes_of
from vofem.system import PINNED, Counters


def end_of(system, state, stop, start=0.0):
    n = state.size // 2
    one = flow(system, Start(start, state[:n], state[n:]), stop)
    return np.concatenate([one.displacement, one.velocity]), one


def differences(system, state, stop, step=1e-6, start=0.0):
    columns = []
    for k in range(state.size):
        moved = np.zeros(state.size)
        moved[k] = step
        up, down = (end_of(system, state + sign * moved, stop, start)[0] for sign in (1.0, -1.0))
        columns.append((up - down) / (2.0 * step))
    return np.stack(columns, axis=1)


def monodromy(system, state, stop, start=0.0):
    n = state.size // 2
    return flow(system, Start(start, state[:n], state[n:]), stop, derivative=np.eye(2 * n))


numbers = st.floats(0.2, 3.0)


@st.composite
def chains(draw, damped=True, loaded=True):
    """Two masses between walls, with one to three contacts of either law."""
    masses = [vf.Mass(draw(numbers), stiffness=draw(numbers), damping=0.1 * draw(numbers) if damped else 0.0, name=n)
              for n in "ab"]  # fmt: skip
    effects = [vf.Spring(*masses, stiffness=draw(numbers))]
    if damped and draw(st.booleans()):
        effects.append(vf.Dashpot(*masses, damping=0.2 * draw(numbers)))
    for k in range(draw(st.integers(1, 3))):
        between = draw(st.booleans())
        effects.append(
            vf.Contact(
                masses[k % 2],
                masses[1 - k % 2] if between else None,
                gap=0.2 * draw(numbers),
                stiffness=10.0 * draw(numbers),
                damping=draw(st.sampled_from([0.0, 0.4])) if damped else 0.0,
                side=None if between else draw(st.sampled_from(["above", "below"])),
                acts_on=draw(st.sampled_from(["displacement", "penetration"])),
                name=f"c{k}",
            )
        )
    if loaded:
        effects.append(vf.PointLoad(masses[0], vf.Sine(draw(numbers), draw(numbers), draw(numbers))))
    state = np.array([0.1 * draw(numbers), -0.1 * draw(numbers), draw(numbers), -draw(numbers)])
    return vf.Scene(masses, effects), state


@settings(max_examples=60)
@given(chains())
def test_the_derivative_is_that_of_the_flow(case):
    """Dampers of contacts, forces that jump, several events: differences of the flow say the same."""
    scene, state = case
    system = scene.model.system
    one = monodromy(system, state, 6.0)
    rates = [abs(event.rate) for event in one.events]
    times = np.diff([0.0, *(event.time for event in one.events), 6.0])
    # Near grazings and simultaneous events differences say nothing.
    assume(min(rates, default=1.0) > 0.05)
    assume(times.min() > 1e-3)
    assume(all(event.after != PINNED for event in one.events))
    size = np.abs(one.monodromy).max()
    assume(size < 1e4)
    assert differences(system, state, 6.0) == pytest.approx(one.monodromy, abs=2e-5 * size)


@settings(max_examples=30)
@given(chains(damped=False, loaded=False))
def test_conservative_multipliers_come_in_reciprocal_pairs(case):
    scene, state = case
    one = monodromy(scene.model.system, state, 5.0)
    assume(min((abs(event.rate) for event in one.events), default=1.0) > 1e-2)
    assume(all(event.after != PINNED for event in one.events))
    assume(np.diff([0.0, *(event.time for event in one.events), 5.0]).min() > 1e-6)
    # The derivative is symplectic, M' J M = J, which is more.
    n = state.size // 2
    j = np.block([[np.zeros((n, n)), np.eye(n)], [-np.eye(n), np.zeros((n, n))]])
    size = np.abs(one.monodromy).max()
    assert one.monodromy.T @ j @ one.monodromy == pytest.approx(j, abs=1e-12 * size**2)


@settings(max_examples=30)
@given(chains())
def test_volumes_shrink_as_the_dampers_say(case):
    """det = exp(trace), with the dampers of contacts while these are closed: saltation matrices have determinant 1."""
    scene, state = case
    system = scene.model.system
    one = monodromy(system, state, 5.0)
    assume(all(event.after != PINNED for event in one.events))
    assume(min((abs(event.rate) for event in one.events), default=1.0) > 1e-2)
    inverse = np.linalg.inv(system.mass.toarray())
    rate = 0.0 if system.damping is None else np.trace(inverse @ system.damping.toarray())
    segments = one.solution.segments
    laws, rows = system.contacts, system.contacts.rows.toarray()
    exponent = -rate * 5.0
    for duration, status in zip(segments.durations, segments.status, strict=True):
        for j in np.flatnonzero(status == 1):
            exponent -= duration * laws.damping[j] * rows[j] @ inverse @ rows[j]
    assert np.linalg.det(one.monodromy) == pytest.approx(np.exp(exponent), rel=1e-9)


def twins(acts_on, damping, mirrored):
    """Two equal masses that meet equal stops at the same times, on one side or on opposite ones; and one of them."""
    masses = [vf.Mass(1.0, stiffness=1.0, damping=0.1, name=name) for name in "ab"]
    effects = []
    for mass, sign in zip(masses, (1.0, -1.0 if mirrored else 1.0), strict=True):
        side = "above" if sign > 0.0 else "below"
        effects += [
            vf.Contact(
                mass, gap=0.3, stiffness=12.0, damping=damping, side=side, acts_on=acts_on, name=f"on {mass.name}"
            ),
            vf.PointLoad(mass, vf.Sine(sign, 1.1)),
        ]
    alone = vf.Scene(masses[:1], effects[:2])
    if not mirrored:
        # Nothing of these acts on the common motion.
        effects += [vf.Spring(*masses, stiffness=0.7), vf.Dashpot(*masses, damping=0.2)]
    return vf.Scene(masses, effects), alone


@pytest.mark.parametrize("acts_on", ["penetration", "displacement"])
@pytest.mark.parametrize("damping", [0.0, 0.4])
@pytest.mark.parametrize("mirrored", [False, True])
def test_simultaneous_events(acts_on, damping, mirrored):
    """Two contacts that switch at once: the motion of one alone, and a derivative along which they switch in turn.

    Saltation matrices of contacts that switch at one time commute, so that no order is to be chosen.
    """
    both, alone = twins(acts_on, damping, mirrored)
    system, single = both.model.system, alone.model.system
    space = modes_of(system, Counters())
    sign = np.array([1.0, -1.0 if mirrored else 1.0])
    start = np.array([0.1, 0.8])
    state = np.concatenate([space.shapes.T @ (sign * part) for part in start])
    one, reference = monodromy(system, state, 12.0), monodromy(single, start, 12.0)
    assert len(reference.events) >= 4
    assert len(one.events) == 2 * len(reference.events)
    assert [e.time for e in one.events[::2]] == pytest.approx([e.time for e in reference.events], abs=1e-13)
    assert [e.time for e in one.events[1::2]] == pytest.approx([e.time for e in reference.events], abs=1e-13)
    assert space.shapes @ one.displacement == pytest.approx(sign * reference.displacement[0], abs=1e-13)
    # Perturbations of the common motion are those of one alone.
    common = np.kron(np.eye(2), space.shapes.T @ sign[:, None] / np.sqrt(2.0))
    size = np.abs(reference.monodromy).max()
    assert common.T @ one.monodromy @ common == pytest.approx(reference.monodromy, abs=1e-12 * size)
    # All others make one contact switch before the other.
    assert differences(system, state, 12.0) == pytest.approx(one.monodromy, abs=2e-5 * np.abs(one.monodromy).max())


def test_a_pinned_contact_projects():
    """A contact that comes to rest at its gap: perturbations across it die, those along it follow the flow."""
    a, b = vf.Mass(1.0, stiffness=1.0, damping=0.5, name="a"), vf.Mass(1.0, stiffness=2.0, damping=0.3, name="b")
    effects = [
        vf.Spring(a, b, stiffness=1.0),
        vf.Dashpot(a, b, damping=0.2),
        vf.Contact(a, gap=0.2, stiffness=10.0, damping=0.5, side="above", acts_on="displacement", name="c"),
        vf.PointLoad(a, vf.Constant(1.0)),
    ]
    system = vf.Scene([a, b], effects).model.system
    space = modes_of(system, Counters())
    # Slow enough at its first event to rest at the gap, where the load holds it.
    state = np.concatenate([space.shapes.T @ [0.2 - 1e-9, 0.0], space.shapes.T @ [1e-4, 0.2]])
    one = monodromy(system, state, 1.0)
    assert [event.after for event in one.events] == [PINNED]
    assert one.status[0] == PINNED
    # Neither displacement nor velocity of the contact depends on the start any more.
    row, n = space.contacts[0], 2
    size = np.abs(one.monodromy).max()
    assert row @ one.monodromy[:n] == pytest.approx(0.0, abs=1e-12 * size)
    assert row @ one.monodromy[n:] == pytest.approx(0.0, abs=1e-12 * size)
    assert differences(system, state, 1.0, 1e-10) == pytest.approx(one.monodromy, abs=1e-5 * size)


def test_a_rigid_motion_is_followed():
    a, b = vf.Mass(1.0, name="a"), vf.Mass(2.0, name="b")
    effects = [
        vf.Contact(a, b, gap=0.5, stiffness=20.0, acts_on="penetration", name="c"),
        vf.PointLoad(a, vf.Sine(1.0, 1.0)),
    ]
    system = vf.Scene([a, b], effects).model.system
    state = np.array([0.0, 0.1, 1.0, -0.5])
    one = monodromy(system, state, 4.0)
    assert one.events
    assert differences(system, state, 4.0) == pytest.approx(one.monodromy, abs=1e-7)


def test_a_flow_may_begin_at_any_time_of_the_loads():
    _, scene = on_stop(vf.Mass(1.0, stiffness=1.0, damping=0.1), gap=0.1, stiffness=8.0, load=vf.Sine(1.0, 1.3))
    system = scene.model.system
    state = np.array([-0.3, 0.2])
    middle, _ = end_of(system, state, 3.1)
    end, _ = end_of(system, middle, 9.0, 3.1)
    assert end == pytest.approx(end_of(system, state, 9.0)[0], abs=1e-12)
    parts = monodromy(system, middle, 9.0, 3.1).monodromy @ monodromy(system, state, 3.1).monodromy
    assert parts == pytest.approx(monodromy(system, state, 9.0).monodromy, abs=1e-12)


def test_a_flow_does_not_depend_on_the_flows_before():
    """Flows of a system share its linear pieces, which they meet in any order: the same bits come out."""

    def system():
        masses = [vf.Mass(1.0, stiffness=1.0, damping=0.1, name=name) for name in "ab"]
        stops = [
            vf.Contact(mass, gap=gap, stiffness=8.0, damping=0.1, side="above", acts_on="penetration", name=mass.name)
            for mass, gap in zip(masses, (0.1, 0.3), strict=True)
        ]
        load = vf.PointLoad(masses[0], vf.Sine(1.0, 1.3))
        return vf.Scene(masses, [*stops, vf.Spring(*masses, stiffness=0.5), load]).model.system

    states = np.array([[-0.3, 0.5, 0.2, 0.1], [0.2, -0.6, 0.4, 0.0], [-1.0, -1.0, 2.0, 1.0]])
    together = system()
    flows = [monodromy(together, state, 9.0) for state in states]
    # Sampled only after all of them.
    for state, one in zip(states, flows, strict=True):
        alone = monodromy(system(), state, 9.0)
        assert np.array_equal(one.monodromy, alone.monodromy)
        assert [event.time for event in one.events] == [event.time for event in alone.events]
        times = np.linspace(0.0, 9.0, 40)
        assert np.array_equal(one.solution.modal(times), alone.solution.modal(times))
    assert len({tuple(event.after for event in one.events) for one in flows}) > 1
