"""Dry friction in event_driven, against reference data, closed forms and an integration that is written here."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import DATA, reference_case
from scipy.integrate import solve_ivp

import vofem as vf
from vofem.io.csv_file import write_csv


def run(scene: vf.Scene, t_end: float, times: np.ndarray | None = None, **options: Any) -> vf.Result:
    """Return an event-driven run."""
    times = np.linspace(0.0, t_end, 201) if times is None else times
    return vf.simulate(scene, t_end, method="event_driven", times=times, **options)


def test_a_mass_on_a_belt_sticks_and_slips_as_its_closed_form() -> None:
    """Events, motion and dissipated energy of the stick-slip cycle."""
    s, values, histories = reference_case("friction/belt")
    mass = vf.Mass(s["m"], stiffness=s["k"], name="mass")
    pad = vf.Friction(
        mass, coefficient=s["mu_dynamic"], static=s["mu_static"], normal=s["N"], belt=s["v_belt"], name="pad"
    )
    scene = vf.Scene([mass], [pad], initial={mass: (0.0, s["v_belt"])})
    result = run(scene, s["t_end"], histories["t"])
    slider = result.frictions["pad"]
    np.testing.assert_allclose(result.displacement(mass), histories["x"], atol=1e-14)
    np.testing.assert_allclose(slider.breaks, values["events"][0::2], rtol=1e-13)
    np.testing.assert_allclose(slider.stops, values["events"][1::2], rtol=1e-13)
    assert slider.dissipated[-1] == pytest.approx(values["total_dissipated"], rel=1e-12)
    assert result.energy.dissipated[-1] == pytest.approx(values["total_dissipated"], rel=1e-12)
    sticks = slider.status == 0
    assert np.all(slider.slip_speed[sticks] == 0.0)
    np.testing.assert_allclose(slider.force[sticks], -s["k"] * result.displacement(mass)[sticks], atol=1e-12)
    np.testing.assert_allclose(slider.force[~sticks], -s["mu_dynamic"] * s["N"], rtol=1e-15)
    np.testing.assert_allclose(slider.wear_power, s["N"] * np.abs(slider.slip_speed), rtol=1e-15)
    assert result.energy.balance_error < 1e-13


def chain(s: dict[str, Any], **options: Any) -> tuple[vf.Scene, list[vf.Mass]]:
    """Return the chain of the reference data, its slider at the first mass."""
    one = vf.Mass(s["m1"], stiffness=s["k0"], damping=s["c"] * s["k0"], name="one")
    two = vf.Mass(s["m2"], stiffness=s["k2"], damping=s["c"] * s["k2"], name="two")
    effects = [
        vf.Friction(one, coefficient=1.0, normal=s["f"], name="pad", **options),
        vf.Spring(one, two, stiffness=s["k1"]),
        vf.Dashpot(one, two, damping=s["c"] * s["k1"]),
        vf.PointLoad(two, vf.Sine(s["F"], s["Omega"])),
    ]
    return vf.Scene([one, two], effects), [one, two]


def test_a_chain_agrees_with_the_reference_rigid_and_behind_a_spring() -> None:
    """Motion, events, and all parts of the energy."""
    s, values, histories = reference_case("friction/chain")
    scene, masses = chain(s)
    result = run(scene, s["t_end"], histories["t"])
    motion = np.array([result.displacement(mass) for mass in masses]).T
    np.testing.assert_allclose(motion, histories["x"], atol=1e-11 * np.abs(motion).max())
    slider = result.frictions["pad"]
    breaks = [time for time, what in values["events"] if what.startswith("break")]
    stops = [time for time, what in values["events"] if what.startswith("stop")]
    np.testing.assert_allclose(slider.breaks, breaks, atol=1e-12)
    np.testing.assert_allclose(slider.stops, stops, atol=1e-12)
    assert slider.dissipated[-1] == pytest.approx(values["friction_work"], rel=1e-11)
    assert result.energy.work[-1] == pytest.approx(values["load_work"], rel=1e-11)
    assert result.energy.balance_error < 1e-13
    elastic, masses = chain(s, stiffness=float(histories["kt_jenkins"]))
    jenkins = run(elastic, s["t_end"], histories["t"])
    motion = np.array([jenkins.displacement(mass) for mass in masses]).T
    np.testing.assert_allclose(motion, histories["x_jenkins"], atol=1e-9 * np.abs(motion).max())
    assert jenkins.energy.balance_error < 1e-13


def test_a_cantilever_with_a_slider_agrees_with_the_reference() -> None:
    """A damped beam with friction at its tip, from rest."""
    s, values, histories = reference_case("friction/cantilever")
    beam = vf.Beam(s["L"], s["EI"], s["rhoA"], s["elements"], {"left": "clamped"}, name="beam")
    effects = [
        vf.Friction(beam.at("right"), coefficient=1.0, normal=s["f"], name="pad"),
        vf.RayleighDamping(0.0, s["beta"]),
        vf.PointLoad(beam.at(s["load_node"] * s["L"] / s["elements"]), vf.Sine(s["F"], s["Omega"])),
    ]
    result = run(vf.Scene([beam], effects), s["t_end"], histories["t"])
    tip = result.displacement(beam.at("right"))
    np.testing.assert_allclose(tip, histories["tip"], atol=1e-9 * np.abs(tip).max())
    slider = result.frictions["pad"]
    events = np.sort(np.concatenate([slider.stops, slider.breaks]))
    np.testing.assert_allclose(events, [time for time, _ in values["events"]], atol=1e-9)
    assert slider.dissipated[-1] == pytest.approx(values["friction_work"], rel=1e-9)
    assert result.energy.balance_error < 1e-12


@pytest.mark.parametrize("name", ["denhartog_nonstop", "denhartog_nonstop_above", "denhartog_twostop"])
def test_den_hartogs_orbits_close_and_have_his_amplitudes(name: str) -> None:
    """Three periods of the closed orbit, and the amplitude that a run from rest settles to."""
    s, values, histories = reference_case(f"friction/{name}")
    mass = vf.Mass(s["m"], stiffness=s["k"], name="mass")
    effects = [vf.Friction(mass, coefficient=0.5, normal=2.0 * s["f"], name="pad"),
               vf.PointLoad(mass, vf.Sine(s["F"], s["Omega"], phase=0.5 * np.pi))]  # fmt: skip
    scene, t0 = vf.Scene([mass], effects, initial={mass: (s["x0"], s["v0"])}), s["t0"]
    result = run(scene, float(histories["t"][-1] - t0), histories["t"] - t0, t_start=t0)
    np.testing.assert_allclose(result.displacement(mass), histories["x"], atol=1e-12)
    slider = result.frictions["pad"]
    events = np.sort(np.concatenate([slider.stops, slider.breaks])) + t0
    expected = [time for time, _ in values["events_of_orbit"]]
    np.testing.assert_allclose(events[: len(expected)], expected, atol=1e-11)
    period = 2.0 * np.pi / s["Omega"]
    cycles = round(float(histories["t"][-1] - t0) / period)
    assert slider.dissipated[-1] == pytest.approx(cycles * values["dissipated_per_cycle"], rel=1e-11)
    rest = vf.Scene([mass], effects)
    settled = run(rest, 60.0 * period, np.linspace(58.0, 60.0, 401) * period)
    assert np.abs(settled.displacement(mass)).max() == pytest.approx(values["amplitude"], rel=4e-3)
    assert settled.energy.balance_error < 1e-12


def test_free_vibration_ends_stuck_and_a_shaken_mass_slides_as_published() -> None:
    """SDND100 and SDND104 of code_aster's validation: extremes in equal steps, and mean powers of wear."""
    mass = vf.Mass(1.0, stiffness=1e4, name="mass")
    scene = vf.Scene(
        [mass], [vf.Friction(mass, coefficient=0.5, normal=2.0, name="pad")], initial={mass: (8.5e-4, 0.0)}
    )
    result = run(scene, 0.3, np.arange(1, 10) * np.pi / 100.0)
    expected = [-6.5e-4, 4.5e-4, -2.5e-4, *[5e-5] * 6]
    np.testing.assert_allclose(result.displacement(mass), expected, rtol=1e-12)
    np.testing.assert_allclose(result.frictions["pad"].stops, np.arange(1, 5) * np.pi / 100.0, rtol=1e-12)
    assert not result.frictions["pad"].breaks.size
    for amplitude, power in ((15.0, 15.267099589), (1.5, 0.409062451), (1.01, 2.26164121e-4), (0.99, 0.0)):
        block = vf.Mass(1.0, name="block")
        effects = [vf.Friction(block, coefficient=0.1, normal=10.0, name="plane"),
                   vf.BaseMotion(block, vf.Sine(amplitude, 2.0 * np.pi))]  # fmt: skip
        shaken = run(vf.Scene([block], effects), 12.0, np.array([4.0, 12.0]))
        lost = np.diff(shaken.frictions["plane"].dissipated)[0]
        assert lost / 0.1 / 8.0 == pytest.approx(power, rel=3e-9, abs=1e-14)
        assert shaken.energy.balance_error < 1e-13 or amplitude == 0.99


@pytest.mark.parametrize("seed", range(6))
def test_two_sliders_on_a_moving_belt_agree_with_an_integration_written_for_them(seed: int) -> None:
    """Two masses of random numbers, each with a rigid slider, one on a belt, against DOP853 with its own statuses."""
    rng = np.random.default_rng(seed)
    m, k = rng.uniform(0.4, 1.5, 2), rng.uniform(10.0, 50.0, 3)
    limits = rng.uniform(0.4, 1.6, 2)
    statics = limits * np.array([rng.uniform(1.0, 1.4), 1.0])
    strength, omega, mean, swing, slow = rng.uniform([2.0, 2.0, -0.1, 0.0, 1.0], [6.0, 6.0, 0.1, 0.3, 3.0])
    one, two = vf.Mass(m[0], stiffness=k[0], name="one"), vf.Mass(m[1], stiffness=k[2], name="two")
    effects = [
        vf.Spring(one, two, stiffness=k[1]),
        vf.PointLoad(two, vf.Sine(strength, omega)),
        vf.Friction(
            one, coefficient=limits[0], static=statics[0], normal=1.0, belt=vf.Sine(swing, slow) + mean, name="b"
        ),
        vf.Friction(two, coefficient=limits[1], normal=1.0, name="g"),
    ]
    t_end = 4.0
    result = run(vf.Scene([one, two], effects), t_end, np.linspace(0.0, t_end, 81))
    stiffness = np.array([[k[0] + k[1], -k[1]], [-k[1], k[1] + k[2]]])

    def belt(t: float) -> np.ndarray:
        return np.array([mean + swing * np.sin(slow * t), 0.0])

    def free(t: float, q: np.ndarray) -> np.ndarray:
        return np.array([0.0, strength * np.sin(omega * t)]) - stiffness @ q

    def forces(t: float, q: np.ndarray, status: np.ndarray) -> np.ndarray:
        """Return friction forces: the mass matrix is diagonal, so each stuck one is known by itself."""
        pull = m * np.array([swing * slow * np.cos(slow * t), 0.0])
        return np.where(status == 0, free(t, q) - pull, status * limits)

    def chosen(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        reaction, slip = forces(t, q, np.zeros(2)), v - belt(t)
        rest = np.where(np.abs(reaction) <= statics, 0.0, np.sign(reaction))
        return np.where(np.abs(slip) < 1e-9, rest, np.sign(slip))

    t, q, v = 0.0, np.zeros(2), np.zeros(2)
    status, found = chosen(t, q, v), [np.zeros(3)]
    while t < t_end:

        def rates(t: float, y: np.ndarray, status: np.ndarray = status) -> np.ndarray:
            return np.concatenate([y[2:], (free(t, y[:2]) - forces(t, y[:2], status)) / m])

        events: list[Any] = []
        for j in range(2):
            for sign in (1.0, -1.0) if status[j] == 0 else (status[j],):

                def leave(
                    t: float, y: np.ndarray, j: int = j, sign: float = sign, status: np.ndarray = status
                ) -> float:
                    if status[j] == 0:
                        return float(sign * forces(t, y[:2], status)[j] - statics[j])
                    return float(-sign * (y[2:] - belt(t))[j])

                leave.terminal, leave.direction = True, 1.0  # type: ignore[attr-defined]
                events.append((j, sign, leave))
        step = solve_ivp(rates, (t, t_end), np.concatenate([q, v]), method="DOP853", rtol=1e-12, atol=1e-14,
                         events=[e for _, _, e in events], max_step=0.02,
                         t_eval=result.times[result.times > t])  # fmt: skip
        found += [np.array([s, *y[:2]]) for s, y in zip(step.t, np.transpose(step.y), strict=True)]
        hits = [(times[0], n) for n, times in enumerate(step.t_events) if times.size]
        if not hits:
            break
        t, n = min(hits)
        y = step.y_events[n][0]
        q, v, (j, sign, _) = y[:2].copy(), y[2:].copy(), events[n]
        status = status.copy()
        if status[j] == 0:
            status[j] = sign
        else:
            v[j] = belt(t)[j]
            status[j] = chosen(t, q, v)[j]
    motion = np.array(found)
    np.testing.assert_array_equal(motion[:, 0], result.times)
    mine = np.array([result.displacement(one), result.displacement(two)])
    np.testing.assert_allclose(mine, motion[:, 1:].T, atol=1e-9)
    assert result.frictions["b"].stops.size + result.frictions["g"].stops.size > 2
    assert result.energy.balance_error < 1e-12


def test_sliders_that_hold_each_other_share_the_load() -> None:
    """Two sliders in a row on one beam, both stuck: reactions are those of a beam on two supports until one breaks."""
    beam = vf.Beam(1.0, 10.0, 0.5, 4, {"left": "clamped"}, name="beam")
    pads = [vf.Friction(beam.at(x), coefficient=0.5, normal=4.0, name=f"pad {x:g}") for x in (0.5, 1.0)]
    load = vf.PointLoad(beam.at(0.75), vf.Ramp(5.0))
    scene = vf.Scene([beam], [*pads, load, vf.RayleighDamping(0.0, 1e-3)])
    result = run(scene, 1.2)
    first, second = (result.frictions[pad.name] for pad in pads)
    assert first.breaks.size
    assert second.breaks.size
    early = result.times < min(first.breaks[0], second.breaks[0])
    assert np.all(first.slip_speed[early] == 0.0)
    assert np.all(np.abs(first.force) <= 2.0 * (1.0 + 1e-12))
    assert np.all(np.abs(second.force) <= 2.0 * (1.0 + 1e-12))
    # Once both slide, their forces are at the limit.
    assert first.force[-1] == pytest.approx(2.0)
    assert result.energy.balance_error < 1e-11


def test_friction_beside_contacts_and_rigid_stops() -> None:
    """A block that slides against an elastic stop on one side and a rigid one on the other."""
    block = vf.Mass(1.0, stiffness=5.0, name="block")
    effects = [
        vf.Friction(block, coefficient=0.2, normal=2.0, name="plane"),
        vf.Contact(block, gap=0.1, stiffness=500.0, damping=1.0, side="above", acts_on="penetration", name="soft"),
        vf.RigidStop(block, gap=0.15, restitution=0.7, side="below", name="hard"),
        vf.PointLoad(block, vf.Sine(4.0, 3.0)),
    ]
    result = run(vf.Scene([block], effects), 10.0)
    assert result.contacts["soft"].closings.size > 3
    assert len(result.contacts["hard"].impacts) > 3
    assert result.displacement(block).min() > -0.15 - 1e-14
    assert result.contact_samples.force.shape == (2, result.times.size)
    assert result.energy.balance_error < 1e-12
    lost = result.frictions["plane"].dissipated[-1] + result.contacts["hard"].impacts.absorbed.sum()
    assert result.energy.dissipated[-1] > lost


def test_sliders_are_columns_of_tables_and_files(tmp_path: Path) -> None:
    """A mass on a plane and a shaft in a bushing: two sliders of different units."""
    import xarray

    block = vf.Mass(1.0, stiffness=5.0, name="block")
    shaft = vf.Beam(1.0, 3.0, 1.0, 2, {"left": "clamped"}, name="shaft")
    effects = [
        vf.Friction(block, coefficient=0.2, normal=2.0, name="plane"),
        vf.Friction(shaft.at(1.0), coefficient=0.1, normal=2.0, of="rotation", name="bushing"),
        vf.PointLoad(block, vf.Sine(4.0, 3.0)),
        vf.PointLoad(shaft.at(1.0), vf.Sine(4.0, 3.0)),
    ]
    result = run(vf.Scene([block, shaft], effects), 2.0, np.linspace(0.0, 2.0, 41))
    path = result.save(tmp_path / "run.vtkhdf", frames=1)
    data, frame = result.to_xarray(), result.to_dataframe()
    write_csv(result, [block], tmp_path / "run.csv")
    lines = (tmp_path / "run.csv").read_text().splitlines()
    with xarray.open_dataset(path, group="history", engine="h5netcdf") as stored:
        assert stored.friction_status.attrs == data.friction_status.attrs
        for name, unit, speed in (("plane", "N", "m/s"), ("bushing", "N m", "rad/s")):
            history = result.frictions[name]
            for what in ("force", "slip_speed", "status", "dissipated"):
                values = getattr(history, what)
                assert np.ptp(values) > 0.0
                for found in (data, stored):
                    np.testing.assert_array_equal(found[f"friction_{what}"].sel(friction=name), values)
            np.testing.assert_array_equal(frame[f"{name} force [{unit}]"], history.force)
            np.testing.assert_array_equal(frame[f"{name} slip speed [{speed}]"], history.slip_speed)
            column = lines[0].split(",").index(f"{name} slip speed [{speed}]")
            assert [float(line.split(",")[column]) for line in lines[1:]] == history.slip_speed.tolist()
        assert stored.friction_dissipated.attrs == {"units": "J"}


def steps(
    scene: vf.Scene, t_end: float, count: int, times: np.ndarray | None = None, method: str = "energy_conserving"
) -> vf.Result:
    """Return a run in equal steps."""
    return vf.simulate(scene, t_end, method=method, dt=t_end / count, times=times, nearby=False)


def test_steps_follow_a_belt_and_a_chain_with_second_order() -> None:
    """Stick-slip, reversals and a spring in series against the reference: the error falls with the step squared."""
    s, values, histories = reference_case("friction/belt")
    mass = vf.Mass(s["m"], stiffness=s["k"], name="mass")
    pad = vf.Friction(
        mass, coefficient=s["mu_dynamic"], static=s["mu_static"], normal=s["N"], belt=s["v_belt"], name="pad"
    )
    scene = vf.Scene([mass], [pad], initial={mass: (0.0, s["v_belt"])})
    errors = []
    for count in (400, 1600):
        result = steps(scene, s["t_end"], count, histories["t"])
        errors.append(np.abs(result.displacement(mass) - histories["x"]).max() / np.abs(histories["x"]).max())
    assert errors[1] < 1e-3
    assert errors[0] > 11.0 * errors[1]
    slider = result.frictions["pad"]
    np.testing.assert_allclose(slider.breaks, values["events"][0::2], rtol=2e-4)
    np.testing.assert_allclose(slider.stops, values["events"][1::2], rtol=2e-4)
    assert slider.dissipated[-1] == pytest.approx(values["total_dissipated"], rel=1e-4)
    assert np.all(slider.slip_speed[slider.status == 0] == 0.0)
    assert np.all(slider.force[slider.status == -1][:3] < 0.0)
    assert steps(scene, s["t_end"], 100).energy.balance_error < 1e-13
    s, values, histories = reference_case("friction/chain")
    stops = [time for time, what in values["events"] if what.startswith("stop")]
    breaks = [time for time, what in values["events"] if what.startswith("break")]
    for options, of, bound in (({}, "x", 5e-3), ({"stiffness": float(histories["kt_jenkins"])}, "x_jenkins", 6e-3)):
        scene, masses = chain(s, **options)
        errors = []
        for count in (500, 2000):
            result = steps(scene, s["t_end"], count, histories["t"])
            motion = np.array([result.displacement(mass) for mass in masses]).T
            errors.append(np.abs(motion - histories[of]).max() / np.abs(motion).max())
        assert errors[1] < bound
        assert errors[0] > 11.0 * errors[1]
        whole = steps(scene, s["t_end"], 500)
        assert whole.energy.balance_error < 1e-13
        slider = whole.frictions["pad"]
        assert np.diff(slider.dissipated).min() > -1e-15
        assert np.all(np.abs(slider.force) <= s["f"] * (1.0 + 1e-12))
        if not options:
            np.testing.assert_allclose(result.frictions["pad"].stops, stops, atol=1e-3)
            np.testing.assert_allclose(result.frictions["pad"].breaks, breaks, atol=1e-3)


def bouncing(s: dict[str, Any], **options: Any) -> tuple[vf.Scene, vf.Mass]:
    """Return the mass of the reference data that bounces and slides, its two directions as two masses."""
    along = {"stiffness": s["kx"]} if s["kx"] else {}
    x, y = vf.Mass(s["m"], name="x", **along), vf.Mass(s["m"], name="y")
    floor = vf.Contact(y, gap=0.0, stiffness=s["kn"], side="below", acts_on="penetration", name="floor")
    pad = vf.Friction(x, coefficient=s["mu"], contact=floor, name="pad", **options)
    effects = [pad, floor, vf.PointLoad(y, -s["m"] * s["g"])]
    return vf.Scene([x, y], effects, initial={x: (0.0, s["vx0"]), y: (s["h0"], 0.0)}), x


def test_friction_follows_the_force_of_a_contact() -> None:
    """A bounce that slides until it rests, one held by a spring, and a flutter of coupled modes on a belt."""
    for name, bound, order in (("bounce", 4e-5, 14.0), ("bounce_spring", 5e-4, 4.0)):
        s, values, histories = reference_case(f"friction/{name}")
        scene, x = bouncing(s)
        errors = []
        for count in (500, 2000):
            result = steps(scene, s["t_end"], count, histories["t"])
            errors.append(np.abs(result.displacement(x) - histories["x"]).max() / np.abs(histories["x"]).max())
        assert errors[1] < bound
        assert errors[0] > order * errors[1]
        slider, contact = result.frictions["pad"], result.contacts["floor"]
        assert slider.dissipated[-1] == pytest.approx(values["dissipated"], rel=1e-9)
        assert np.all(slider.force[contact.force == 0.0][20:30] == 0.0)
        stops = [time for time, what in values["events"] if what.startswith("stop")]
        np.testing.assert_allclose(slider.stops[:3], stops[:3], atol=3e-4)
        assert steps(scene, s["t_end"], 100).energy.balance_error < 1e-13
        power = np.trapezoid(slider.wear_power, result.times)
        assert power == pytest.approx(values["int_N_absw"], rel=2e-2)
    s, _, histories = reference_case("friction/mode_coupling")
    scene, x = flutter(s)
    errors = []
    for count in (750, 1500):
        result = steps(scene, s["t_end"], count, histories["t"])
        errors.append(np.abs(result.displacement(x) - histories["q"][:, 0]).max() / np.abs(histories["q"][:, 0]).max())
    assert errors[1] < 6e-2
    assert errors[0] > 3.7 * errors[1]
    assert not result.frictions["pad"].stops.size
    assert steps(scene, s["t_end"], 100).energy.balance_error < 1e-13


def flutter(s: dict[str, Any]) -> tuple[vf.Scene, vf.Mass]:
    """Return the mass of the reference data whose two directions a belt couples."""
    (kx, kxy), (_, ky) = s["K"]
    x = vf.Mass(s["m"], stiffness=kx - kxy, damping=s["c_times_M"] * s["m"], name="x")
    y = vf.Mass(s["m"], stiffness=ky - kxy, damping=s["c_times_M"] * s["m"], name="y")
    # The y axis of the reference points into the belt.
    effects = [
        vf.Friction(x, coefficient=s["mu"], contact="belt", belt=s["v_belt"], name="pad"),
        vf.Contact(y, gap=0.0, stiffness=s["kn"], side="below", acts_on="penetration", name="belt"),
        vf.Spring(x, y, stiffness=kxy),
        vf.PointLoad(y, -s["Nst"]),
    ]
    return vf.Scene([x, y], effects, initial={x: (s["q0"][0], 0.0), y: (-s["q0"][1], 0.0)}), x


@pytest.mark.parametrize(("method", "sooner"), [("generalized_alpha", 1.0), ("central_difference", 0.5)])
def test_other_steps_slide_with_second_order(method: str, sooner: float) -> None:
    """Stick-slip with a jump at break-away, reversals, and friction under a contact; `sooner` scales the errors."""
    s, values, histories = reference_case("friction/belt")
    mass = vf.Mass(s["m"], stiffness=s["k"], name="mass")
    pad = vf.Friction(
        mass, coefficient=s["mu_dynamic"], static=s["mu_static"], normal=s["N"], belt=s["v_belt"], name="pad"
    )
    belt = vf.Scene([mass], [pad], initial={mass: (0.0, s["v_belt"])})
    sizes = (300, 1200)
    runs = [steps(belt, s["t_end"], count, histories["t"], method) for count in sizes]
    errors = [np.abs(run.displacement(mass) - histories["x"]).max() / histories["x"].max() for run in runs]
    assert errors[1] < 1.5e-3 * sooner
    assert errors[0] > 12.0 * errors[1]
    slider = runs[1].frictions["pad"]
    np.testing.assert_allclose(slider.breaks, values["events"][0::2], rtol=2e-4)
    np.testing.assert_allclose(slider.stops, values["events"][1::2], rtol=2e-4)
    assert slider.dissipated[-1] == pytest.approx(values["total_dissipated"], rel=2e-3)
    s, _, histories = reference_case("friction/chain")
    scene, masses = chain(s)
    errors = []
    for count in (500, 2000):
        result = steps(scene, s["t_end"], count, histories["t"], method)
        motion = np.array([result.displacement(mass) for mass in masses]).T
        errors.append(np.abs(motion - histories["x"]).max() / np.abs(motion).max())
    assert errors[1] < 6e-3 * sooner
    assert errors[0] > 11.0 * errors[1]
    assert result.energy.balance_error < 1e-3
    s, _, histories = reference_case("friction/mode_coupling")
    scene, x = flutter(s)
    errors = []
    for count in (750, 1500):
        result = steps(scene, s["t_end"], count, histories["t"], method)
        errors.append(np.abs(result.displacement(x) - histories["q"][:, 0]).max() / np.abs(histories["q"][:, 0]).max())
    assert errors[1] < 6e-2 * sooner
    assert errors[0] > 3.7 * errors[1]
    # The largest friction force is that of the normal force at the time of balance, or some step has no solution.
    s, _, histories = reference_case("friction/bounce_spring")
    scene, x = bouncing(s)
    errors = []
    for count in (500, 2000, 4000):
        result = steps(scene, s["t_end"], count, histories["t"], method)
        errors.append(np.abs(result.displacement(x) - histories["x"]).max() / np.abs(histories["x"]).max())
    assert errors[-1] < 2e-4
    assert errors[0] > 8.0 * errors[-1]


def test_a_slider_that_sticks_behind_a_spring_does_not_slip() -> None:
    """By every method, also where it came to rest within the last step."""
    s, _, histories = reference_case("friction/chain")
    scene, _ = chain(s, stiffness=float(histories["kt_jenkins"]), static=1.5)
    for result in (run(scene, s["t_end"]), steps(scene, s["t_end"], 1600)):
        slider = result.frictions["pad"]
        assert 0.0 < np.mean(slider.status == 0) < 1.0
        np.testing.assert_array_equal(slider.slip_speed == 0.0, slider.status == 0)


@pytest.mark.parametrize("method", ["energy_conserving", "generalized_alpha", "central_difference"])
def test_a_slider_behind_a_spring_is_pressed_by_a_contact(method: str) -> None:
    """It is relaxed at every closing; the motion amplifies errors, so that many steps are needed."""
    s, _, histories = reference_case("friction/bounce_jenkins")
    scene, x = bouncing(s, stiffness=s["kt"])
    errors = []
    for count in (500, 8000):
        result = steps(scene, s["t_end"], count, histories["t"], method)
        errors.append(np.abs(result.displacement(x) - histories["x"]).max() / np.abs(histories["x"]).max())
    assert errors[1] < 4e-3
    assert errors[0] > 5.0 * errors[1]
    if method == "energy_conserving":
        # With these steps the slope of a mean force under a changing normal force matters.
        assert all(steps(scene, s["t_end"], count).energy.balance_error < 1e-13 for count in (50, 100, 120))
    slider, contact = result.frictions["pad"], result.contacts["floor"]
    assert np.abs(slider.force).max() == pytest.approx(s["mu"] * contact.force.max(), rel=0.1)
    assert slider.breaks.size > 5


@pytest.mark.parametrize("method", ["energy_conserving", "generalized_alpha"])
@pytest.mark.parametrize("spring", [10.0, 90.0, 1000.0])
def test_a_slider_behind_a_spring_moves_the_contact_that_presses_on_it(method: str, spring: float) -> None:
    """Against small explicit steps, in which the play of the slider is cut to what the normal force holds."""
    a, b = vf.Mass(1.0, stiffness=20.0, name="a"), vf.Mass(1.0, stiffness=10.0, name="b")
    floor = vf.Contact(b, gap=0.02, stiffness=300.0, side="below", acts_on="penetration", name="floor")
    pad = vf.Friction(a, b, coefficient=0.2, contact=floor, stiffness=spring, name="pad")
    scene = vf.Scene([a, b], [floor, pad, vf.PointLoad(a, vf.Sine(3.0, 5.0))], initial={b: (0.0, -1.0)})
    qa, qb, va, vb, stretch, dt = 0.0, 0.0, 0.0, -1.0, 0.0, 2e-5
    for n in range(50_000):
        normal = 300.0 * max(-qb - 0.02, 0.0)
        stretch = min(max(stretch, -0.2 * normal / spring), 0.2 * normal / spring)
        force = spring * stretch
        va += dt * (3.0 * math.sin(5.0 * n * dt) - 20.0 * qa - force) * (0.5 if n == 0 else 1.0)
        vb += dt * (normal + force - 10.0 * qb) * (0.5 if n == 0 else 1.0)
        qa, qb, stretch = qa + dt * va, qb + dt * vb, stretch + dt * (va - vb)
    result = steps(scene, 1.0, 1000, None, method)
    np.testing.assert_allclose([result.displacement(a)[-1], result.displacement(b)[-1]], [qa, qb], rtol=0.0, atol=5e-5)
    assert result.energy.balance_error < (1e-13 if method == "energy_conserving" else 1e-4)


@pytest.mark.parametrize("method", ["energy_conserving", "generalized_alpha", "central_difference"])
def test_a_normal_force_that_depends_on_time(method: str) -> None:
    """A block that slides loses speed as the impulse of the normal force grows; a force below zero presses nothing."""
    block = vf.Mass(1.0, name="block")
    errors = []
    for count in (200, 800):
        pad = vf.Friction(block, coefficient=0.5, normal=vf.Sine(3.0, 4.0) + 4.0, name="pad")
        result = steps(vf.Scene([block], [pad], initial={block: (0.0, 5.0)}), 2.0, count, None, method)
        errors.append(abs(result.velocity(block)[-1] - (5.0 - 0.5 * (8.0 + 0.75 * (1.0 - np.cos(8.0))))))
    assert errors[1] < 2e-5
    assert errors[1] < 1e-13 or errors[0] > 15.0 * errors[1]
    pad = vf.Friction(block, coefficient=0.5, normal=vf.Sine(4.0, np.pi), name="pad")
    result = steps(vf.Scene([block], [pad], initial={block: (0.0, 5.0)}), 2.0, 2000, None, method)
    assert result.velocity(block)[-1] == pytest.approx(5.0 - 4.0 / np.pi, rel=1e-5)
    assert np.all(result.frictions["pad"].wear_power[1500:] == 0.0)
    with pytest.raises(vf.MethodError, match="'pad' has a normal force that depends on time"):
        run(vf.Scene([block], [pad]), 1.0)


@pytest.mark.parametrize("method", ["energy_conserving", "generalized_alpha"])
def test_a_stuck_slider_breaks_away_on_time_under_a_tolerance(method: str) -> None:
    """Nothing moves for a hundred seconds, so no step has an error, and then a slow load or a fast one overcomes it."""
    block, tol = vf.Mass(1.0, name="block"), 1e-3
    pad = vf.Friction(block, coefficient=0.5, normal=2.0, name="pad")
    slow = vf.Scene([block], [pad, vf.PointLoad(block, vf.Ramp(0.01))])
    result = vf.simulate(slow, 110.0, method=method, tol=tol, times=[0.0, 99.0, 110.0])
    np.testing.assert_allclose(result.frictions["pad"].breaks, 100.0, rtol=1e-3)
    assert abs(result.displacement(block)[1]) < 1e-12
    assert result.displacement(block)[2] == pytest.approx(0.01 * 10.0**3 / 6.0, rel=3.0 * tol)
    fast = vf.Scene([block], [pad, vf.PointLoad(block, vf.Sine(1.2, 3.0))])
    result = vf.simulate(fast, 5.0, method=method, tol=tol, times=[0.0, 5.0])
    exact = run(fast, 5.0, np.array([0.0, 5.0]))
    assert result.frictions["pad"].breaks.size == exact.frictions["pad"].breaks.size > 3
    np.testing.assert_allclose(result.frictions["pad"].breaks, exact.frictions["pad"].breaks, atol=5e-3)
    assert result.displacement(block)[-1] == pytest.approx(exact.displacement(block)[-1], rel=1e-2)


@pytest.mark.parametrize("method", ["energy_conserving", "generalized_alpha", "central_difference"])
def test_a_slider_behind_a_spring_that_is_harder_to_start(method: str) -> None:
    """The force falls at break-away, within a step; the run is compared with the exact one."""
    mass = vf.Mass(1.0, stiffness=40.0, name="mass")
    pad = vf.Friction(mass, coefficient=0.3, static=0.4, normal=2.0, stiffness=500.0, name="pad")
    scene = vf.Scene([mass], [pad, vf.PointLoad(mass, vf.Sine(3.0, 2.0))])
    times = np.linspace(0.0, 5.0, 101)
    exact = run(scene, 5.0, times).displacement(mass)
    errors = [
        np.abs(steps(scene, 5.0, count, times, method).displacement(mass) - exact).max() for count in (1000, 4000)
    ]
    assert errors[1] < 5e-3 * np.abs(exact).max()
    assert errors[0] > 3.0 * errors[1]


def test_the_slip_of_a_slider_behind_a_spring_is_its_own_and_makes_the_heat() -> None:
    """The end of the spring moves while the slider sticks, and rubs on nothing; steps and the exact run agree."""
    block = vf.Mass(1.0, stiffness=20.0, name="block")
    pad = vf.Friction(block, coefficient=0.3, normal=2.0, stiffness=100.0, name="pad")
    scene = vf.Scene([block], [pad, vf.PointLoad(block, vf.Sine(2.5, 3.0))])
    times = np.linspace(0.0, 4.0, 2001)
    for result in (run(scene, 4.0, times), steps(scene, 4.0, 2000, times)):
        slider, stuck = result.frictions["pad"], result.frictions["pad"].status == 0
        assert 0.1 < np.mean(stuck) < 0.5
        assert np.abs(result.velocity(block)[stuck]).max() > 0.2
        assert np.all(slider.slip_speed[stuck] == 0.0)
        heat = np.trapezoid(0.3 * slider.wear_power, times)
        assert heat == pytest.approx(slider.dissipated[-1], rel=2e-3)


def test_several_sliders_on_a_beam_in_steps_agree_with_the_exact_run() -> None:
    """Two rigid sliders that hold each other, beside one behind a spring and a contact with a damper."""
    beam = vf.Beam(1.0, 10.0, 0.5, 4, {"left": "clamped"}, name="beam")
    effects = [
        vf.Friction(beam.at(0.5), coefficient=0.5, normal=4.0, name="one"),
        vf.Friction(beam.at(1.0), coefficient=0.5, static=0.6, normal=1.0, belt=vf.Sine(0.05, 8.0), name="two"),
        vf.Friction(beam.at(0.75), coefficient=0.2, normal=1.0, stiffness=300.0, name="three"),
        vf.Contact(beam.at(0.75), gap=0.01, stiffness=500.0, damping=1.0, side="above", acts_on="penetration",
                   name="stop"),
        vf.PointLoad(beam.at(0.75), vf.Sine(6.0, 9.0)),
        vf.RayleighDamping(0.0, 1e-3),
    ]  # fmt: skip
    scene = vf.Scene([beam], effects)
    times = np.linspace(0.0, 1.5, 151)
    exact = run(scene, 1.5, times)
    assert exact.contacts["stop"].closings.size
    size = np.abs(exact.displacement(beam.at("right"))).max()
    errors = []
    for count in (400, 1600):
        result = steps(scene, 1.5, count, times)
        errors.append(np.abs(result.displacement(beam.at("right")) - exact.displacement(beam.at("right"))).max() / size)
    assert errors[1] < 5e-3
    assert errors[0] > 3.0 * errors[1]
    for pad in ("one", "two", "three"):
        assert result.frictions[pad].dissipated[-1] == pytest.approx(exact.frictions[pad].dissipated[-1], rel=2e-2)
    assert steps(scene, 1.5, 300).energy.balance_error < 1e-12


def test_friction_under_a_contact_is_refused_where_it_cannot_be_treated() -> None:
    s, _, _ = reference_case("friction/bounce_spring")
    scene, x = bouncing(s)
    with pytest.raises(vf.MethodError, match=r"'pad' is pressed by the contact 'floor'.*event_driven.*energy_conserv"):
        run(scene, 1.0)
    for given, found in (
        ({}, "neither normal nor contact is"),
        ({"normal": 1.0, "contact": "floor"}, "both normal and contact are"),
    ):
        with pytest.raises(vf.ArgumentError, match=f"{found} given, expected one of them"):
            vf.Friction(x, coefficient=0.1, **given)
    with pytest.raises(vf.ArgumentError, match="contact is 'flor', expected a contact of the scene, which has 'floor'"):
        vf.Scene(scene.bodies, [*scene.effects[1:], vf.Friction(x, coefficient=0.1, contact="flor")])
    twins = [vf.Friction(x, coefficient=0.1, normal=1.0, name=name) for name in ("one", "two")]
    with pytest.raises(vf.MethodError, match="'one' and Friction 'two' act on coordinates that depend on each other"):
        steps(vf.Scene([x], twins), 1.0, 10)
    soft = vf.Friction(x, coefficient=0.1, normal=1.0, stiffness=5.0, name="soft")
    stops = [
        vf.Contact(x, gap=0.1, stiffness=5.0, side=side, acts_on=acts_on, name=side)
        for side, acts_on in (("above", "penetration"), ("below", "displacement"))
    ]
    with pytest.raises(vf.MethodError, match=r"beside Contact 'below', which acts on .* use acts_on='penetration'"):
        steps(vf.Scene([x], [soft, *stops]), 1.0, 10)
    pot = vf.Springpot(x, coefficient=1.0, order=0.5, name="pot")
    with pytest.raises(vf.MethodError, match=r"'one' is rigid and acts beside Springpot 'pot'.* slider a stiffness"):
        steps(vf.Scene([x], [soft, twins[0], pot]), 1.0, 10)


def test_what_takes_no_slider_names_it() -> None:
    """Everything that cannot take a slider names it, and says what can."""
    mass = vf.Mass(1.0, stiffness=10.0, name="mass")
    pad = vf.Friction(mass, coefficient=0.3, static=0.4, normal=2.0, belt=vf.Sine(0.1, 2.0), name="pad")
    scene = vf.Scene([mass], [pad, vf.PointLoad(mass, vf.Sine(3.0, 2.0))])
    first = run(scene, 3.0)
    assert "coefficient 0.3, 0.4 at break-away" in str(vf.explain(scene))
    for ask in (
        lambda: vf.equilibrium(scene),
        lambda: vf.periodic(scene),
        lambda: vf.periodic(scene, harmonics=3),
        lambda: vf.sensitivities(first, [vf.Parameter(mass, "stiffness")]),
    ):
        with pytest.raises(vf.VofemError, match="Friction 'pad'"):
            ask()
    with pytest.raises(vf.ArgumentError, match=r"static is 0.2, expected a number not below coefficient = 0.3"):
        vf.Friction(mass, coefficient=0.3, static=0.2, normal=1.0)
    twin = vf.Scene([mass], [pad, vf.Friction(mass, coefficient=0.1, normal=1.0, name="twin")])
    with pytest.raises(vf.MethodError, match=r"'pad' and Friction 'twin' act on coordinates that depend on each other"):
        run(twin, 1.0)
    odd = vf.Scene([mass], [vf.Friction(mass, coefficient=0.3, normal=1.0, belt=lambda t: t**2, name="odd")])
    with pytest.raises(vf.MethodError, match="'odd': the speed of its belt has no closed form"):
        run(odd, 1.0)


def test_harmonic_balance_of_a_slider_behind_a_spring(tmp_path: Path) -> None:
    """The exact amplitude of the oscillator, the settled motion of a beam with a stop, and a branch from its file."""
    exact = json.loads((DATA / "orbits" / "P7.json").read_text())["jenkins_exact"]
    block = vf.Mass(1.0, stiffness=1.0, damping=exact["c"], name="block")
    pad = vf.Friction(block, coefficient=0.25, normal=exact["fy"] / 0.25, stiffness=exact["kt"], name="pad")

    def shaken(omega: float) -> vf.Scene:
        return vf.Scene([block], [pad, vf.PointLoad(block, vf.Sine(exact["F"], omega))])

    omega, peak = map(float, exact["rows"][0][:2])
    orbit = vf.periodic(shaken(omega), method="harmonic_balance", harmonics=24)
    assert abs(orbit.amplitude(block) - peak) < 2e-8
    # Its sliding ends at its turning points, and what it takes in a period is the area of its loop.
    slider = orbit.result.frictions["pad"]
    assert abs(slider.stops[1] - slider.stops[0] - np.pi / omega) < 1e-12
    assert abs(slider.stops[1] - orbit.period - float(exact["rows"][0][2])) < 1e-6
    assert np.abs(orbit.result.velocity(block, slider.stops)).max() < 1e-6
    loop = 4.0 * exact["fy"] * (peak - exact["fy"] / exact["kt"])
    assert abs(slider.dissipated[-1] / loop - 1.0) < 1e-5
    assert set(slider.status) == {-1, 0, 1}
    assert not orbit.result.springs

    branch = vf.continuation(shaken, 1.1, 1.05, method="harmonic_balance", harmonics=3)
    loaded = vf.load(branch.save(tmp_path / "branch.h5"))
    one, other = (found.orbits[2].result.frictions["pad"] for found in (branch, loaded))
    np.testing.assert_array_equal(one.force, other.force)
    np.testing.assert_array_equal(one.breaks, other.breaks)

    beam = vf.Beam(1.0, 10.0, 0.5, 2, {"left": "clamped"}, name="beam")
    effects = [
        vf.Friction(beam.at(0.5), coefficient=0.5, normal=2.0, stiffness=300.0, name="pad"),
        vf.Contact(beam.at("right"), gap=0.02, stiffness=200.0, side="above", acts_on="penetration", name="stop"),
        vf.Dashpot(beam.at("right"), damping=1.0),
        vf.PointLoad(beam.at("right"), vf.Sine(4.0, 9.0)),
    ]
    scene = vf.Scene([beam], effects)
    period = 2.0 * np.pi / 9.0
    places = np.linspace(0.0, period, 50)
    settled = run(scene, 15 * period, 14 * period + places)
    balanced = vf.periodic(scene, method="harmonic_balance", harmonics=40, guess=settled)
    off = settled.displacement(beam.at("right")) - balanced.result.displacement(beam.at("right"), places)
    assert np.abs(off).max() < 3e-5 * balanced.amplitude(beam.at("right"))
    last = settled.frictions["pad"].breaks - 14 * period
    np.testing.assert_allclose(last[last > 0.0], balanced.result.frictions["pad"].breaks, atol=1e-5 * period)

    for wrong, found in (
        ({}, "sticks rigidly, so its force jumps.*find the orbit by shooting, give the slider a spring"),
        ({"stiffness": 1.0, "static": 0.4}, "has a static coefficient above the sliding one"),
        ({"stiffness": 1.0, "belt": 0.1}, "lies on a belt"),
    ):
        other = vf.Friction(block, coefficient=0.25, normal=1.0, name="other", **wrong)
        with pytest.raises(vf.MethodError, match=f"Friction 'other' {found}"):
            vf.periodic(vf.Scene([block], [other, *shaken(1.0).effects[1:]]), method="harmonic_balance")


def test_runs_of_one_scene_from_two_times_have_their_own_loads() -> None:
    """What a run with sliders leaves for later ones of its scene holds no function of time."""
    block = vf.Mass(1.0, stiffness=10.0)
    pad = vf.Friction(block, coefficient=0.3, normal=1.0, belt=vf.Sine(0.1, 3.0))

    def later(scene: vf.Scene) -> np.ndarray:
        return run(scene, 1.0, t_start=0.7).displacement(block)

    scene = vf.Scene([block], [pad, vf.PointLoad(block, vf.Sine(3.0, 2.0))])
    before = run(scene, 1.0).displacement(block)
    np.testing.assert_array_equal(later(scene), later(vf.Scene(scene.bodies, scene.effects)))
    assert np.abs(later(scene) - before).max() > 0.1


@pytest.mark.parametrize("stiffness", [None, 1e3], ids=["rigid", "spring"])
def test_a_support_carries_what_a_slider_beside_it_takes(stiffness: float | None) -> None:
    """At rest reaction, friction and load balance; a run that starts there says that it forgets the spring."""
    beam = vf.Beam(1.0, 10.0, 0.5, 1, {"left": "clamped"}, name="beam")
    pad = vf.Friction(beam.at(0.5), coefficient=0.5, normal=4.0, stiffness=stiffness, name="pad")
    scene = vf.Scene([beam], [pad, vf.PointLoad(beam.at(1.0), 1.0), vf.RayleighDamping(5.0, 1e-2)])
    result = run(scene, 20.0, np.array([0.3, 20.0]))
    force, friction = result.reaction(beam, "left").force, result.frictions["pad"].force
    assert abs(force[-1] - friction[-1] + 1.0) < 1e-12
    steps = vf.simulate(scene, 0.3, method="energy_conserving", dt=1e-3, times=[0.3])
    assert abs(steps.reaction(beam, "left").force[0] - force[0]) < 5e-3
    notes = run(scene, 0.1, np.array([0.1]), initial=result).notes
    assert [note.startswith("sliders: the spring of Friction 'pad' begins relaxed") for note in notes] == (
        [] if stiffness is None else [True]
    )


@pytest.mark.parametrize("start", [0.0, -0.05])
@pytest.mark.parametrize("between", [False, True])
def test_a_contact_that_presses_from_the_begin_moves_a_slider_as_a_spring_does(start: float, between: bool) -> None:
    """It pushes with more than the slider holds; the same spring, not as a contact, with its force as a load."""

    def run(pressing: bool) -> vf.Result:
        mass, other = vf.Mass(4.863, stiffness=13.4, name="m"), vf.Mass(2.0, stiffness=3.0, name="o")
        ends = (mass, other) if between else (mass,)
        effects: list[Any] = [vf.Friction(mass, coefficient=0.5, static=0.8, normal=5.0, name="f")]
        side: dict[str, Any] = {} if between else {"side": "below"}
        if pressing:
            effects.append(vf.Contact(*ends, gap=-0.2, stiffness=25.0, acts_on="penetration", name="stop", **side))
        else:
            push = -5.0 if between else 5.0
            effects += [vf.Spring(*ends, stiffness=25.0), vf.PointLoad(mass, push)]
            effects += [vf.PointLoad(other, -push)] if between else []
        bodies = [mass, other] if between else [mass]
        return vf.simulate(
            vf.Scene(bodies, effects, initial={mass: (-start if between else start, 0.0)}), 0.3, method="event_driven"
        )

    mine, twin = run(True), run(False)
    assert mine.contacts["stop"].force.min() > 0.0
    np.testing.assert_allclose(mine.frictions["f"].force, twin.frictions["f"].force, atol=1e-12)
    for body, same in zip(mine.scene.bodies, twin.scene.bodies, strict=True):
        np.testing.assert_allclose(mine.displacement(body), twin.displacement(same), atol=1e-12)
    assert np.ptp(mine.displacement(mine.scene.bodies[0])) > 1e-3


@pytest.mark.parametrize("method", ["energy_conserving", "generalized_alpha", "central_difference"])
def test_a_slider_behind_a_spring_beside_a_springpot_is_an_iwan_spring_of_one_element(method: str) -> None:
    """The slider is declared before or after the springpot; both laws have histories."""

    def run(effects: list[Any]) -> vf.Result:
        mass = effects[0].a
        return vf.simulate(
            vf.Scene([mass], [*effects, vf.PointLoad(mass, vf.Sine(1.0, 2.0))]), 4.0, method=method, dt=2e-3
        )

    mass = vf.Mass(1.0, stiffness=1.0, name="m")
    slider = vf.Friction(mass, coefficient=1.0, normal=0.1, stiffness=5.0, name="s")
    iwan = vf.IwanSpring(mass, elongation=[0.02, 0.5], force=[0.1, 0.1 + 1e-13], name="i")
    pot = vf.Springpot(mass, coefficient=0.5, order=0.5, name="p")
    first, last, twin = run([slider, pot]), run([pot, slider]), run([iwan, pot])
    for one in (first, last):
        np.testing.assert_allclose(one.displacement(mass), twin.displacement(mass), atol=1e-11)
        np.testing.assert_allclose(one.frictions["s"].force, twin.springs["i"].force, atol=5e-3)
        np.testing.assert_allclose(one.springs["p"].force, twin.springs["p"].force, atol=1e-10)


@pytest.mark.parametrize("method", ["energy_conserving", "generalized_alpha", "central_difference"])
@pytest.mark.parametrize(("time", "mass", "length"), [(1e-3, 1e6, 1.0), (1e-6, 1e5, 1e-9), (1e3, 1e-9, 1e3)])
def test_a_block_that_sticks_and_slides_does_so_in_all_units(
    method: str, time: float, mass: float, length: float
) -> None:
    """Where it sticks its place is held, however large forces are as numbers beside displacements."""
    force = mass * length / time**2
    block = vf.Mass(mass, stiffness=12.5 * mass / time**2, name="block")
    pad = vf.Friction(block, coefficient=0.5, normal=0.84 * force, name="pad")
    scene = vf.Scene(
        [block],
        [pad, vf.PointLoad(block, vf.Sine(force, 0.5 / time))],
        initial={block: (0.03 * length, 1.42 * length / time)},
    )
    times = np.linspace(0.0, 10.0 * time, 201)
    exact = run(scene, times[-1], times)
    steps = vf.simulate(scene, times[-1], method=method, times=times, dt=times[-1] / 6000)
    moved = exact.displacement(block)
    assert np.abs(moved - steps.displacement(block)).max() < 1e-4 * np.abs(moved).max()
    slider = steps.frictions["pad"]
    assert np.any(slider.status == 0)
    assert np.diff(slider.dissipated).min() >= -1e-12 * slider.dissipated[-1]


def test_steps_under_a_tolerance_grow_again_after_a_slider_has_turned() -> None:
    """They become short where it turns. There a force that moves it must not be taken for rounding."""
    mass = vf.Mass(1.0, stiffness=900.0, name="m")
    pad = vf.Friction(mass, coefficient=0.3, normal=3.27, name="pad")
    scene = vf.Scene([mass], [pad], initial={mass: (0.0, 0.5)})
    result = vf.simulate(scene, 0.06, method="energy_conserving", tol=3e-7)
    assert result.frictions["pad"].stops == pytest.approx(run(scene, 0.06).frictions["pad"].stops, abs=1e-7)
    assert result.counters.steps < 6000


@pytest.mark.parametrize("difference", [1e-14, 1e-12, 1e-10])
def test_two_joints_that_are_nearly_equal_begin_to_slide_together(difference):
    """One of them is at its limit when the other one has just begun and has no speed yet; the run went no further."""
    a, b, c = (
        vf.Mass(0.8, stiffness=1.0, damping=0.08, name="a"),
        vf.Mass(0.7, stiffness=0.4, damping=0.08, name="b"),
        vf.Mass(0.8, stiffness=1.0, damping=0.08, name="c"),
    )
    effects = [vf.Spring(a, b, stiffness=0.9), vf.Spring(b, c, stiffness=0.9), vf.PointLoad(b, vf.Sine(0.4, 1.1))]
    pads = [
        vf.Friction(mass, coefficient=0.25, normal=1.0 + k * difference, name=f"pad {mass.name}")
        for k, mass in enumerate((a, c))
    ]
    result = vf.simulate(vf.Scene([a, b, c], [*effects, *pads]), 30.0, method="event_driven")
    assert result.frictions["pad a"].breaks.size == result.frictions["pad c"].breaks.size == 10
    np.testing.assert_allclose(result.displacement(a), result.displacement(c), atol=100.0 * difference)
