"""Periodic orbits with dry friction: reference data, Den Hartog's closed form, and runs beside them."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vofem as vf

DATA = Path(__file__).parent / "data" / "friction"


def oscillator(load: float, omega: float, limit: float = 1.0, static: float | None = None) -> vf.Scene:
    """Return a mass of 1 on a spring of 1 with friction under a harmonic load."""
    mass = vf.Mass(1.0, stiffness=1.0, name="mass")
    pad = vf.Friction(mass, coefficient=0.5, static=static, normal=2.0 * limit, name="pad")
    return vf.Scene([mass], [pad, vf.PointLoad(mass, vf.Sine(load, omega, phase=0.5 * np.pi))])


@pytest.mark.parametrize("name", ["denhartog_nonstop", "denhartog_nonstop_above", "denhartog_twostop"])
def test_den_hartogs_orbits_are_found_from_rest(name: str) -> None:
    """Amplitude, dissipated energy and times at rest; a slider that sticks forgets, so one multiplier is zero."""
    read = json.loads((DATA / f"{name}.json").read_text())
    s, values = read["scene"], read["values"]
    mass = vf.Mass(s["m"], stiffness=s["k"], name="mass")
    effects = [vf.Friction(mass, coefficient=0.5, normal=2.0 * s["f"], name="pad"),
               vf.PointLoad(mass, vf.Sine(s["F"], s["Omega"], phase=0.5 * np.pi))]  # fmt: skip
    orbit = vf.periodic(vf.Scene([mass], effects))
    assert orbit.amplitude(mass) == pytest.approx(values["amplitude"], rel=1e-11)
    assert orbit.residual < 1e-12
    assert orbit.stable
    slider, period = orbit.result.frictions["pad"], 2.0 * np.pi / s["Omega"]
    assert slider.dissipated[-1] == pytest.approx(values["dissipated_per_cycle"], rel=1e-11)
    expected = np.sort(np.array([time for time, _ in values["events_of_orbit"]][: 4 if "two" in name else 2]) % period)
    np.testing.assert_allclose(np.sort(np.concatenate([slider.stops, slider.breaks])), expected, atol=1e-10)
    assert ("two" in name) == bool(np.min(np.abs(orbit.multipliers)) < 1e-12)


def onset(omega: float, limit: float = 1.0, static: float = 1.0) -> float:
    """Return the load at which a symmetric orbit that turns at once begins to stick: Den Hartog's limit.

    From its largest displacement x0 on, ``x = A cos t + B sin t + L + (C cos(w t) + S sin(w t))/(1 - w^2)``. After half
    a period it is at -x0, at rest again. At the limit static friction just holds the mass there.
    """
    half, gain = np.pi / omega, 1.0 / (1.0 - omega**2)
    c, s = np.cos(half), np.sin(half)
    # Unknowns A, B, C, S, x0.
    equations = np.array([
        [1.0, 0.0, gain, 0.0, -1.0],
        [0.0, 1.0, 0.0, gain * omega, 0.0],
        [c, s, -gain, 0.0, 1.0],
        [-s, c, 0.0, -gain * omega, 0.0],
        [0.0, 0.0, 1.0, 0.0, -1.0],
    ])  # fmt: skip
    found = np.linalg.solve(equations, [-limit, 0.0, -limit, 0.0, -static])
    return float(np.hypot(found[2], found[3]))


@pytest.mark.parametrize(("ends", "static"), [((4.0, 1.3), 1.0), ((1.3, 4.0), 1.0), ((3.0, 2.0), 1.1)])
def test_a_branch_passes_the_onset_of_sticking(ends: tuple[float, float], static: float) -> None:
    """Both stops of a symmetric orbit begin at Den Hartog's limit, in both directions, also with static friction."""
    branch = vf.continuation(lambda load: oscillator(load, 0.6, static=0.5 * static), *ends)
    assert [mark.kind for mark in branch.special] == ["sticking", "sticking"]
    for mark in branch.special:
        assert mark.value == pytest.approx(onset(0.6, static=static), rel=1e-12)
        assert mark.contact == "pad"
    assert branch.values[-1] == ends[1]
    for orbit in branch.orbits[::4]:
        assert orbit.residual < 1e-9
        sticks = orbit.result.frictions["pad"].breaks.size > 0
        assert sticks == bool(np.min(np.abs(orbit.multipliers)) < 1e-9)


def chain(load: float) -> tuple[vf.Scene, list[vf.Mass]]:
    """Return three masses, one of which sticks and slides and one of which touches an elastic stop."""
    masses = [vf.Mass(1.0 + 0.2 * k, stiffness=0.4, damping=0.02, name=f"m{k}") for k in range(3)]
    effects: list[Any] = [
        vf.Spring(masses[0], masses[1], stiffness=1.5),
        vf.Spring(masses[1], masses[2], stiffness=1.1),
        vf.Friction(masses[0], coefficient=0.5, normal=0.5, name="pad"),
        vf.Contact(masses[2], gap=0.9, stiffness=4.0, acts_on="penetration", side="above", name="stop"),
        vf.PointLoad(masses[1], vf.Sine(load, 0.55, phase=0.3)),
    ]
    return vf.Scene(masses, effects), masses


def test_multipliers_of_a_chain_with_friction_and_a_stop_agree_with_runs_beside_the_orbit() -> None:
    """The monodromy matrix by differences of runs over a period; directions are forgotten while the slider sticks."""
    scene, masses = chain(0.9)
    orbit = vf.periodic(scene)
    assert len(orbit.result.contacts["stop"].impacts) == 1
    assert orbit.result.frictions["pad"].breaks.size
    start = np.array([value for mass in masses for value in (orbit.result.displacement(mass)[0],
                                                             orbit.result.velocity(mass)[0])])  # fmt: skip

    def after(state: np.ndarray) -> np.ndarray:
        moved = vf.Scene(
            masses, scene.effects, initial={m: tuple(state[2 * k : 2 * k + 2]) for k, m in enumerate(masses)}
        )
        run = vf.simulate(moved, orbit.period, method="event_driven", times=[0.0, orbit.period])
        return np.array([value for mass in masses for value in (run.displacement(mass)[1], run.velocity(mass)[1])])

    step = 1e-6
    columns = [(after(start + step * unit) - after(start - step * unit)) / (2.0 * step) for unit in np.eye(6)]
    expected = np.linalg.eigvals(np.array(columns).T)
    mine = np.asarray(orbit.multipliers)
    np.testing.assert_allclose(np.sort(np.abs(mine)), np.sort(np.abs(expected)), atol=2e-7)


@pytest.mark.parametrize(
    ("name", "ends", "stiffness"),
    [("normal", (0.2, 1.0), None), ("coefficient", (0.02, 0.1), None), ("normal", (0.2, 1.0), 2.0)],
)
def test_branches_along_the_friction_are_those_of_each_value(
    name: str, ends: tuple[float, float], stiffness: float | None
) -> None:
    """Rigid sliders by shooting, one behind a spring by harmonic balance; and an orbit as a guess lends no force."""

    def build(value: float) -> vf.Scene:
        of = {"normal": 1.0, "coefficient": 0.1, name: value}
        mass = vf.Mass(1.0, stiffness=1.0, damping=0.05, name="m")
        slider = vf.Friction(mass, name="f", **of, **({} if stiffness is None else {"stiffness": stiffness}))
        return vf.Scene([mass], [slider, vf.PointLoad(mass, vf.Sine(0.3, 0.8))])

    branch = vf.continuation(build, *ends)
    assert branch.values[-1] == ends[1]
    mass = branch.orbits[0].scene.bodies[0]
    first, last = (vf.periodic(build(end), method=branch.orbits[0].method) for end in ends)
    amplitudes = [one.amplitude(one.scene.bodies[0]) for one in (first, last)]
    assert amplitudes[1] < 0.95 * amplitudes[0]
    assert branch.amplitude(mass)[[0, -1]] == pytest.approx(amplitudes, rel=1e-9)
    beside = vf.periodic(build(ends[1]), guess=first, method=first.method)
    assert beside.amplitude(beside.scene.bodies[0]) == pytest.approx(amplitudes[1], rel=1e-9)


def damped(omega: float, static: float | None = None) -> vf.Scene:
    """Return a damped mass on a spring with friction, under a load of four times its limit."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.05, name="mass")
    pad = vf.Friction(mass, coefficient=0.5, static=static, normal=2.0, name="pad")
    return vf.Scene([mass], [pad, vf.PointLoad(mass, vf.Sine(4.0, omega))])


def test_a_branch_passes_stops_of_a_slider_that_slides_on_and_its_motions_while_it_sticks() -> None:
    """Both directions list the same; runs from rest stop as often as orbits between the special points."""
    there, back = vf.continuation(damped, 0.5, 0.2), vf.continuation(damped, 0.2, 0.5)
    assert (there.values[-1], back.values[-1]) == (0.2, 0.5)
    assert [mark.kind for mark in (*there.special, *back.special)] == ["sticking"] * 16
    values = np.array([mark.value for mark in there.special])
    np.testing.assert_allclose(values, np.array([mark.value for mark in back.special])[::-1], rtol=1e-8)
    # Both halves of the symmetric orbit change at once.
    np.testing.assert_allclose(values[::2], values[1::2], rtol=1e-12)
    edges = [0.5, *values[::2], 0.2]
    for high, low in itertools.pairwise(edges):
        omega = 0.5 * (high + low)
        (orbit,) = there.at(omega)
        late = np.linspace(23.0, 24.0, 2001) * orbit.period
        settled = vf.simulate(damped(omega), late[-1], method="event_driven", times=[0.0, *late])
        assert orbit.result.frictions["pad"].stops.size == np.sum(settled.frictions["pad"].stops > late[0])
        reached = settled.displacement(settled.scene.bodies[0])[1:]
        assert orbit.amplitude(orbit.scene.bodies[0]) == pytest.approx(0.5 * np.ptp(reached), rel=1e-5)


def test_a_branch_ends_where_a_slider_with_static_friction_stops_while_it_slides() -> None:
    """It sticks for a time that is not short, so that the motion jumps; the note says so."""
    branch = vf.continuation(lambda omega: damped(omega, static=0.7), 0.5, 0.2)
    assert branch.values[-1] > 0.2
    assert "where static friction is larger than that of sliding, the motion jumps" in branch.notes[-1]


@pytest.mark.parametrize(
    ("name", "ends", "of", "kinds"),
    [
        ("omega", (1.2, 1.45), {"coefficient": 0.1, "damping": 0.02}, ["fold", "fold", "grazing"]),
        ("load", (0.3, 0.375), {"coefficient": 0.15, "damping": 0.05}, ["grazing"]),
    ],
)
def test_a_slider_stops_where_it_lets_its_mass_graze_a_contact(
    name: str, ends: tuple[float, float], of: dict[str, float], kinds: list[str]
) -> None:
    """The slider turns there, or sticks, so that the touch lasts before and after; both directions list the same."""

    def build(value: float) -> vf.Scene:
        given = {"omega": 0.4, "load": 0.3, **of, name: value}
        mass = vf.Mass(1.0, stiffness=1.0, damping=given["damping"], name="m")
        stop = vf.Contact(mass, gap=0.4, stiffness=5.0, side="above", acts_on="penetration", name="stop")
        slider = vf.Friction(mass, coefficient=given["coefficient"], normal=1.0, name="f")
        return vf.Scene([mass], [slider, stop, vf.PointLoad(mass, vf.Sine(given["load"], given["omega"]))])

    there, back = (vf.continuation(build, *way) for way in (ends, ends[::-1]))
    assert (there.values[-1], back.values[-1]) == ends[::-1]
    assert [mark.kind for mark in there.special] == [mark.kind for mark in reversed(back.special)] == kinds
    np.testing.assert_allclose([m.value for m in there.special], [m.value for m in back.special][::-1], rtol=1e-8)
    (grazing,) = (mark for mark in there.special if mark.kind == "grazing")
    touched = grazing.orbit
    assert touched.result.displacement(touched.scene.bodies[0]).max() == pytest.approx(0.4, rel=1e-4)
    assert touched.residual < 1e-9
    slider = touched.result.frictions["f"]
    assert (slider.breaks.size > 0) == (name == "load")


def joined(omega: float, limit: float, pull: float = 0.0) -> vf.Scene:
    """Return two masses, of which one lies on a rough floor while the other one is shaken and pulled."""
    a, b = vf.Mass(1.0, stiffness=1.5, damping=0.04, name="a"), vf.Mass(0.7, damping=0.05, name="b")
    effects = [vf.Spring(a, b, stiffness=1.2), vf.Friction(a, coefficient=1.0, normal=limit, name="floor")]
    return vf.Scene([a, b], [*effects, vf.PointLoad(b, vf.Sine(0.4, omega)), vf.PointLoad(b, pull)])


def test_a_branch_goes_from_sticking_all_along_to_sliding_and_back() -> None:
    """With a at rest, b is an oscillator of closed form; a slides where the spring's force exceeds the limit."""
    limit, ends = 0.8, (0.8, 2.0)
    there, back = (vf.continuation(lambda omega: joined(omega, limit), *way) for way in (ends, ends[::-1]))
    assert (there.values[-1], back.values[-1]) == ends[::-1]
    values = [[mark.value for mark in branch.special] for branch in (there, back)]
    np.testing.assert_allclose(values[0], values[1][::-1], rtol=1e-11)
    assert {mark.kind for mark in there.special} == {"sticking"}
    # |1.2 * 0.4 / (1.2 - 0.7 w^2 + 0.05 i w)| is the limit.
    roots = np.roots([0.49, 0.0, 0.05**2 - 2.0 * 1.2 * 0.7, 0.0, 1.2**2 - (1.2 * 0.4 / limit) ** 2])
    slides = np.sort(roots[roots.real > 0.0].real)
    # It slides to and fro, from two points of the orbit on.
    np.testing.assert_allclose(values[0][:2], slides[0], rtol=1e-11)
    np.testing.assert_allclose(values[0][-2:], slides[1], rtol=1e-11)
    inside = [orbit.result.frictions["floor"].dissipated[-1] > 0.0 for orbit in (there.at(0.9)[0], there.at(1.3)[0])]
    assert inside == [False, True]
    assert there.at(0.9)[0].stable


def test_sliders_that_stick_all_along_stay_where_they_are_and_rest_in_the_middle_on_branches() -> None:
    """A constant pull shifts the middle, where forces are alike; multipliers are those about the place."""
    pull = 0.3
    scene = joined(0.8, 0.9, pull)
    settled = vf.simulate(scene, 60.0).displacement(scene.bodies[0])[-1]
    np.testing.assert_allclose(vf.periodic(scene).result.displacement(scene.bodies[0]), settled, rtol=1e-11)
    rest = np.linalg.solve([[2.7, -1.2], [-1.2, 1.2]], [0.0, pull])
    orbit = vf.continuation(lambda omega: joined(omega, 0.9, pull), 0.8, 0.79).orbits[0]
    a, b = orbit.scene.bodies
    np.testing.assert_allclose(orbit.result.displacement(a), rest[0], rtol=1e-11)
    assert orbit.result.displacement(b).mean() == pytest.approx(rest[1], rel=1e-2)
    force = orbit.result.frictions["floor"].force
    assert force.max() == pytest.approx(-force.min(), rel=1e-4)
    period = 2.0 * np.pi / 0.8
    decay, ring = 0.5 * 0.05 / 0.7, np.sqrt(1.2 / 0.7 - (0.5 * 0.05 / 0.7) ** 2)
    np.testing.assert_allclose(np.sort(np.abs(orbit.multipliers))[2:], np.exp(-decay * period), rtol=1e-10)
    largest = orbit.multipliers[np.argmax(np.abs(orbit.multipliers))]
    assert largest.real == pytest.approx(np.exp(-decay * period) * np.cos(ring * period), rel=1e-9)


@pytest.mark.parametrize("ends", [(1.1, 0.94), (0.94, 1.1)])
@pytest.mark.parametrize("of", ["load", "limit", "pulled"])
def test_a_mass_comes_to_rest_and_begins_to_slide(of: str, ends: tuple[float, float]) -> None:
    """Where its slider sticks nothing moves; it slides where the load exceeds the limit, in the middle of its play."""

    def build(value: float) -> vf.Scene:
        load, limit = (1.0, value) if of == "limit" else (value, 1.0)
        mass = vf.Mass(1.0, stiffness=1.0, damping=0.05, name="mass")
        pad = vf.Friction(mass, coefficient=limit, normal=1.0, name="pad")
        pull = vf.PointLoad(mass, 0.3 if of == "pulled" else 0.0)
        return vf.Scene([mass], [pad, vf.PointLoad(mass, vf.Sine(load, 0.6)), pull])

    branch = vf.continuation(build, *ends)
    assert branch.values[-1] == ends[1]
    np.testing.assert_allclose([mark.value for mark in branch.special], [1.0, 1.0], rtol=1e-9)
    still = branch.orbits[-1 if (of == "limit") == (ends[1] > 1.0) else 0]
    place = 0.3 if of == "pulled" else 0.0
    np.testing.assert_allclose(still.result.displacement(still.scene.bodies[0]), place, atol=1e-12)


def test_a_slider_at_the_edge_of_its_play_sticks() -> None:
    """The motion from rest pushes it there for ever, in one direction; an orbit does not come back from that."""
    orbit = vf.periodic(joined(0.8, 1.005 * 0.6373968, 0.3))
    slider = orbit.result.frictions["floor"]
    assert slider.dissipated[-1] == 0.0
    assert np.abs(slider.force).max() == pytest.approx(slider.force.max())
    period = 2.0 * np.pi / 0.8
    assert np.abs(orbit.multipliers).max() == pytest.approx(np.exp(-0.5 * 0.05 / 0.7 * period), rel=1e-9)


def test_a_branch_keeps_the_place_of_a_slider_that_no_spring_pulls_back() -> None:
    mass = vf.Mass(1.0, name="mass")
    floor = vf.Friction(mass, coefficient=0.5, normal=1.0, name="floor")

    def build(load: float) -> vf.Scene:
        return vf.Scene([mass], [floor, vf.PointLoad(mass, vf.Sine(load, 1.0))], {mass: (0.2, 0.0)})

    orbits = vf.continuation(build, 0.3, 0.4, guess=vf.simulate(build(0.3), 2.0 * np.pi)).orbits
    for orbit in (orbits[0], orbits[-1]):
        np.testing.assert_allclose(orbit.result.displacement(mass), 0.2, rtol=1e-12)


def test_branches_pass_sticking_all_along_beside_a_stop() -> None:
    """The motion is not symmetric, so that the middle moves; begins and ends of sliding come in pairs there too."""
    a, b = vf.Mass(1.0, stiffness=1.0, damping=0.05, name="a"), vf.Mass(1.0, stiffness=0.5, damping=0.05, name="b")
    stop = vf.Contact(b, gap=0.05, stiffness=5.0, side="above", acts_on="penetration", name="stop")
    effects = [vf.Spring(a, b, stiffness=1.0), vf.Friction(a, coefficient=0.8, normal=1.0, name="floor"), stop]

    def build(omega: float) -> vf.Scene:
        return vf.Scene([a, b], [*effects, vf.PointLoad(b, vf.Sine(0.6, omega))])

    there, back = (vf.continuation(build, *way) for way in ((0.6, 0.797), (0.797, 0.6)))
    assert (there.values[-1], back.values[-1]) == (0.797, 0.6)
    found = [(mark.kind, mark.value) for mark in there.special]
    assert [kind for kind, _ in found] == [mark.kind for mark in back.special][::-1]
    np.testing.assert_allclose([v for _, v in found], [mark.value for mark in back.special][::-1], rtol=1e-10)
    slides = [value for kind, value in found if kind == "sticking"]
    np.testing.assert_allclose(slides[::2], slides[1::2], rtol=1e-10)
    assert len(slides) == 4
    # Orbits with the slider at the place that it has there turn, and those in the middle do not.
    turn = there.special[-1]
    assert turn.kind == "branch_point"
    with pytest.raises(vf.ConvergenceError, match="'floor' sticks all along: orbits with the slider at this place"):
        there.switch(turn)


def two_dampers(
    places: tuple[float, float], limits: tuple[float, float], loaded: float, mean: float | None = None
) -> Any:
    """Return a function of the load's angular frequency: a cantilever with two friction dampers."""

    def build(omega: float) -> vf.Scene:
        beam = vf.Beam(1.0, EI=1.0, rhoA=1.0, elements=4, supports={"left": "clamped"}, name="beam")
        dampers = [
            vf.Friction(beam.at(x), coefficient=1.0, normal=limit, name=f"damper at {x}")
            for x, limit in zip(places, limits, strict=True)
        ]
        sine = vf.Sine(1.0, omega)
        load = vf.PointLoad(beam.at(loaded), sine if mean is None else sine + vf.Constant(mean))
        return vf.Scene([beam], [*dampers, vf.RayleighDamping(0.1, 0.003), load])

    return build


@pytest.mark.parametrize(
    ("limits", "loaded", "ends", "count"),
    [((0.15, 0.25), 0.75, (3.0, 3.06), 4), ((0.19, 0.104), 0.5, (2.95, 3.1), 2)],
)
def test_two_friction_dampers_of_a_beam(limits, loaded, ends, count) -> None:
    """One breaks away just as the other one stops; one stops where it turns, at both of its turns at once."""
    build = two_dampers((1.0, 0.5), limits, loaded)
    there, back = (vf.continuation(build, *way) for way in (ends, ends[::-1]))
    assert (there.values[-1], back.values[-1]) == ends[::-1]
    assert {mark.kind for mark in there.special} == {"sticking"}
    assert len(there.special) == count
    values = [[mark.value for mark in branch.special] for branch in (there, back)]
    np.testing.assert_allclose(values[0], values[1][::-1], rtol=1e-9)


def test_a_branch_passes_stops_that_are_too_short_to_be_told_apart() -> None:
    """The next orbit with the switches of an ordinary run is on the branch, not on the way back."""
    branch = vf.continuation(two_dampers((1.0, 0.5), (0.235, 0.249), 1.0, 0.21300792418853376), 2.778, 2.785)
    assert branch.values[-1] == 2.785
    assert np.all(np.diff(branch.values) > 0.0)
    (note,) = branch.notes
    found = re.match(r"between (\S+) and (\S+) sliders stop and slide for times that", note)
    assert found is not None
    begin, end = map(float, found.groups())
    assert begin == pytest.approx(2.78166775, abs=1e-7)
    assert begin < end < 2.783


@pytest.mark.parametrize(
    ("places", "limits", "loaded", "ends", "count", "at_once"),
    [
        ((0.5, 0.75), (0.262, 0.241), 0.75, (3.1, 3.2), 0, True),
        ((1.0, 0.5), (0.203, 0.205), 0.5, (3.83, 3.85), 4, False),
        # The branch from above passes an orbit in which a force is at its limit within rounding.
        ((0.5, 0.25), (0.071, 0.259), 1.0, (3.27, 3.31), 0, True),
    ],
)
def test_a_slider_slides_beside_the_stop_of_another_one(places, limits, loaded, ends, count, at_once) -> None:
    """It is let go of at once over a range of frequencies, as the force of the other one jumps, or before the stop."""
    build = two_dampers(places, limits, loaded)
    there, back = (vf.continuation(build, *way) for way in (ends, ends[::-1]))
    assert (there.values[-1], back.values[-1]) == ends[::-1]
    assert not (*there.notes, *back.notes)
    assert all(orbit.residual < 1e-8 for orbit in there.orbits)
    values = [[mark.value for mark in branch.special] for branch in (there, back)]
    np.testing.assert_allclose(values[0], values[1][::-1], rtol=1e-9)
    assert len(values[0]) == count
    # Both sliders of some orbits switch at one time: one stops or turns, and the other one begins to slide. In special
    # orbits a force is at its limit within rounding.
    together = [
        any(
            np.any(np.abs(one.breaks[:, None] - other.stops) <= 1e-12)
            for one, other in itertools.permutations(orbit.result.frictions.values(), 2)
        )
        for value, orbit in zip(there.values, there.orbits, strict=True)
        if np.all(np.abs(value - np.array(values[0])) > 1e-9)
    ]
    assert any(together) == at_once


def test_a_beam_with_a_friction_damper_is_followed_through_all_its_states() -> None:
    """The tip sticks, slides and sticks again; both directions list the same points."""
    beam = vf.Beam(1.0, EI=1.0, rhoA=1.0, elements=1, supports={"left": "clamped"}, name="beam")
    effects = [vf.Friction(beam.at(1.0), coefficient=1.0, normal=2.0, name="damper"), vf.ModalDamping(0.02)]

    def build(omega: float) -> vf.Scene:
        return vf.Scene([beam], [*effects, vf.PointLoad(beam.at(0.5), vf.Sine(2.0, omega))])

    there, back = (vf.continuation(build, *way) for way in ((12.0, 28.0), (28.0, 12.0)))
    assert (there.values[-1], back.values[-1]) == (28.0, 12.0)
    values = [[mark.value for mark in branch.special] for branch in (there, back)]
    np.testing.assert_allclose(values[0], values[1][::-1], rtol=1e-10)
    assert len(values[0]) == 4
    inside = [orbit for value in (13.0, 20.0, 27.0) for orbit in there.at(value)]
    assert [orbit.result.frictions["damper"].dissipated[-1] > 0.0 for orbit in inside] == [False, True, False]


def test_what_orbits_cannot_have_is_refused_by_name() -> None:
    """Belts, springs of sliders, rigid stops beside sliders, free oscillations and derivatives; each with a way on."""
    mass = vf.Mass(1.0, stiffness=1.0, name="mass")
    load = vf.PointLoad(mass, vf.Sine(3.0, 0.6))
    for pad, why in (
        (vf.Friction(mass, coefficient=0.5, normal=1.0, belt=0.1, name="pad"), "stands on a belt"),
        (vf.Friction(mass, coefficient=0.5, normal=1.0, stiffness=9.0, name="pad"), "has a stiffness"),
    ):
        with pytest.raises(vf.MethodError, match=rf"Friction 'pad' {why}.*until it has settled"):
            vf.periodic(vf.Scene([mass], [pad, load]), method="shooting")
    pad = vf.Friction(mass, coefficient=0.5, normal=1.0, name="pad")
    wall = vf.RigidStop(mass, gap=1.0, restitution=0.5, side="above", name="wall")
    with pytest.raises(vf.MethodError, match=r"Friction 'pad' acts beside RigidStop 'wall'"):
        vf.periodic(vf.Scene([mass], [pad, wall, load]), method="shooting")
    with pytest.raises(vf.MethodError, match="Friction 'pad'"):
        vf.lyapunov(vf.Scene([mass], [pad, load]), 10.0)
    with pytest.raises(vf.MethodError, match="Friction 'pad'"):
        vf.backbone(vf.Scene([mass], [pad]), 1, [1.0])
    orbit = vf.periodic(vf.Scene([mass], [pad, load]))
    with pytest.raises(vf.MethodError, match="Friction 'pad'"):
        vf.sensitivities(orbit, [vf.Parameter(mass, "stiffness")])


def test_a_changed_load_is_that_of_the_run() -> None:
    """Scenes that differ in a load share their modes, and not the load."""
    scene = oscillator(4.0, 0.6)
    load = scene.effects[1]
    vf.simulate(scene, 1.0, method="event_driven")
    changed = scene.replace(load, f=vf.Sine(2.0, 0.6, phase=0.5 * np.pi))
    same = oscillator(2.0, 0.6)
    for options in ({}, {"t_start": 1.3}):
        runs = [vf.simulate(one, 10.0, method="event_driven", **options) for one in (changed, same)]
        found = [one.displacement(one.scene.bodies[0])[-1] for one in runs]
        assert found[0] == pytest.approx(found[1], rel=1e-13)


def test_multipliers_do_not_depend_on_the_units() -> None:
    """Beside a short stop of a slider they were those of the rounding: 0.677 in micrometres, and 0.232 in metres."""
    found = []
    for length, time, mass in ((1.0, 1.0, 1.0), (1e-6, 1e-6, 1e-15)):
        stiffness, damping, force = mass / time**2, mass / time, mass * length / time**2
        a = vf.Mass(0.784 * mass, stiffness=0.605 * stiffness, name="a")
        b = vf.Mass(0.846 * mass, stiffness=1.44 * stiffness, name="b")
        stops = [
            vf.Contact(
                b, gap=gap * length, stiffness=k * stiffness, damping=0.3 * damping, side=side, acts_on="penetration"
            )
            for gap, k, side in ((0.118, 6.45, "below"), (0.371, 26.5, "above"))
        ]
        slider = vf.Friction(a, coefficient=0.203, normal=0.401 * force)
        load = vf.PointLoad(b, vf.Sine(1.137 * force, 0.3062 / time))
        orbit = vf.periodic(vf.Scene([a, b], [vf.Spring(a, b, stiffness=2.645 * stiffness), slider, *stops, load]))
        found.append(np.sort(np.abs(orbit.multipliers)))
        if length == 1.0:
            found.append(np.sort(np.abs(of_runs(orbit.scene, orbit, 1e-6))))
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=0.0, atol=1e-7)


def of_runs(scene: vf.Scene, orbit: vf.PeriodicOrbit, step: float) -> np.ndarray:
    """Return multipliers by central differences of runs over one period."""
    names, period = [body.name for body in scene.bodies], orbit.period
    start = np.concatenate([[float(orbit.state_of(name)[k][0]) for name in names] for k in (0, 1)])

    def end(change: np.ndarray) -> np.ndarray:
        q, v = np.split(start + change, 2)
        begin = {body: (q[i], v[i]) for i, body in enumerate(scene.bodies)}
        run = vf.simulate(scene, period, times=[0.0, period], initial=begin, method="event_driven")
        return np.array([f(body)[-1] for f in (run.displacement, run.velocity) for body in scene.bodies])

    return np.linalg.eigvals(np.stack([(end(d) - end(-d)) / (2.0 * step) for d in step * np.eye(start.size)], axis=1))


def test_a_slider_begins_to_stop_at_the_same_value_in_other_units() -> None:
    """Rounding of reactions was told from displacements and velocities together, and in microseconds hid this point."""
    values, omega = ((1.736553, 0.768898, 0.259231, "a"), (0.809564, 0.600369, 0.0, "b")), 0.3422102
    found = []
    for time in (1.0, 2.0**-20):
        k, c = time**-2, 1.0 / time
        a, b = (vf.Mass(m, stiffness=s * k, damping=d * c, name=n) for m, s, d, n in values)
        effects = [
            vf.Spring(a, b, stiffness=1.5304649 * k),
            vf.Friction(b, a, coefficient=0.312931, normal=0.323811 * k, name="pad"),
            vf.Contact(a, gap=0.207825, stiffness=26.9259 * k, side="below", acts_on="penetration", name="stop"),
        ]

        def build(share: float, c: float = c, k: float = k, b: vf.Mass = b, rest: Any = (a, b, effects)) -> vf.Scene:
            load = vf.PointLoad(b, vf.Sine(0.504015 * k, omega * share * c, phase=2.0776))
            return vf.Scene(rest[:2], [*rest[2], load])

        branch = vf.continuation(build, 1.0214, 1.0218)
        assert not any("told apart" in note for note in branch.notes)
        found.append([mark.value for mark in branch.special])
        assert [mark.kind for mark in branch.special] == ["sticking"]
    assert found[1] == pytest.approx(found[0], rel=1e-10)


@pytest.mark.parametrize("status", [3, 4])
def test_a_slider_that_does_not_move_at_the_start_of_an_orbit_sticks_there(status: int) -> None:
    """It was said to slide until it stopped at once; equations of its branch were inf, and so were multipliers."""
    from vofem.studies.steady.segments.signature import signature_of

    block = vf.Mass(1.0, stiffness=1.0, name="block")
    pad = vf.Friction(block, coefficient=0.5, normal=2.0, name="pad")
    known: Any = vf.periodic(vf.Scene([block], [pad, vf.PointLoad(block, vf.Sine(1.6, 0.6))])).source.motion()
    chart, problem = known.chart, known.problem
    assert chart.statuses[1] == [2]
    phase = float(chart.phases(known.y)[0]) + 0.3 * float(chart.lengths(known.y)[1])
    new, y = signature_of(problem, problem.run(chart.at_phase(problem, known, phase), phase, [status]))
    assert new.start == (2,)
    assert [switch.status for switch in new.switches] == [4, 2, 3, 2]
    assert new.lengths(y)[0] == pytest.approx(0.7 * float(chart.lengths(known.y)[1]), rel=1e-6)
