"""Diagrams over many scenes, against orbits found by shooting and known multistability."""

import time
from dataclasses import replace

import numpy as np
import pytest
from orbit_scenes import nlvib_03
from scenes import on_stop

import vofem as vf
from vofem.io.plot import basin_map, bifurcation, state_map, sweep_curves

#: NLvib's example 03 between its grazing at 0.6534 and its fold at 0.7556: the linear and the impacting motion coexist.
VALUES = [0.63, 0.67, 0.7]


#: The masses of NLvib's example 03, by which points are found.
FIRST, SECOND = vf.Mass(1.0, name="a"), vf.Mass(1.0, 1.0, 0.03, name="b")


def oscillator(omega, gap):
    return on_stop(vf.Mass(1.0, 1.0, 0.1, name="m"), load=vf.Sine(1.0, omega), gap=gap, stiffness=8.0)[1]


def transient(omega):
    """No steady state: the load is not periodic."""
    return on_stop(vf.Mass(1.0, 1.0, 0.1, name="m"), load=vf.Pulse(1.0, 0.5, 0.1 * omega), gap=0.1, stiffness=8.0)[1]


@pytest.fixture(scope="module")
def diagram():
    return vf.bifurcation_diagram(nlvib_03, VALUES, periods=4, skip=220, executor="serial")


def linear(omega):
    """Return displacement and velocity of the first mass without a stop, where the load's sine is 0 and rising."""
    M, C, K = np.eye(2), 0.03 * np.array([[1, -1], [-1, 2]]), np.array([[1.0, -1.0], [-1.0, 2.0]])
    response = np.linalg.solve(K + 1j * omega * C - omega**2 * M, [0.0, 0.1])
    return response[0].real, (1j * omega * response[0]).real


def test_rising_values_follow_the_impacting_motion_and_falling_ones_the_linear_motion(diagram):
    assert diagram.order("up", 1e-4).tolist() == [1, 1, 1]
    expected = [linear(omega)[0] for omega in VALUES[1:]]
    assert diagram.displacement(start="down")[1:, -1] == pytest.approx(expected, rel=1e-4)
    assert np.all(diagram.displacement(start="up")[1:, -1] > 0.8)
    # Below the grazing there is one motion only.
    assert diagram.displacement(start="down")[0, -1] == pytest.approx(diagram.displacement(start="up")[0, -1], abs=1e-4)


def test_samples_are_those_of_the_orbit_that_shooting_finds(diagram):
    orbit = vf.periodic(nlvib_03(VALUES[0]))
    u, v = (call(FIRST, [0.0])[0] for call in (orbit.result.displacement, orbit.result.velocity))
    assert diagram.displacement(start="up")[0, -1] == pytest.approx(u, abs=1e-4)
    assert diagram.velocity(FIRST, start="up")[0, -1] == pytest.approx(v, abs=1e-4)


def test_the_diagram_says_what_it_holds(diagram):
    assert repr(diagram).startswith("<BifurcationDiagram: 3 values x 4 periods; starts rest, up, down; points a")
    with pytest.raises(vf.ArgumentError, match="no point is named 'third'"):
        diagram.displacement("third")
    with pytest.raises(vf.ArgumentError, match="start is 'left'"):
        diagram.displacement(start="left")


def test_a_store_gives_the_same_diagram_without_computing(tmp_path, monkeypatch):
    store = tmp_path / "diagram.h5"
    arguments = {"periods": 2, "skip": 3, "executor": "serial", "points": SECOND}
    values = np.linspace(0.5, 0.62, 12)
    first = vf.bifurcation_diagram(nlvib_03, values, store=store, **arguments)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["diagram-follow.h5", "diagram-rest.h5"]

    def refuse(*_, **__):
        raise AssertionError("computed again")

    monkeypatch.setattr("vofem.studies.diagrams.bifurcation.simulate", refuse)
    again = vf.bifurcation_diagram(nlvib_03, values, store=store, **arguments)
    for start in ("rest", "up", "down"):
        assert again.displacement(start=start).tobytes() == first.displacement(start=start).tobytes()
    assert first.points == ("b",)
    assert np.all(np.isfinite(first.samples["down"]))


def test_runs_that_fail_leave_the_others_alone():
    def build(omega):
        return {0.7: lambda: None, 0.8: lambda: oscillator(1.0 / 0, 0.1)}.get(omega, lambda: oscillator(omega, 0.1))()

    found = vf.bifurcation_diagram(build, [0.6, 0.7, 0.8, 0.9], periods=2, skip=3, executor="serial")
    for samples in found.samples.values():
        assert np.isnan(samples[0, 0, :, 0]).tolist() == [False, True, True, False]
    assert len(found.failed) == 6
    assert sum("scene is None, expected a vofem.Scene" in message for message in found.failed) == 3


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"values": []}, "values has shape"),
        ({"values": [0.5, float("nan")]}, "values holds nan"),
        ({"periods": 0}, "periods is 0"),
        ({"skip": -1}, "skip is -1"),
        ({"follow": "no"}, "follow is 'no', expected True or False"),
        ({"build": transient}, "every run failed, the first with"),
    ],
)
def test_arguments_that_cannot_serve_are_refused(arguments, message):
    given = {"build": nlvib_03, "values": [0.6], "executor": "serial"} | arguments
    with pytest.raises(vf.ArgumentError, match=message):
        vf.bifurcation_diagram(**given)


def test_a_limit_of_time_is_that_of_one_value_and_a_lost_series_is_told():
    """The limit was that of a whole series of values, and a series that was lost ended all in an error."""

    def slow(omega):
        time.sleep(0.1)
        return oscillator(omega, 0.2)

    kept = {"periods": 2, "skip": 1, "executor": "serial"}
    assert vf.bifurcation_diagram(slow, np.linspace(0.7, 0.8, 6), time_limit=0.5, **kept).failed == ()
    calls = []

    def ends(omega):
        calls.append(omega)
        if len(calls) == 3:  # of rising values
            raise SystemExit("no licence")
        return oscillator(omega, 0.2)

    found = vf.bifurcation_diagram(ends, [0.7, 0.8], **kept)
    assert found.failed == ("up: SystemExit: no licence",)
    assert np.all(np.isnan(found.displacement(start="up")))
    assert np.all(np.isfinite(found.displacement(start="down")))


def test_one_sample_tells_of_no_repetition():
    kept = {"periods": 1, "skip": 3, "executor": "serial"}
    with pytest.raises(vf.ArgumentError, match="periods is 1, expected"):
        vf.basins(oscillator(0.8, 0.2), {"displacement": [0.0], "velocity": [0.0]}, **kept)
    with pytest.raises(vf.ArgumentError, match="periods of the diagram is 1, expected"):
        vf.bifurcation_diagram(nlvib_03, [0.6], follow=False, **kept).order()


def test_basins_tell_attractors_apart():
    found = vf.basins(
        nlvib_03(0.68), {"q1": [-2.0, -1.0, 0.0, 0.9]}, start=lambda q1: {FIRST: (q1, 0.0), SECOND: (0.0, 0.0)},
        tolerance=1e-3, executor="serial",
    )  # fmt: skip
    assert [one.order for one in found.attractors] == [1, 1]
    assert sorted(one.name for one in found.attractors) == ["period 1 (a)", "period 1 (b)"]
    points = sorted(one.points[0, 0, 0] for one in found.attractors)
    assert points[0] == pytest.approx(linear(0.68)[0], rel=1e-3)
    assert points[1] > 0.8
    assert sum(one.share for one in found.attractors) == pytest.approx(1.0)
    assert found.index.shape == (4,)
    assert set(found.index) == {0, 1}
    assert "period 1 (a)" in repr(found)


def test_basins_of_one_body_need_no_start_and_others_do():
    found = vf.basins(
        oscillator(0.8, 0.2), {"displacement": [0.0, 1.0], "velocity": [-1.0, 0.0]}, skip=60,
        executor="serial",
    )  # fmt: skip
    assert found.index.tolist() == [[0, 0], [0, 0]]
    assert found.attractors[0].name == "period 1"
    with pytest.raises(vf.ArgumentError, match="give start="):
        vf.basins(nlvib_03(0.6), {"q1": [0.0]}, executor="serial")


def test_a_map_of_stability_holds_the_orbits_of_periodic():
    found = vf.stability_map(oscillator, [0.5, 1.2], [0.0, 0.2], executor="serial")
    orbit = vf.periodic(oscillator(1.2, 0.2))
    assert found.stable.tolist() == [[1.0, 1.0], [1.0, 1.0]]
    assert found.multiplier[1, 1] == orbit.multipliers[0]
    assert found.amplitude[1, 1] == orbit.amplitude(orbit.scene.contacts[0].points()[0])
    assert "2 x 2 points; 100 % stable; 0 failed" in repr(found)
    with pytest.raises(vf.ArgumentError, match="no orbit was found at any point"):
        vf.stability_map(lambda x, y: transient(x), [1.0], [1.0], executor="serial")


def test_a_map_of_steady_states_hatches_the_unstable_cells(tmp_path):
    found = vf.stability_map(oscillator, [0.5, 1.2], [0.0, 0.2], executor="serial")
    assert state_map(found, tmp_path / "map.svg", quantity="multiplier", labels=("w [rad/s]", "f [N]")).exists()
    axes = state_map(replace(found, stable=np.array([[1.0, 1.0], [0.0, 1.0]])))
    (cell,) = axes.collections[-1].get_paths()
    assert cell.get_extents().bounds == pytest.approx((0.85, -0.1, 0.7, 0.2))
    assert len(state_map(found).collections) == len(axes.collections) - 1
    with pytest.raises(vf.ArgumentError, match="quantity"):
        state_map(found, tmp_path / "map.svg", quantity="phase")


def test_maps_show_values_in_any_order_and_rows_alone():
    def cells(axes):
        mesh = axes.collections[0]
        return mesh.get_coordinates()[0, :, 0].tolist(), mesh.get_coordinates()[:, 0, 1].tolist(), mesh.get_array()

    x, y, values = cells(
        sweep_curves(vf.sweep(lambda a, b: {"c": a + b}, {"a": [3.0, 1.0], "b": [0.5]}, executor="serial"))
    )
    assert (x, y, values.tolist()) == ([0.0, 2.0, 4.0], pytest.approx([0.475, 0.525]), [[1.5, 3.5]])
    found = vf.stability_map(oscillator, [1.2, 0.5], [0.2, 0.0], executor="serial")
    x, y, values = cells(state_map(found))
    assert (x, y) == (pytest.approx([0.15, 0.85, 1.55]), pytest.approx([-0.1, 0.1, 0.3]))
    np.testing.assert_array_equal(values, found.amplitude.T[::-1, ::-1])
    basins = vf.basins(
        oscillator(0.8, 0.2), {"displacement": [1.0, 0.0], "velocity": [0.0]}, skip=60, executor="serial"
    )
    x, y, values = cells(basin_map(basins))
    assert (x, y, values.tolist()) == ([-0.5, 0.5, 1.5], [-0.5, 0.5], [[0, 0]])


def test_a_diagram_does_not_call_orbits_unstable_whose_stability_is_not_decided():
    """The law of this spring has a memory, so that harmonic balance tells no multipliers."""

    def build(omega):
        mass = vf.Mass(1.0, 1.0, 0.1, name="m")
        return vf.Scene(
            [mass],
            [
                vf.BilinearSpring(mass, stiffness=1.0, linear_limit=0.2, hardening=0.1),
                vf.PointLoad(mass, vf.Sine(0.5, omega)),
            ],
        )

    branch = vf.continuation(build, 0.8, 0.81, harmonics=3)
    diagram = vf.bifurcation_diagram(build, [0.8, 0.81], points="m", executor="serial")
    assert diagram.points == ("m",)
    names = bifurcation(diagram, branches=[branch]).get_legend_handles_labels()[1]
    assert "stability not decided" in names
    assert not {"stable", "unstable"} & set(names)


def test_a_motion_that_is_sampled_at_its_turns_repeats():
    """At resonance velocities are zero whenever a sample is taken; what is left of them is rounding."""

    def build(load):
        mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="mass")
        stop = vf.Contact(mass, gap=9.0, stiffness=1.0, acts_on="penetration", side="above", name="stop")
        return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(load, 1.0))])

    diagram = vf.bifurcation_diagram(build, [0.3, 0.5], executor="serial")
    assert diagram.order().tolist() == [1, 1]
    np.testing.assert_allclose(diagram.period, 2.0 * np.pi, rtol=1e-15)
    (attractor,) = vf.basins(build(0.5), {"displacement": [0.0, 1.0], "velocity": [0.0]}, executor="serial").attractors
    assert (attractor.name, attractor.share) == ("period 1", 1.0)
