"""Derivatives of periodic orbits and special points, against an exact propagation in 300 bits (`data/README.md`)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vofem as vf
from vofem import Parameter, sensitivities

DATA: dict[str, Any] = json.loads((Path(__file__).parent / "data" / "derivatives" / "C1.json").read_text())
ORBITS = [(group, k) for group in ("P2", "P1") for k in range(len(DATA[group]["orbits"]))]


PARAMETERS = {
    "om": Parameter("load", "f.omega"), "gap": Parameter("stop", "gap"), "K0": Parameter("stop", "stiffness"),
    "d": Parameter("m", "damping"), "F": Parameter("load", "f.amplitude"),
}  # fmt: skip


def scene_of(p: dict[str, float], omega: float) -> vf.Scene:
    mass = vf.Mass(1.0, stiffness=1.0, damping=p["d"], name="m")
    stop = vf.Contact(mass, gap=p["gap"], stiffness=p["K0"], side="above", acts_on="penetration", name="stop")
    return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(p["F"], omega), name="load")])


def off(found: Any, right: Any) -> float:
    """Return the error relative to the largest entry."""
    return float(np.max(np.abs(np.asarray(found) - right)) / np.max(np.abs(right)))


@pytest.mark.parametrize(("group", "k"), ORBITS)
def test_orbits_have_the_derivatives_of_the_exact_propagation(group: str, k: int) -> None:
    data = DATA[group]["orbits"][k]
    scene = scene_of(data["point"], data["point"]["om"])
    mass = scene.bodies[0]
    rows = np.array(data["jacobian"])
    parts = np.array(data["multiplier_derivatives"])
    moved, values = parts[..., 0] + 1j * parts[..., 1], np.array([complex(*pair) for pair in data["multipliers"]])
    # One reference orbit over two periods of the load is an orbit over one period, taken twice.
    twice = (len(data["events"]) == 8 and data["k"] == 2) or data["point"]["om"] == 0.9
    periods = 1 if twice else data["k"]
    guess: Any = {mass: tuple(data["values"][:2])}
    orbit = vf.periodic(scene, periods=periods, guess=guess, method="shooting")
    d = sensitivities(orbit, [PARAMETERS[name] for name in data["parameters"]])
    least, largest = d.extremes(mass)
    found = [d.displacement(mass, [0.0])[0], d.velocity(mass, [0.0])[0], largest, least, *d.event_times]
    if twice:
        found += [row + d.period for row in d.event_times]
    known = orbit.multipliers
    assert known is not None
    multipliers = d.multipliers
    if twice:
        multipliers, known = 2.0 * known[:, None] * multipliers, known**2
    assert len(found) == len(rows)
    for mine, right in zip(found, rows, strict=True):
        assert off(mine, right) < 1e-11
    order = [int(np.argmin(np.abs(values - value))) for value in known]
    assert off(multipliers, moved[order]) < 1e-11
    assert np.allclose(d.amplitude(mass), 0.5 * (largest - least))
    # All lengths and loads times a factor: the orbit is multiplied, and its stability stays.
    names = data["parameters"]
    scaled = data["point"]["gap"] * largest[names.index("gap")] + data["point"]["F"] * largest[names.index("F")]
    assert scaled == pytest.approx(orbit.extremes(mass)[1], abs=1e-9)


@pytest.mark.parametrize(
    ("group", "numbers", "span"),
    [
        ("P2", (0, 1, 2, 3), (0.93, 1.14)),
        ("P1", (0,), (0.65, 0.66)),
        ("P1", (1, 2), (0.86, 1.01)),
        ("P1", (3,), (2.33, 2.35)),
    ],
)
def test_special_points_move_as_in_the_exact_propagation(
    group: str, numbers: tuple[int, ...], span: tuple[float, float]
) -> None:
    every = DATA[group]["special"]
    point = every[numbers[0]]["point"]
    first: Any = None
    if group == "P1":
        # Several motions are stable there; the branch is that of the special point.
        start = scene_of(point, span[0])
        first = vf.periodic(start, guess={start.bodies[0]: tuple(every[numbers[0]]["x"])}, method="shooting")
    branch = vf.continuation(
        lambda omega: scene_of(point, omega), *span, guess=first, method="shooting", max_seconds=60.0
    )
    kinds = {"fold": "fold", "graze": "grazing", "pd": "period_doubling"}
    names = ("gap", "K0", "d", "F")
    for number in numbers:
        data = every[number]
        special = next(one for one in branch.special if abs(one.value - data["om"]) < 1e-9)
        assert special.kind == kinds[data["kind"]]
        d = sensitivities(special, [PARAMETERS[name] for name in names])
        assert off(d.value, np.array([data["d_om"][name] for name in names])) < 1e-11
        along = sensitivities(special, [PARAMETERS[name] for name in names], along=PARAMETERS["om"])
        assert np.array_equal(along.value, d.value)


def test_a_grazing_at_which_a_closed_contact_nearly_opens_moves_with_the_loads_and_the_stop() -> None:
    """The gap of the grazing is in proportion to both loads together; by the stiffness a difference of two branches."""

    def build(gap: float, stiffness: float = 8.0) -> vf.Scene:
        a = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="a")
        b = vf.Mass(1.2, stiffness=0.8, damping=0.07, name="b")
        stop = vf.Contact(a, gap=gap, stiffness=stiffness, damping=0.2, side="above", acts_on="penetration",
                          name="stop")  # fmt: skip
        loads = [vf.PointLoad(a, vf.Sine(1.0, 0.9), name="p"), vf.PointLoad(a, vf.Sine(0.3, 2.7), name="q")]
        return vf.Scene([a, b], [vf.Spring(a, b, stiffness=1.0), stop, *loads])

    def grazing(stiffness: float) -> vf.SpecialPoint:
        branch = vf.continuation(lambda gap: build(gap, stiffness), -0.3, -0.37)
        (found,) = (mark for mark in branch.special if mark.kind == "grazing")
        return found

    mark = grazing(8.0)
    names = [Parameter("p", "f.amplitude"), Parameter("q", "f.amplitude"), Parameter("stop", "stiffness")]
    by_loads = sensitivities(mark, names, along=Parameter("stop", "gap")).value
    assert by_loads[0] + 0.3 * by_loads[1] == pytest.approx(mark.value, rel=1e-9)
    slope = (grazing(8.01).value - grazing(7.99).value) / 0.02
    assert by_loads[2] == pytest.approx(slope, rel=1e-5)


def test_a_beam_with_modal_damping_has_the_multipliers_of_differences() -> None:
    def scene(stiffness: float, rho: float, gap: float) -> vf.Scene:
        beam = vf.Beam(1.0, EI=10.0, rhoA=rho, elements=2, supports={"left": "clamped"}, name="beam")
        stop = vf.Contact(beam.at(1.0), gap=gap, stiffness=stiffness, damping=2.0, side="below", acts_on="displacement",
                          name="stop")  # fmt: skip
        load = vf.PointLoad(beam.at(1.0), vf.Sine(3.0, 9.0), name="load")
        return vf.Scene([beam], [stop, load, vf.ModalDamping(0.1)])

    def orbit(*numbers: float, guess: Any = None) -> vf.PeriodicOrbit:
        return vf.periodic(scene(*numbers), guess=guess, method="shooting")

    base = (60.0, 1.0, 0.08)
    first = orbit(*base)
    assert first.result.counters.events > 0
    parameters = [Parameter("stop", "stiffness"), Parameter("beam", "rhoA"), Parameter("stop", "gap")]
    d = sensitivities(first, parameters)
    tip = first.scene.bodies[0].at(1.0)  # type: ignore[attr-defined]
    assert first.multipliers is not None
    for k, value in enumerate(base):
        h = 1e-4 * value
        ends = []
        for sign in (1.0, -1.0):
            numbers = list(base)
            numbers[k] += sign * h
            ends.append(orbit(*numbers, guess=first))
        slope = (ends[0].amplitude(tip) - ends[1].amplitude(tip)) / (2.0 * h)
        assert d.amplitude(tip)[k] == pytest.approx(slope, rel=1e-5)
        values = [one.multipliers[0] for one in ends]  # type: ignore[index]
        values = [value if value.imag * first.multipliers[0].imag >= 0.0 else value.conjugate() for value in values]
        assert d.multipliers[0, k] == pytest.approx((values[0] - values[1]) / (2.0 * h), rel=1e-4)


@pytest.mark.parametrize("hits", [False, True])
def test_an_orbit_with_a_pinned_contact_has_the_multipliers_of_differences(hits: bool) -> None:
    """A mass that is pressed against a beam stays at its gap; in the second case the tip hits a stop meanwhile."""

    def scene(mass: float = 0.4, x: float = 0.4, rho: float = 1.0, stiffness: float = 200.0) -> vf.Scene:
        beam = vf.Beam(1.0, EI=10.0, rhoA=rho, elements=2, supports={"left": "clamped"}, name="beam")
        ball = vf.Mass(mass, stiffness=30.0, damping=0.6, name="ball")
        effects = [
            vf.Contact(beam.at(x), ball, gap=0.02, stiffness=6000.0, damping=1.0, acts_on="displacement", name="pin"),
            vf.Contact(beam.at(1.0), gap=0.3 if hits else 9.0, stiffness=stiffness, damping=0.5, side="below",
                       acts_on="penetration", name="stop"),
            vf.PointLoad(ball, -20.0), vf.PointLoad(beam.at(1.0), vf.Sine(3.0, 9.0), name="load"),
            vf.RayleighDamping(0.8, 1e-4),
        ]  # fmt: skip
        return vf.Scene([beam, ball], effects, initial={ball: (-0.02, 0.0)})

    base = {"mass": 0.4, "x": 0.4, "rho": 1.0, "stiffness": 200.0}
    first = vf.periodic(scene(), guess=vf.simulate(scene(), 10.0, method="event_driven"), method="shooting")
    assert np.allclose(first.result.contacts["pin"].pinned, [[0.0, first.period]])
    assert (first.result.counters.events > 0) == hits
    names = {"mass": ("ball", "mass"), "x": ("pin", "a.x"), "rho": ("beam", "rhoA"), "stiffness": ("stop", "stiffness")}
    found = sensitivities(first, [Parameter(*place) for place in names.values()]).multipliers
    known = first.multipliers
    assert known is not None
    clear = np.abs(known) > 1e-4
    assert np.count_nonzero(clear) >= 4
    lost = np.argsort(np.abs(known))[:2]
    assert np.all(found[lost] == 0.0)

    def moved(name: str, step: float) -> np.ndarray:
        changed = scene(**{**base, name: base[name] + step})
        guess = vf.simulate(changed, 10.0, method="event_driven")
        values = vf.periodic(changed, guess=guess, method="shooting").multipliers
        assert values is not None
        return np.array([values[np.argmin(np.abs(values - one))] for one in known])

    for k, name in enumerate(base):
        if name not in (("x", "stiffness") if hits else ("mass", "x")):
            continue
        h = 2e-4 * base[name]
        one, two = ((moved(name, s) - moved(name, -s)) / (2.0 * s) for s in (h, 0.5 * h))
        expected = (4.0 * two - one) / 3.0
        assert off(found[clear, k], expected[clear]) < 2e-8


@pytest.mark.parametrize("gap", [0.0, 0.3])
def test_extremes_at_impacts_move_with_them(gap: float) -> None:
    """The largest displacement is the gap itself; the least one and the amplitude agree with differences."""

    def orbit(**changed: float) -> tuple[vf.Mass, vf.PeriodicOrbit]:
        of = {"gap": gap, "damping": 0.05, "restitution": 0.7, "omega": 2.0, **changed}
        mass = vf.Mass(1.0, stiffness=1.0, damping=of["damping"], name="a")
        stop = vf.RigidStop(mass, gap=of["gap"], restitution=of["restitution"], side="above", name="s")
        load = vf.PointLoad(mass, vf.Sine(1.0, of["omega"]), name="l")
        return mass, vf.periodic(vf.Scene([mass], [stop, load]))

    fields = [("s", "gap"), ("a", "damping"), ("s", "restitution"), ("l", "f.omega")]
    mass, found = orbit()
    derived = sensitivities(found, [Parameter(*one) for one in fields])
    least, largest = derived.extremes(mass)
    assert largest == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-10)
    values = {"gap": gap, "damping": 0.05, "restitution": 0.7, "omega": 2.0}
    for k, (name, value) in enumerate(values.items()):
        (_, high), (_, low) = orbit(**{name: value + 1e-5}), orbit(**{name: value - 1e-5})
        change = (np.array(high.extremes(mass)) - low.extremes(mass)) / 2e-5
        assert least[k] == pytest.approx(change[0], rel=1e-5)
        assert derived.amplitude(mass)[k] == pytest.approx(0.5 * (change[1] - change[0]), rel=1e-5)


@pytest.mark.parametrize("phase", [0.0, 4.5])
def test_the_highest_of_many_extremes_counts(phase: float) -> None:
    """Of ripples on a slow motion, many have nearly the same height, and samples of the orbit tell the wrong one."""

    def orbit(phase: float) -> vf.PeriodicOrbit:
        mass = vf.Mass(1.0, stiffness=10.0, damping=0.3, name="m")
        ripples = vf.PointLoad(mass, vf.Sine(800.0, 120.0, phase), name="ripples")
        return vf.periodic(vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, 1.0)), ripples]))

    found = sensitivities(orbit(phase), [Parameter("ripples", "f.phase")]).extremes("m")[:, 0]
    change = np.array(orbit(phase + 1e-5).extremes("m")) - orbit(phase - 1e-5).extremes("m")
    assert off(found, change / 2e-5) < 1e-5


def test_a_grazing_beside_impacts_of_the_same_rigid_stop() -> None:
    """At these impacts the gap is zero as well, and its rate changes its sign by a jump."""

    def grazing(gap: float) -> vf.SpecialPoint:
        def build(force: float) -> vf.Scene:
            mass = vf.Mass(1.0, stiffness=1.0, damping=0.15, name="m")
            stop = vf.RigidStop(mass, gap=gap, restitution=0.6, side="above", name="c")
            others = vf.Sine(0.6, 1.35) + vf.Sine(0.9, 2.25, 1.0)
            loads = [vf.PointLoad(mass, vf.Sine(force, 0.45), name="f"), vf.PointLoad(mass, others)]
            return vf.Scene([mass], [stop, *loads])

        (found,) = [point for point in vf.continuation(build, 0.33, 0.36).special if point.kind == "grazing"]
        return found

    point = grazing(0.4)
    assert len(point.orbit.result.contacts["c"].closings) > 2
    slope = sensitivities(point, [Parameter("c", "gap")], along=Parameter("f", "f.amplitude")).value[0]
    assert slope == pytest.approx((grazing(0.401).value - grazing(0.399).value) / 2e-3, rel=1e-4)


def test_derivatives_by_the_frequency_do_not_depend_on_the_unit_of_time() -> None:
    """Frequencies were changed by 1 rad/s, and extremes found to 1e-16 s, however fast the loads are."""
    found = []
    for time in (1.0, 2.0**-40):
        mass = vf.Mass(1.0, stiffness=time**-2, damping=0.1 / time, name="m")
        stop = vf.Contact(mass, gap=0.1, stiffness=8.0 * time**-2, side="above", acts_on="penetration", name="stop")
        loads = [vf.PointLoad(mass, vf.Sine(f * time**-2, 1.3 / time, phase=f), name=f"load {f}") for f in (1.0, 0.3)]
        orbit = vf.periodic(vf.Scene([mass], [stop, *loads]))
        derived = sensitivities(orbit, [Parameter("stop", "gap"), Parameter(loads, "f.omega")])
        found.append(derived.amplitude(mass) / [1.0, time])
        with pytest.raises(vf.ArgumentError, match="no longer have a common period"):
            sensitivities(orbit, [Parameter(loads[0], "f.omega")])
    np.testing.assert_allclose(found[1], found[0], rtol=1e-10)


def test_what_has_no_derivative_is_refused_by_name() -> None:
    data = DATA["P1"]["orbits"][1]
    scene = scene_of(data["point"], data["point"]["om"])
    orbit = vf.periodic(scene, guess={scene.bodies[0]: tuple(data["values"][:2])}, method="shooting")
    with pytest.raises(vf.ArgumentError, match="does not depend on an initial state"):
        sensitivities(orbit, [Parameter("m", "initial.velocity")])
    balanced = vf.periodic(scene, method="harmonic_balance", harmonics=5)
    with pytest.raises(vf.MethodError, match="method='shooting'"):
        sensitivities(balanced, [Parameter("m", "damping")])
    with pytest.raises(vf.ArgumentError, match=r"along=vofem\.Parameter"):
        sensitivities(vf.SpecialPoint("fold", 0.123, orbit), [Parameter("m", "damping")])
    with pytest.raises(vf.ArgumentError, match="does not persist"):
        sensitivities(vf.SpecialPoint("branch_point", orbit.omega, orbit), [Parameter("m", "damping")])


def test_a_motion_that_nothing_holds_leaves_the_derivatives_that_exist() -> None:
    """A driven mass with drag may drift anywhere: its amplitude F/(w |i w m + c|) does not know where it is."""
    mass, drag, force, omega = 1.5, 0.4, 0.3, 1.1
    free = vf.Mass(mass, damping=drag, name="free")
    beside = vf.Mass(2.0, name="beside")  # with no force at all
    load = vf.PointLoad(free, vf.Sine(force, omega, 0.5 * np.pi), name="load")
    orbit = vf.periodic(vf.Scene([free, beside], [load]))
    parameters = [vf.Parameter(free, "damping"), vf.Parameter(free, "mass"), vf.Parameter("load", "f.amplitude")]
    found = vf.sensitivities(orbit, parameters).amplitude(free)
    size = (omega * mass) ** 2 + drag**2
    amplitude = force / (omega * np.sqrt(size))
    right = [-amplitude * drag / size, -amplitude * omega**2 * mass / size, amplitude / force]
    np.testing.assert_allclose(found, right, rtol=1e-10)
    with pytest.raises(vf.ArgumentError, match=r"free\.stiffness: a motion that nothing holds"):
        vf.sensitivities(orbit, vf.Parameter(free, "stiffness"))
