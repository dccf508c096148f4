"""The jump law where neither status holds: chatter that ends pinned at the gap."""

import numpy as np
import pytest
from scenes import cantilever, paper_beam

import vofem as vf


def chattering_mass(t_end, **options):
    """A mass pushed against a stop by less than its jump, slowed by a dashpot."""
    mass = vf.Mass(1.0, damping=0.05)
    stop = vf.Contact(mass, gap=1.0, stiffness=1.0, side="above", acts_on="displacement", name="stop")
    scene = vf.Scene([mass], [stop, vf.PointLoad(mass, 0.4)], initial={mass: (1.0, 0.3)})
    return mass, vf.simulate(scene, t_end, **options)


def test_events_of_a_chattering_mass():
    """Counts from an independent program: 63, 208, 541, 1307, 3068 events by 50, 100, ... 250 s."""
    _, result = chattering_mass(250.0)
    events = result.solution.events.time
    counts = [int(np.sum(events <= t)) for t in (50.0, 100.0, 150.0, 200.0, 250.0)]
    assert counts == [63, 208, 541, 1307, 3068]
    speed = np.abs(result.velocity(result.scene.bodies[0], t=events[[500, 3000]]))
    decay = np.exp(-0.05 * (events[3000] - events[500]) / 3.0)
    assert speed[1] / speed[0] == pytest.approx(decay, rel=1e-2)
    assert result.energy.balance_error < 1e-9
    assert not result.notes


def test_chatter_ends_pinned():
    mass, result = chattering_mass(400.0, pin_fraction=1e-5)
    stop = result.contacts["stop"]
    assert stop.pinned.shape == (1, 2)
    assert stop.pinned[0, 1] == 400.0
    assert result.displacement(mass)[-1] == 1.0
    assert result.velocity(mass)[-1] == 0.0
    assert stop.force[-1] == pytest.approx(0.4, rel=1e-14)
    assert stop.stiffness[-1] == pytest.approx(0.4, rel=1e-14)
    assert np.isnan(stop.order[-1])
    assert not stop.closed[-1]
    assert "chatter: contact 'stop' came to rest at its gap (pinned) 1 times" in result.notes[0]
    # What is left of the motion when it is pinned: v^2/2 = a * fraction * gap, a = 0.4, of 0.045 J at the start.
    assert result.energy.balance_error < 0.4 * 1e-5 / 0.045


def test_pinned_contact_is_released_when_its_reaction_leaves_the_interval():
    """A ramp lifts the load above K gap + jump: closed; a falling one below K gap: open."""
    for slope, end, status in ((0.01, 90.0, "closed"), (-0.01, 60.0, "open")):
        mass = vf.Mass(1.0, stiffness=1.0, damping=2.0)
        stop = vf.Contact(mass, gap=0.5, stiffness=1.0, side="above", acts_on="displacement", name="stop")
        load = vf.Constant(0.7) + vf.Ramp(slope, 40.0)
        scene = vf.Scene([mass], [stop, vf.PointLoad(mass, load)], initial={mass: (0.4, 0.0)})
        result = vf.simulate(scene, end)
        pinned = result.contacts["stop"].pinned
        # Reaction f - K gap in [0, K0 gap]: released where the load reaches 1.0, or 0.5.
        release = 40.0 + (0.3 if status == "closed" else 0.2) / 0.01
        assert pinned[-1, 1] == pytest.approx(release, abs=1e-9)
        force = result.contacts["stop"].force
        assert force.min() >= 0.0
        inside = (result.times > pinned[-1, 0]) & (result.times < release)
        assert force[inside] == pytest.approx(load(result.times[inside]) - 0.5, abs=1e-12)
        assert result.contacts["stop"].closed[-1] == (status == "closed")


def test_pinned_equilibrium_of_statics_and_dynamics_agree():
    """A damped beam settles where statics says it is pinned."""
    _beam, scene = paper_beam(
        "displacement", elements=6, load=vf.Ramp(-0.05, 0.0, 2.0), extra=(vf.RayleighDamping(2.0, 1e-3),)
    )
    expected = vf.equilibrium(scene, t=2.0)
    assert expected.contacts["stop"].pinned
    result = vf.simulate(scene, 30.0)
    assert result.contacts["stop"].force[-1] == pytest.approx(expected.contacts["stop"].force, rel=1e-6)
    x = np.linspace(0.0, 1.0, 5)
    assert result.deflection(x)[:, -1] == pytest.approx(expected.deflection(x), abs=1e-9)


@pytest.mark.parametrize("stiffness", [1e2, 1e4, 1e9])
def test_damped_beam_on_a_stiff_stop_sticks(stiffness):
    """Tip rms 0.02441 over 20 s with Rayleigh damping (0.2, 1e-4), by an independent program at K0 = 1e4."""
    beam, scene = paper_beam("displacement", stiffness=stiffness, extra=(vf.RayleighDamping(0.2, 1e-4),))
    result = vf.simulate(scene, 20.0, times=np.linspace(0.0, 20.0, 4001))
    assert np.sqrt(np.mean(result.displacement(beam.at(1.0)) ** 2)) == pytest.approx(0.02441, abs=5e-6)
    assert result.counters.events < 5000
    stop = result.contacts["stop"]
    assert stop.pinned.size
    assert np.all(stop.force >= 0.0)
    held = np.any((result.times[:, None] > stop.pinned[:, 0]) & (result.times[:, None] < stop.pinned[:, 1]), axis=1)
    assert result.displacement(beam.at(1.0))[held] == pytest.approx(np.full(held.sum(), -0.03), abs=1e-12)
    assert np.all(stop.force[held] <= stiffness * 0.03)


@pytest.mark.parametrize("stiffness", [3.0, 1e4, 1e9])
def test_undamped_beam_on_a_stiff_stop_finishes(stiffness):
    _, scene = paper_beam("displacement", stiffness=stiffness)
    result = vf.simulate(scene, 20.0)
    assert result.counters.events < 2000
    assert result.energy.balance_error < 1e-3


def test_several_contacts_in_any_mix():
    """Two stops under a damped beam: pinned, open and closed side by side."""
    beam = cantilever(8)
    stops = [
        vf.Contact(beam.at(x), gap=g, stiffness=k, side="below", acts_on="displacement", name=f"s{i}")
        for i, (x, g, k) in enumerate(((0.5, 0.01, 20.0), (0.75, 0.02, 5.0), (1.0, 0.03, 4.0)))
    ]
    scene = vf.Scene([beam], [*stops, vf.PointLoad(beam.at(1.0), vf.Sine(-0.3, 0.5)), vf.RayleighDamping(1.0, 1e-3)])
    result = vf.simulate(scene, 12.0)
    assert sum(c.pinned.shape[0] for c in result.contacts.values()) >= 2
    for contact, law in zip(result.contacts.values(), stops, strict=True):
        force = contact.force
        assert np.all(force >= -1e-12)
        s = contact.gap_function
        pinned = np.isnan(contact.order)
        assert np.all(np.abs(s[pinned]) < 1e-12)
        assert np.all(force[pinned] <= law.stiffness * law.gap * (1 + 1e-9))
        assert np.all(s[contact.closed] > -1e-13)
        assert np.all(s[~contact.closed & ~pinned] < 1e-13)


def test_a_pinned_equilibrium_starts_pinned():
    beam, scene = paper_beam("displacement", elements=5, load=-0.1)
    rest = vf.equilibrium(scene)
    assert rest.contacts["stop"].pinned
    result = vf.simulate(vf.Scene([beam], scene.effects, initial=rest), 3.0)
    stop = result.contacts["stop"]
    assert stop.pinned == pytest.approx(np.array([[0.0, 3.0]]))
    assert stop.force == pytest.approx(np.full(1001, rest.contacts["stop"].force), rel=1e-6)
    assert result.counters.events == 0
    assert not result.notes


def test_the_only_motion_that_there_is_may_be_pinned_beside_a_damper():
    """Nothing moves then, and the damper of the pad takes nothing."""
    mass = vf.Mass(1.0, stiffness=1.0, name="mass")
    stop = vf.Contact(mass, gap=0.1, stiffness=100.0, side="above", acts_on="displacement", name="stop")
    pad = {"gap": 0.05, "stiffness": 1.0, "damping": 20.0, "side": "above", "acts_on": "penetration", "name": "pad"}
    scene = vf.Scene([mass], [stop, vf.Contact(mass, **pad), vf.PointLoad(mass, 5.0)])
    result = vf.simulate(scene, 4.0, times=[3.0, 4.0])
    np.testing.assert_allclose(result.displacement(mass), 0.1, rtol=1e-12)
    # 5 N less 0.1 N of the spring and 0.05 N of the pad.
    np.testing.assert_allclose(result.contacts["stop"].force, 4.85, rtol=1e-9)
    assert result.contacts["stop"].pinned[-1, 1] == 4.0
