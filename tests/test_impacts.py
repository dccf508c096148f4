"""Impacts, statistics of contacts, tables: against closed forms, and against sums over many samples."""

import numpy as np
import pytest
from scenes import on_stop, paper_beam

import vofem as vf

MASS, K, SPEED, GAP = 2.0, 800.0, 0.5, 0.01


def thrown(damping=0.0, acts_on="penetration", method="auto", t_end=1.0, **options):
    """A mass thrown at a stop: contact is half a period of an oscillator."""
    mass = vf.Mass(MASS, name="mass")
    stop = vf.Contact(
        mass, gap=GAP, stiffness=K, side="below", acts_on=acts_on, name="stop",
        **({"damping": damping} if damping else {}),
    )  # fmt: skip
    return vf.simulate(vf.Scene([mass], [stop], {mass: (0.0, -SPEED)}), t_end, method=method, **options)


def beam_run(**options):
    beam, scene = paper_beam("displacement", elements=6)
    return beam, vf.simulate(scene, 12.0, **options)


def test_an_elastic_impact_in_closed_form():
    omega = np.sqrt(K / MASS)
    result = thrown()
    impacts = result.contacts["stop"].impacts
    assert len(impacts) == 1
    exact = {
        "closing": GAP / SPEED,
        "duration": np.pi / omega,
        "approach_speed": SPEED,
        "departure_speed": SPEED,
        "peak_force": SPEED * np.sqrt(K * MASS),
        "impulse": 2.0 * MASS * SPEED,
        "work": 0.5 * MASS * SPEED**2,
    }
    for name, value in exact.items():
        assert getattr(impacts, name)[0] == pytest.approx(value, rel=1e-11), name
    assert impacts.absorbed[0] == pytest.approx(0.0, abs=1e-13)
    assert impacts.ended.tolist() == [True]
    assert impacts.why == ""
    assert 0.0 <= impacts.error <= 1e-10


def test_statistics_over_the_run_and_over_windows():
    omega = np.sqrt(K / MASS)
    closing, lasts, peak = GAP / SPEED, np.pi / omega, SPEED * np.sqrt(K * MASS)
    contact = thrown(t_end=2.0).contacts["stop"]
    whole = contact.statistics()
    assert (whole.count, whole.rate, whole.begin, whole.end) == (1, 0.5, 0.0, 2.0)
    assert whole.closed_share == pytest.approx(lasts / 2.0, rel=1e-12)
    assert whole.mean_force == pytest.approx(MASS * SPEED, rel=1e-11)
    assert whole.rms_force == pytest.approx(np.sqrt(0.5 * peak**2 * lasts / 2.0), rel=1e-11)
    assert whole.mean_closed_force == pytest.approx(2.0 * peak / np.pi, rel=1e-11)
    assert whole.work_rate == pytest.approx(0.25 * MASS * SPEED**2, rel=1e-11)
    assert whole.work_per_impact == pytest.approx(0.5 * MASS * SPEED**2, rel=1e-11)
    # A window over the first third of the contact: force peak*sin(omega t), t from 0 to a third of the duration.
    window = (closing, closing + lasts / 3.0)
    part = contact.statistics(window)
    assert part.closed_share == pytest.approx(1.0, rel=1e-12)
    assert part.impulse == pytest.approx(peak / omega * 0.5, rel=1e-11)
    assert part.peak_force == pytest.approx(peak * np.sqrt(0.75), rel=1e-11)
    assert part.work == pytest.approx(0.5 * (peak**2 * 0.75) / K, rel=1e-11)
    assert part.absorbed == pytest.approx(0.0, abs=1e-11 * part.work)
    after = contact.statistics((1.0, 2.0))
    assert (after.count, after.impulse, after.peak_force, after.closed_share) == (0, 0.0, 0.0, 0.0)
    assert np.isnan(after.mean_approach_speed)
    # Windows side by side add up.
    halves = [contact.statistics(w) for w in ((0.0, 0.1), (0.1, 2.0))]
    assert sum(one.impulse for one in halves) == pytest.approx(whole.impulse, rel=1e-12)
    assert sum(one.count for one in halves) == 1


@pytest.mark.parametrize("kind", ["penetration", "displacement", "damped", "resolved"])
@pytest.mark.parametrize("method", ["event_driven", "energy_conserving"])
def test_energy_that_is_stored_where_a_window_cuts_an_impact_is_not_absorbed(kind, method):
    """Of an elastic stop nothing is absorbed, and of a damped one what its damper dissipates, whatever the window."""
    if kind == "resolved" and method == "event_driven":
        method = "generalized_alpha"
    mass = vf.Mass(MASS, stiffness=3.0, name="mass")
    damped = {"damping": 8.0} if kind == "damped" else {}
    switch = {"switch": vf.Resolved(1e4)} if kind == "resolved" else {}
    acts_on = "displacement" if kind == "displacement" else "penetration"
    stop = vf.Contact(mass, gap=GAP, stiffness=K, side="below", name="stop", acts_on=acts_on, **damped, **switch)
    options = {} if method == "event_driven" else {"dt": 2e-4, "times": np.linspace(0.0, 0.6, 3001)}
    result = vf.simulate(vf.Scene([mass], [stop], {mass: (0.0, -SPEED)}), 0.6, method=method, **options)
    contact, closing = result.contacts["stop"], GAP / SPEED
    near = 1e-9 if method == "event_driven" else 1e-3
    for window in ((0.0, closing + 0.03), (closing + 0.03, closing + 0.05), (closing + 0.04, 0.6), None):
        found = contact.statistics(window)
        ends = [0.0, 0.6] if window is None else window
        lost = np.interp(ends, result.times, result.energy.dissipated)
        expected = lost[1] - lost[0] if kind == "damped" else 0.0
        assert found.absorbed == pytest.approx(
            expected, abs=max(near, 2e-3 * (kind == "damped")) * 0.5 * MASS * SPEED**2
        )
    assert contact.statistics((closing + 0.01, closing + 0.04)).work > 0.02


def test_a_damped_impact_takes_what_the_mass_loses():
    """The damped half oscillation in closed form, until the gap opens."""
    c0 = 8.0
    contact = thrown(damping=c0).contacts["stop"]
    impacts = contact.impacts
    delta = c0 / (2.0 * MASS)
    omega = np.sqrt(K / MASS - delta**2)
    lasts = np.pi / omega
    left = SPEED * np.exp(-delta * lasts)
    assert impacts.duration[0] == pytest.approx(lasts, rel=1e-12)
    assert impacts.departure_speed[0] == pytest.approx(left, rel=1e-11)
    assert impacts.impulse[0] == pytest.approx(MASS * (SPEED + left), rel=1e-11)
    assert impacts.absorbed[0] == pytest.approx(0.5 * MASS * (SPEED**2 - left**2), rel=1e-11)
    deepest = np.arctan2(omega, delta) / omega
    depth = SPEED / omega * np.exp(-delta * deepest) * np.sin(omega * deepest)
    # All kinetic energy has gone into the contact when the mass turns: work done on spring and damper.
    assert impacts.work[0] > 0.5 * K * depth**2
    times = np.linspace(0.0, lasts, 400_001)
    s = SPEED / omega * np.exp(-delta * times) * np.sin(omega * times)
    rate = SPEED * np.exp(-delta * times) * (np.cos(omega * times) - delta / omega * np.sin(omega * times))
    force = K * s + c0 * rate
    assert impacts.peak_force[0] == pytest.approx(force.max(), rel=1e-9)
    power = np.where(rate > 0.0, force * rate, 0.0)
    work = np.sum(0.5 * (power[1:] + power[:-1])) * (times[1] - times[0])
    assert impacts.work[0] == pytest.approx(work, rel=1e-8)


def test_the_displacement_law():
    """While closed the mass oscillates about zero, from u = gap on; the force at the gap is K0 gap."""
    omega = np.sqrt(K / MASS)
    top = np.hypot(GAP, SPEED / omega)
    lasts = 2.0 * np.arccos(GAP / top) / omega
    impacts = thrown(acts_on="displacement").contacts["stop"].impacts
    assert impacts.duration[0] == pytest.approx(lasts, rel=1e-11)
    assert impacts.peak_force[0] == pytest.approx(K * top, rel=1e-10)
    assert impacts.work[0] == pytest.approx(0.5 * K * (top**2 - GAP**2), rel=1e-10)
    assert impacts.impulse[0] == pytest.approx(2.0 * MASS * SPEED, rel=1e-10)


def test_bounces_under_gravity():
    """A ball on a stiff floor: every bounce as long as the last one, and as many as the time allows."""
    g, height = 9.81, 0.2
    ball = vf.Mass(1.0, name="ball")
    floor = vf.Contact(ball, gap=0.0, stiffness=1e6, side="below", acts_on="penetration", name="floor")
    scene = vf.Scene([ball], [floor, vf.Gravity(g)], {ball: (height, 0.0)})
    contact = vf.simulate(scene, 3.0).contacts["floor"]
    speed, omega, sag = np.sqrt(2.0 * g * height), 1e3, g / 1e6
    # u + sag oscillates: from sag upwards at the closing, back to it at the opening.
    lasts = (np.pi + 2.0 * np.arctan(sag * omega / speed)) / omega
    between = 2.0 * speed / g
    count = 1 + int((3.0 - np.sqrt(2.0 * height / g)) // (lasts + between))
    impacts = contact.impacts
    assert len(impacts) == count > 5
    assert impacts.duration[:-1] == pytest.approx(np.full(count - 1, lasts), rel=1e-9)
    assert impacts.peak_force == pytest.approx(np.full(count, 1e6 * (np.hypot(speed / omega, sag) + sag)), rel=1e-9)
    assert contact.statistics().mean_approach_speed == pytest.approx(speed, rel=1e-10)
    # In the long run the floor carries the weight.
    window = (impacts.closing[0], impacts.closing[-1])
    assert contact.statistics(window).mean_force == pytest.approx(g, rel=1e-10)


def test_a_beam_against_sums_over_many_samples():
    beam, result = beam_run()
    impacts = result.contacts["stop"].impacts
    assert len(impacts) >= 3
    for k in range(len(impacts)):
        edges = np.linspace(impacts.closing[k], impacts.opening[k], 40_001)
        times = 0.5 * (edges[1:] + edges[:-1])
        step = edges[1] - edges[0]
        force = result.solution.contacts(times).force[0]
        speed = -result.velocity(beam.at(1.0), times)
        assert impacts.peak_force[k] == pytest.approx(force.max(), rel=1e-8)
        assert impacts.impulse[k] == pytest.approx(step * force.sum(), rel=1e-8)
        assert impacts.work[k] == pytest.approx(step * np.maximum(force * speed, 0.0).sum(), rel=1e-6)
    # The impulse of the whole run by the times of the run alone.
    statistics = result.contacts["stop"].statistics()
    assert statistics.impulse == pytest.approx(impacts.impulse.sum(), rel=1e-12)
    assert statistics.count / 12.0 == statistics.rate


def test_stepping_runs_converge_to_the_exact_numbers():
    exact = thrown().contacts["stop"].impacts
    errors = []
    for dt in (4e-3, 2e-3, 1e-3):
        found = thrown(method="energy_conserving", dt=dt).contacts["stop"].impacts
        assert found.why == ""
        errors.append([abs(getattr(found, n)[0] / getattr(exact, n)[0] - 1.0) for n in ("impulse", "peak_force")])
    assert np.all(np.array(errors)[-1] < 5e-4)
    assert np.all(np.array(errors)[0] > 3.0 * np.array(errors)[-1])


def test_few_stored_times_give_the_reason_instead_of_numbers():
    contact = thrown(method="generalized_alpha", dt=1e-3, times=[0.0, 0.5, 1.0]).contacts["stop"]
    impacts, statistics = contact.impacts, contact.statistics()
    assert len(impacts) == statistics.count == 1
    assert statistics.closed_share == pytest.approx(np.pi / 20.0, rel=1e-2)
    for value in (impacts.peak_force[0], impacts.work[0], statistics.rms_force, statistics.impulse):
        assert np.isnan(value)
    assert "too far apart for its steps" in impacts.why == statistics.why
    assert "not known" in str(statistics)


def test_a_contact_that_starts_closed_did_not_approach():
    _, scene = on_stop(vf.Mass(1.0, stiffness=1.0, name="m"), gap=0.1, stiffness=10.0, start=(0.3, 0.0))
    impacts = vf.simulate(scene, 1.0).contacts["stop"].impacts
    assert impacts.closing[0] == 0.0
    assert np.isnan(impacts.approach_speed[0])
    assert impacts.departure_speed[0] > 0.0
    # It gives back what was stored at the start.
    assert impacts.absorbed[0] == pytest.approx(-0.5 * 10.0 * 0.2**2, rel=1e-10)


def test_a_pinned_contact_pushes_without_work():
    mass = vf.Mass(1.0, stiffness=1.0, name="m")
    stop = vf.Contact(mass, gap=0.1, stiffness=10.0, side="above", acts_on="displacement", name="stop")
    load = vf.PointLoad(mass, vf.Constant(0.6))
    result = vf.simulate(vf.Scene([mass], [stop, load], {mass: (0.1, 0.0)}), 2.0)
    assert result.contacts["stop"].pinned.shape[0] == 1
    found = result.contacts["stop"].statistics()
    assert found.mean_force == pytest.approx(0.5, rel=1e-10)
    assert found.closed_share == 1.0
    assert (found.work, found.absorbed) == (0.0, 0.0)


@pytest.mark.parametrize("window", [(1.0, 0.5), (-1.0, 1.0), (0.0, 2.0), (0.5,), "x", (0.0, np.nan)])
def test_windows_outside_the_run_are_refused(window):
    with pytest.raises(vf.ArgumentError, match="window"):
        thrown().contacts["stop"].statistics(window)


def test_tables_of_events_impacts_and_contacts():
    _, result = beam_run()
    events = result.contact_events()
    assert events["event"].tolist() == ["closes", "opens"] * (events.rows // 2)
    assert events["time"] == pytest.approx(result.solution.events.time)
    impacts = result.impacts()
    assert impacts["contact"].tolist() == ["stop"] * impacts.rows
    assert np.array_equal(impacts["impulse"], result.contacts["stop"].impacts.impulse)
    assert impacts.units["impulse"] == "N s"
    assert result.impacts((4.0, 12.0)).rows < impacts.rows
    table = result.contact_statistics((0.0, 6.0))
    assert table["count"][0] == result.contacts["stop"].statistics((0.0, 6.0)).count
    assert "rms_force [N]" in str(table)
    with pytest.raises(vf.ArgumentError, match="did you mean 'impulse'"):
        impacts["impulses"]
    frame = impacts.to_dataframe()
    assert list(frame["closing"]) == impacts["closing"].tolist()
    assert frame.attrs["units"]["peak_force"] == "N"
    assert vf.simulate(vf.Scene([vf.Mass(1.0)]), 1.0).impacts().rows == 0


def test_histories_as_dataframe_and_dataset():
    beam, result = beam_run(times=np.linspace(0.0, 12.0, 25))
    frame = result.to_dataframe([beam.at(0.5), beam.at(1.0)])
    assert frame.index.name == "t [s]"
    assert np.array_equal(frame.index, result.times)
    assert np.array_equal(frame[f"{beam.at(0.5).name} displacement [m]"], result.displacement(beam.at(0.5)))
    assert np.array_equal(frame["stop force [N]"], result.contacts["stop"].force)
    assert np.array_equal(frame["kinetic energy [J]"], result.energy.kinetic)
    data = result.to_xarray({"tip": beam.at(1.0)})
    assert data.displacement.sel(point="tip").values.tolist() == result.displacement(beam.at(1.0)).tolist()
    assert data.contact_force.sel(contact="stop").values.tolist() == result.contacts["stop"].force.tolist()
    assert data.velocity.units == "m/s"
    assert data.contact_gap_function.units == "m"
    # Without points those of the contacts are taken.
    assert result.to_xarray().point.values.tolist() == [beam.at(1.0).name]


def test_a_mass_that_has_the_name_of_a_point_is_another_column(tmp_path):
    tip, mass = vf.Beam(1.0, 1.0, 1.0, 2, {"left": "clamped"}, name="b").at(1.0), vf.Mass(1.0, name="b@1.0")
    result = vf.simulate(
        vf.Scene([tip.body, mass], [vf.PointLoad(tip, 0.1), vf.PointLoad(mass, 1.0)]), 1.0, times=[0, 1]
    )
    frame = result.to_dataframe([tip, tip, mass])
    assert np.array_equal(frame["b@1.0 displacement [m]"], result.displacement(tip))
    assert np.array_equal(frame["Mass 'b@1.0' displacement [m]"], result.displacement(mass))
    assert vf.load(result.save(tmp_path / "run.vtkhdf")).to_xarray().point.size == 2


def test_rotations_have_their_own_units():
    beam = vf.Beam(1.0, 1.0, 1.0, 4, supports={"left": "pinned"}, name="b")
    stop = vf.Contact(beam.at(0.0), gap=0.01, stiffness=50.0, side="above", acts_on="penetration", name="r",
                      of="rotation")  # fmt: skip
    result = vf.simulate(vf.Scene([beam], [stop, vf.PointMoment(beam.at(0.0), vf.Constant(0.5))]), 0.5)
    table = result.impacts()
    assert (table.units["peak_force"], table.units["approach_speed"]) == ("N m", "rad/s")
