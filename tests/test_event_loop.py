"""The compiled loop over segments: the same runs as in plain Python, and few returns to Python."""

import itertools

import numpy as np
import pytest
from scenes import cantilever, on_stop

import vofem as vf
from vofem.integrators.event_driven import follow, regime, table
from vofem.integrators.event_driven.flow import Start, flow, modes_of
from vofem.kernels.mode import kernels
from vofem.linalg.exponential import half_turns
from vofem.system import Counters


def beam_on_a_stop(elements=6, *effects, acts_on="displacement", stiffness=20.0, damping=0.0):
    beam = cantilever(elements)
    tip = beam.at(1.0)
    stop = vf.Contact(tip, gap=0.03, stiffness=stiffness, damping=damping, side="below", acts_on=acts_on)
    return vf.Scene([beam], [stop, vf.PointLoad(tip, vf.Sine(0.1, 1.0)), *effects])


def rattle(load=None):
    mass = vf.Mass(1.0, stiffness=1.0)
    stop = vf.Contact(mass, gap=0.5, stiffness=100.0, side="above", acts_on="penetration")
    return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, 1.3) if load is None else load)])


def dropped():
    return on_stop(vf.Mass(1.0), vf.Gravity(9.81), gap=0.5, stiffness=100.0, side="below")[1]


def chain():
    masses = [vf.Mass(1.0) for _ in range(5)]
    effects = [vf.Contact(a, b, gap=0.01, stiffness=1e4, acts_on="penetration") for a, b in itertools.pairwise(masses)]
    load = vf.Tabulated([0.0, 0.03, 0.06, 0.2], [0.0, 30.0, -10.0, 20.0]) + vf.Sine(5.0, 40.0)
    return vf.Scene(masses, [*effects, vf.PointLoad(masses[1], load)], initial={masses[0]: (0.0, 1.0)})


def pinned():
    """A mass that chatters on its stop under the displacement law and comes to rest there."""
    mass = vf.Mass(1.0, damping=0.8)
    stop = vf.Contact(mass, gap=0.1, stiffness=400.0, side="below", acts_on="displacement")
    return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(0.3, 0.9) - 10.0)])


def bouncing():
    """A mass between a rigid stop, at which it comes to rest after impacts that accumulate, and an elastic one."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1)
    stops = [
        vf.RigidStop(mass, gap=0.1, restitution=0.6, side="above", name="stop"),
        vf.Contact(mass, gap=0.2, stiffness=30.0, side="below", acts_on="displacement"),
    ]
    return vf.Scene([mass], [*stops, vf.PointLoad(mass, vf.Sine(0.7, 0.8) + 0.2)])


def beam_on_a_rigid_stop():
    beam = cantilever(4)
    tip = beam.at(1.0)
    stop = vf.RigidStop(tip, gap=0.03, restitution=0.5, side="below", name="stop")
    load = vf.PointLoad(tip, vf.Sine(0.1, 2.0))
    return vf.Scene([beam], [stop, vf.Dashpot(beam.at(0.5), damping=0.2), vf.RayleighDamping(0.1, 1e-3), load])


def pushed_off():
    """One mass rests at its stop until another one meets it under the displacement law and pushes it off at once."""
    rests, moves = vf.Mass(1.0, stiffness=30.0, damping=2.5), vf.Mass(0.9, stiffness=25.0, damping=0.8)
    stop = vf.RigidStop(rests, gap=0.05, restitution=0.0, side="below")
    jump = vf.Contact(moves, rests, gap=0.06, stiffness=90.0, acts_on="displacement")
    loads = [vf.PointLoad(rests, vf.Constant(-4.0)), vf.PointLoad(moves, vf.Sine(2.0, 4.5))]
    return vf.Scene([rests, moves], [stop, jump, *loads])


SCENES = {
    "beam, displacement law": (beam_on_a_stop, 9.0),
    "beam, stiff": (lambda: beam_on_a_stop(8, acts_on="penetration", stiffness=1e4), 5.0),
    "beam, damped": (
        lambda: beam_on_a_stop(6, vf.RayleighDamping(0.1, 1e-3), acts_on="penetration", damping=0.3),
        20.0,
    ),
    "beam, damped uniformly": (lambda: beam_on_a_stop(6, vf.RayleighDamping(0.1, 0.0)), 9.0),
    "mass, harmonic": (rattle, 60.0),
    "mass, resonance": (lambda: rattle(vf.Sine(0.05, 1.0)), 60.0),
    "mass, pulses": (lambda: rattle(vf.Pulse(2.0, 1.0, 0.5) + vf.Ramp(0.3, 4.0, 9.0) + vf.Sine(0.8, 1.1)), 30.0),
    "free fall": (dropped, 20.0),
    "chain": (chain, 0.2),
    "pinned": (pinned, 12.0),
    "rigid stop": (bouncing, 40.0),
    "beam, rigid stop": (beam_on_a_rigid_stop, 4.0),
    "rigid stop, pushed off": (pushed_off, 8.0),
}


def run(scene, t_end, **options):
    with kernels(compiled=True):
        return vf.simulate(scene, t_end, method="event_driven", times=np.linspace(0.0, t_end, 61), **options)


def counted(monkeypatch):
    """Count the calls of the loop."""
    counts = {"calls": 0}
    loop = follow.run_segments

    def run_segments(*arguments):
        counts["calls"] += 1
        return loop(*arguments)

    monkeypatch.setattr(follow, "run_segments", run_segments)
    return counts


#: Breakpoints of a load.
TIMES = np.linspace(0.0, 20.0, 4001)


def coordinates(result):
    samples = result.solution.sample(result.times)
    return samples.q, samples.v


@pytest.mark.parametrize("name", SCENES)
def test_the_loop_does_what_plain_python_does(name, monkeypatch):
    """Plain Python returns from the loop after every segment."""
    build, t_end = SCENES[name]
    by_loop = run(build(), t_end)
    monkeypatch.setattr(follow, "MOST", 1)
    counts = counted(monkeypatch)
    by_steps = vf.simulate(
        build(), t_end, method="event_driven", times=np.linspace(0.0, t_end, 61), compiled=False
    )  # fmt: skip
    assert counts["calls"] > by_steps.counters.events // 2
    one, two = by_loop.solution.events, by_steps.solution.events
    assert one.contact.size > 3
    assert np.array_equal(one.contact, two.contact)
    assert np.array_equal(one.status, two.status)
    assert one.time == pytest.approx(two.time, rel=1e-9, abs=1e-9)
    for kind in (0, 1):
        mine, other = coordinates(by_loop)[kind], coordinates(by_steps)[kind]
        assert mine == pytest.approx(other, abs=1e-8 * np.abs(other).max())
    assert by_loop.notes == by_steps.notes
    assert by_loop.sensitivity.growth == pytest.approx(by_steps.sensitivity.growth, abs=1e-5)
    assert abs(by_loop.energy.balance_error) < 1e-11


@pytest.mark.parametrize("load", [None, vf.Tabulated(TIMES, np.sin(1.3 * TIMES))], ids=["events", "breakpoints"])
def test_few_returns_to_python(load, monkeypatch):
    """Statuses that are met for the first time, and arrays that grow: nothing that grows with events or breakpoints."""
    counts = counted(monkeypatch)
    result = run(rattle(load), 4000.0 if load is None else 20.0)
    assert result.counters.steps > 1500
    assert counts["calls"] <= 20
    assert abs(result.energy.balance_error) < 1e-11


def test_impacts_on_rigid_stops_are_those_of_the_loop(monkeypatch):
    """Python sees the last impact before each rest, and none of the thousands of others."""
    counts = counted(monkeypatch)
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1)
    stop = vf.RigidStop(mass, gap=0.0, restitution=0.8, side="above", name="stop")
    result = run(vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, 2.3))]), 4000.0)
    assert result.contacts["stop"].closings.size > 1000
    assert counts["calls"] <= 20
    assert result.counters.steps == result.solution.events.time.size // 2 + 1
    assert abs(result.energy.balance_error) < 1e-11


def dampers():
    """Three masses with a rigid damper, one behind a spring, one on a belt, and an elastic stop between two masses."""
    masses = [vf.Mass(1.0, stiffness=1.0, damping=0.1, name=name) for name in ("low", "middle", "high")]
    low, middle, high = masses
    effects = [
        vf.Spring(low, middle, stiffness=3.0),
        vf.Spring(middle, high, stiffness=2.0),
        vf.Friction(low, coefficient=0.3, static=0.4, normal=1.0, name="rigid"),
        vf.Friction(middle, coefficient=0.2, normal=1.0, stiffness=40.0, name="behind a spring"),
        vf.Friction(high, coefficient=0.1, normal=1.0, belt=0.2, name="on a belt"),
        vf.Contact(middle, high, gap=0.05, stiffness=50.0, acts_on="penetration", name="stop"),
        vf.PointLoad(low, vf.Sine(2.0, 0.9)),
    ]
    return vf.Scene(masses, effects)


def test_sliders_are_those_of_the_loop(monkeypatch):
    """Python chooses statuses that are met for the first time, or that sliders decide together: few of hundreds."""
    counts = counted(monkeypatch)
    whole = run(dampers(), 300.0)
    assert counts["calls"] <= 60
    assert whole.counters.events > 500
    assert abs(whole.energy.balance_error) < 1e-11
    slowly = vf.simulate(dampers(), 60.0, method="event_driven", times=np.linspace(0.0, 60.0, 61), compiled=False)
    for name, slider in slowly.frictions.items():
        fast = whole.frictions[name]
        assert slider.stops.size > 10
        assert fast.stops[fast.stops < 60.0] == pytest.approx(slider.stops, rel=1e-9)
        assert fast.breaks[fast.breaks < 60.0] == pytest.approx(slider.breaks, rel=1e-9)
        assert fast.dissipated[whole.times == 60.0] == pytest.approx(slider.dissipated[-1], rel=1e-9)
    monkeypatch.setattr(follow, "MOST", 1)
    often = run(dampers(), 300.0)
    assert counts["calls"] > often.counters.steps
    assert often.counters == whole.counters
    for mine, other in zip(coordinates(whole), coordinates(often), strict=True):
        assert np.array_equal(mine, other)


@pytest.mark.parametrize("name", ["beam, damped", "chain", "pinned", "rigid stop", "rigid stop, pushed off"])
def test_results_do_not_depend_on_when_the_loop_returns(name, monkeypatch):
    build, t_end = SCENES[name]
    whole = run(build(), t_end)
    monkeypatch.setattr(follow, "MOST", 1)
    counts = counted(monkeypatch)
    often = run(build(), t_end)
    assert counts["calls"] > often.counters.steps // 2
    for mine, other in zip(coordinates(whole), coordinates(often), strict=True):
        assert np.array_equal(mine, other)
    assert np.array_equal(whole.solution.events.time, often.solution.events.time)


def counted_entries(monkeypatch):
    """Return the list of linear pieces that tables take in from now on."""
    entered, searched = [], table.searched
    monkeypatch.setattr(table, "searched", lambda piece: entered.append(piece) or searched(piece))
    return entered


def test_results_do_not_depend_on_the_memory_for_statuses(monkeypatch):
    build, t_end = SCENES["chain"]
    whole = run(build(), t_end)
    monkeypatch.setattr(table, "_MOST_MEMORY", 1)
    entered = counted_entries(monkeypatch)
    little = run(build(), t_end)
    assert whole.counters.statuses > 3
    assert len(entered) > little.counters.statuses
    for name in ("starts", "displacement", "velocity", "gaps"):
        assert np.array_equal(getattr(whole.solution.segments, name), getattr(little.solution.segments, name))
    for mine, other in zip(coordinates(whole), coordinates(little), strict=True):
        assert np.array_equal(mine, other)


def flow_of(scene):
    system = scene.model.system
    with kernels(compiled=True):
        space = modes_of(system, Counters())
        numbers = np.random.default_rng(3)
        start = Start(0.3, 0.02 * numbers.normal(size=space.size) / (1.0 + space.stiffness), np.zeros(space.size))
        return flow(system, start, 12.0, derivative=np.eye(2 * space.size))


def test_flows_are_those_of_single_steps(monkeypatch):
    build = SCENES["beam, damped"][0]
    by_loop = flow_of(build())
    monkeypatch.setattr(follow, "MOST", 1)
    counts = counted(monkeypatch)
    by_steps = flow_of(build())
    assert counts["calls"] >= 4
    assert len(by_loop.events) == len(by_steps.events) > 1
    for mine, other in zip(by_loop.events, by_steps.events, strict=True):
        assert (mine.contact, mine.before, mine.after) == (other.contact, other.before, other.after)
        assert mine.time == pytest.approx(other.time, rel=1e-11)
    assert by_loop.displacement == pytest.approx(by_steps.displacement, abs=1e-11)
    assert by_loop.velocity == pytest.approx(by_steps.velocity, abs=1e-10)
    assert by_loop.monodromy == pytest.approx(by_steps.monodromy, abs=1e-9 * np.abs(by_steps.monodromy).max())


def test_half_turns_keep_all_digits():
    """Against sums of extended precision, from tiny angles to those of thousands of turns, and beyond the reduction."""
    numbers = np.random.default_rng(7)
    for size in (1e-9, 1e-4, 1.0, 50.0, 1e4, 1e6):
        frequency = size * numbers.uniform(0.0, 1.0, 400)
        turn, sine = np.empty(400), np.empty(400)
        with kernels(compiled=True):
            half_turns(frequency, 1.37, turn, sine)
        # The angle as it is known: half of the product in double precision.
        half = np.asarray(0.5 * frequency * 1.37, dtype=np.longdouble)
        exact = -2.0 * np.sin(half) ** 2, 2.0 * np.sin(half) * np.cos(half)
        for mine, other in zip((turn, sine), exact, strict=True):
            assert np.all(np.abs(mine - other) <= 2e-15 * np.abs(other) + 1e-19)


def test_further_runs_begin_with_the_linear_pieces_of_earlier_ones(monkeypatch):
    """A run computes only what the run before has not met, and has the same bits as a run of a new scene."""
    entered = []
    answers = regime.answers
    monkeypatch.setattr(regime, "answers", lambda *given: entered.append(given[0]) or answers(*given))

    def states(result):
        return [np.array(part) for part in (result.solution.segments.displacement, result.samples.q, result.samples.v)]

    def build(start):
        scene = chain()
        return scene, {scene.bodies[0]: (0.0, start)}

    def run_of(scene, start):
        return vf.simulate(scene, 0.2, method="event_driven", initial=start, compiled=True)

    scene, quick = build(1.0)
    first = run_of(scene, quick)
    assert len(entered) == len(first.solution.record.statuses) > 2
    before = len(entered)
    again = run_of(scene, quick)
    assert len(entered) == before
    assert all(np.array_equal(a, b) for a, b in zip(states(first), states(again), strict=True))
    # From another start statuses come in another order, and there are others.
    backwards = {scene.bodies[-1]: (0.0, -2.0), scene.bodies[0]: (0.0, 0.3)}
    other = run_of(scene, backwards)
    alone_scene = chain()
    names = {alone_scene.bodies[-1]: (0.0, -2.0), alone_scene.bodies[0]: (0.0, 0.3)}
    alone = run_of(alone_scene, names)
    assert all(np.array_equal(a, b) for a, b in zip(states(other), states(alone), strict=True))
    # What was not looked at before comes out as it would have.
    late = np.linspace(0.0, 0.2, 37)
    assert np.array_equal(first.solution.sample(late).q, again.solution.sample(late).q)
