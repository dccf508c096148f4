"""Work and dissipation of event_driven runs: against quadrature of the power, their balance, and what they cost."""

import numpy as np
import pytest
from scenes import between_stops, cantilever

import vofem as vf
from vofem.integrators.event_driven import energy
from vofem.integrators.event_driven.regime import Regime
from vofem.system import CLOSED


def rattling_beam(*, dampers=(), law="penetration", damping=0.0, load=None):
    beam = cantilever(6)
    tip = beam.at(1.0)
    stop = vf.Contact(tip, gap=0.03, stiffness=50.0, damping=damping, side="below", acts_on=law)
    force = vf.Sine(0.3, 5.0) + vf.Sine(0.1, 11.0, 0.4) if load is None else load
    gust = vf.DistributedLoad(beam, lambda x: -0.1 * x, vf.Ramp(0.1, 0.0, 2.0))
    return vf.Scene([beam], [stop, vf.PointLoad(tip, force), gust, *(make(beam) for make in dampers)])


def falling_mass(*, damping=0.0, stiffness=0.0, force=2.0):
    mass = vf.Mass(1.0, stiffness=stiffness, damping=damping)
    start, load = (0.0, 0.3), vf.Sine(1.0, force)
    return between_stops(mass, vf.Gravity(0.1), load=load, start=start, gap=0.05, stiffness=30.0)[1]


def pair(damping, stiffness=4.0):
    masses = [vf.Mass(1.0, stiffness=stiffness), vf.Mass(2.0, stiffness=2.0 * stiffness)]
    contact = vf.Contact(*masses, gap=0.02, stiffness=80.0, damping=damping, acts_on="penetration")
    loads = [vf.PointLoad(masses[0], vf.Sine(0.4, 1.9)), vf.Dashpot(*masses, damping=0.3)]
    return vf.Scene(masses, [contact, *loads], initial={masses[0]: (0.0, 0.1)})


def material_damping(beam):
    return vf.RayleighDamping(1.0, 1e-3)


def pinned_beam(*dampers, damping=0.0):
    """A beam pressed on three stops with forces that jump: contacts come to rest at their gaps."""
    beam = cantilever(6)
    stops = [
        vf.Contact(beam.at(x), gap=gap, stiffness=stiffness, side="below", acts_on="displacement", name=f"at {x}",
                   damping=damping)
        for x, gap, stiffness in ((0.5, 0.01, 20.0), (1.0, 0.03, 4.0))
    ]  # fmt: skip
    load = vf.PointLoad(beam.at(1.0), vf.Sine(-0.3, 0.5) + vf.Sine(0.02, 11.0))
    return vf.Scene([beam], [*stops, load, *(make(beam) for make in dampers)])


RAYLEIGH = [lambda beam: vf.RayleighDamping(0.2, 1e-3)]
DASHPOT = [lambda beam: vf.Dashpot(beam.at(0.5), damping=0.4)]
RECORD = vf.Tabulated(np.linspace(0.0, 6.0, 61), 0.3 * np.sin(3.0 * np.linspace(0.0, 6.0, 61)))

SCENES = {
    "undamped": rattling_beam,
    "displacement law": lambda: rattling_beam(law="displacement"),
    "displacement law, dampers": lambda: rattling_beam(law="displacement", dampers=DASHPOT),
    "rayleigh": lambda: rattling_beam(dampers=RAYLEIGH),
    "rayleigh, damped contact": lambda: rattling_beam(dampers=RAYLEIGH, damping=0.5),
    "dashpot": lambda: rattling_beam(dampers=DASHPOT),
    "record": lambda: rattling_beam(dampers=RAYLEIGH, damping=0.5, load=RECORD),
    "free": falling_mass,
    "resonant": lambda: falling_mass(stiffness=4.0),
    "resonant, damped": lambda: falling_mass(stiffness=4.0, damping=0.02),
    "critical": lambda: falling_mass(stiffness=4.0, damping=4.0),
    "overdamped": lambda: falling_mass(stiffness=4.0, damping=10.0),
    "free, dragged": lambda: falling_mass(damping=0.5),
    "pair": lambda: pair(0.0),
    "pair, damped contact": lambda: pair(0.7),
    "free pair": lambda: pair(0.7, stiffness=0.0),
    "pinned": lambda: pinned_beam(material_damping),
    "pinned, dashpot": lambda: pinned_beam(material_damping, lambda beam: vf.Dashpot(beam.at(0.75), damping=0.5)),
    "pinned, damped contacts": lambda: pinned_beam(material_damping, damping=0.05),
    "pinned, uniform damping": lambda: pinned_beam(lambda beam: vf.RayleighDamping(50.0, 0.0)),
}


@pytest.mark.parametrize("kind", SCENES)
def test_energies_balance(kind):
    times = np.linspace(0.0, 6.0, 301)
    result = vf.simulate(SCENES[kind](), 6.0, times=times, method="event_driven")
    assert result.counters.events >= 2
    assert any(contact.pinned.size for contact in result.contacts.values()) is kind.startswith("pinned")
    assert result.energy.balance_error < 1e-13


@pytest.mark.parametrize(
    "kind",
    ["rayleigh, damped contact", "record", "resonant, damped", "free pair", "free, dragged", "pinned",
     "pinned, damped contacts"],
)  # fmt: skip
def test_forms_agree_with_quadrature_of_the_power(kind):
    """By Gauss's rule on panels that resolve the fastest mode, and with what is lost where contacts are pinned."""
    result = vf.simulate(SCENES[kind](), 6.0, times=[6.0], method="event_driven")
    solution, laws = result.solution, result.model.system.contacts
    edges = np.append(solution.segments.starts, 6.0)
    panels = np.ceil(np.diff(edges) / 1e-3).astype(int)
    left = np.concatenate(
        [a + (b - a) * np.arange(m) / m for a, b, m in zip(edges[:-1], edges[1:], panels, strict=True)]
    )
    width = np.repeat(np.diff(edges) / panels, panels)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    times = (left[:, None] + 0.5 * width[:, None] * (1.0 + nodes)).ravel()
    share = (0.5 * width[:, None] * weights).ravel()
    _, v = solution.modal(times)
    loads = [np.asarray(load.function(times)) for load in result.model.system.loads]
    work = share @ np.sum([f * (row @ v) for f, row in zip(loads, solution.space.loads, strict=True)], axis=0)
    closed = np.repeat(solution.segments.status == CLOSED, panels * nodes.size, axis=0).T
    taken = np.sum(v * solution.space.damping_force(v), axis=0)
    taken += np.sum(closed * laws.damping[:, None] * (solution.space.contacts @ v) ** 2, axis=0)
    lost = solution._lost_in_impacts()
    found = solution.energies(np.array([6.0]))
    assert found.work[0] == pytest.approx(work, rel=1e-11)
    assert found.dissipated[0] == pytest.approx(share @ taken + (0.0 if lost is None else lost.sum()), rel=1e-10)


def test_the_form_of_the_energy_lost_solves_its_equation():
    """Also of repeated, critically damped and overdamped roots."""
    rng = np.random.default_rng(3)
    delta, p = np.array([0.1, 0.1, 2.0, 5.0, 0.0, 1e-3]), np.array([4.0, 4.0, 4.0, 4.0, 7.0, 1e4])
    n = p.size
    rows = rng.normal(size=(4, 2 * n))
    # Nothing takes energy from the block without damping.
    rows[:, [4, n + 4]] = 0.0
    power = rows.T @ rows
    found = energy.lyapunov(delta, p, delta, p, power)
    flow = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(p), -2.0 * np.diag(delta)]])
    assert flow.T @ found + found @ flow == pytest.approx(-power, abs=1e-10 * np.abs(found).max())


@pytest.mark.parametrize("kind", [(), RAYLEIGH, DASHPOT], ids=["undamped", "rayleigh", "dashpot"])
def test_a_stored_time_costs_one_evaluation_of_the_blocks(kind, monkeypatch):
    """However many modes there are, and without quadrature."""
    result = vf.simulate(rattling_beam(dampers=kind, load=vf.Sine(0.3, 6.0)), 6.0, times=[6.0], method="event_driven")
    count, evaluated, calls = 5000, [], []
    plain = Regime.changes

    def counting(self, starts, own, tau):
        evaluated.append(tau.size)
        return plain(self, starts, own, tau)

    monkeypatch.setattr(Regime, "changes", counting)
    monkeypatch.setattr(energy, "quadrature", lambda *_: calls.append("quadrature") or np.zeros(1))
    found = result.solution.energies(np.linspace(0.0, 6.0, count))
    segments = result.solution.segments.starts.size
    # Once for the samples and once for the forms, at the ends of segments too.
    assert sum(evaluated) == 2 * count + segments
    assert not calls
    assert found.work[-1] != 0.0
    # Forms are found once a status, however many segments have it.
    monkeypatch.setattr(energy, "lyapunov", lambda *_: calls.append("form"))
    result.solution.energies(np.linspace(0.0, 6.0, count))
    assert not calls


@pytest.mark.parametrize("effects", ["belt", "train"])
def test_belts_and_trains_have_forms(effects, monkeypatch):
    """Their work and losses need no quadrature, which took seconds."""
    beam = vf.Beam(1.0, 10.0, 0.5, 4, {"left": "clamped"}, name="beam")
    if effects == "belt":
        belt = vf.Sine(0.3, 4.0) + 0.1
        acting = [
            vf.Friction(beam.at(1.0), coefficient=0.5, normal=4.0, belt=belt),
            vf.Friction(beam.at(0.5), coefficient=0.2, normal=1.0, stiffness=300.0, belt=0.1),
            vf.Contact(beam.at(0.75), gap=0.01, side="above", stiffness=1e3, damping=3.0, acts_on="penetration"),
        ]
    else:
        acting = [vf.PointLoad(beam.along(vf.Path(1.5, begin=0.2 * k)), -1.0) for k in range(4)]
    monkeypatch.setattr(energy, "quadrature", lambda *_: pytest.fail("quadrature"))
    result = vf.simulate(vf.Scene([beam], [*acting, vf.RayleighDamping(0.2, 1e-4)]), 2.0, method="event_driven")
    found = result.energy
    total = found.kinetic + found.strain + found.contact + found.dissipated - found.work
    assert np.abs(total - found.start).max() < 1e-12 * np.abs(found.work).max()
    assert found.dissipated[-1] > 0.0


def test_scenes_that_share_eigensystems_have_loads_of_their_own():
    """Loads with one function of time are one; another scene that shares the eigensystems may have two."""

    def build(other):
        masses = [vf.Mass(1.0, stiffness=4.0), vf.Mass(2.0, stiffness=9.0)]
        contact = vf.Contact(*masses, gap=0.02, stiffness=80.0, acts_on="penetration")
        loads = [vf.PointLoad(masses[0], vf.Sine(0.4, 1.9)), vf.PointLoad(masses[1], other)]
        return vf.Scene(masses, [contact, *loads, vf.Dashpot(*masses, damping=0.3)])

    scene = build(vf.Sine(0.4, 1.9))
    one = vf.simulate(scene, 6.0, method="event_driven")
    assert one.energy.balance_error < 1e-13
    changed = vf.simulate(scene.replace(scene.effects[2], f=vf.Sine(0.1, 5.0)), 6.0, method="event_driven")
    alone = vf.simulate(build(vf.Sine(0.1, 5.0)), 6.0, method="event_driven")
    assert changed.counters.eigensolves < alone.counters.eigensolves
    assert changed.energy.work == pytest.approx(alone.energy.work, rel=1e-13)
    assert changed.energy.balance_error < 1e-13


@pytest.mark.parametrize("width", [1e-6, 1e-9, 1e-11])
def test_a_nearly_vertical_part_of_a_table_does_the_work_of_a_step(width):
    """Answers to its slope are ten powers of ten larger than the motion; products of them left negative losses."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=20.0, name="mass")
    steep = vf.Tabulated([0.0, 0.5, 0.5 + width, 3.0], [-2.0, -2.0, 2.0, 2.0])
    step = vf.Constant(-2.0) + vf.Pulse(4.0, 0.5, 1.0)
    found = []
    for load in (steep, step):
        result = vf.simulate(vf.Scene([mass], [vf.PointLoad(mass, load)]), 1.0, times=[0.4, 0.6, 1.0])
        assert result.energy.balance_error < 1e-11
        found.append([result.energy.work, result.energy.dissipated])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9 + 10.0 * width)
