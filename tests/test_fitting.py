"""Fits of numbers of a scene, against maximum-likelihood solutions of an independent program (`data/README.md`)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vofem as vf

DATA = Path(__file__).parent / "data" / "derivatives"


def case(name: str) -> tuple[dict[str, Any], Any]:
    return json.loads((DATA / f"{name}.json").read_text()), np.load(DATA / f"{name}.npz")


def scene_of(p: dict[str, float]) -> vf.Scene:
    mass = vf.Mass(p["m"], stiffness=p["k"], damping=p["d"], name="m")
    stop = vf.Contact(mass, gap=p["gap"], stiffness=p["K0"], damping=p["c"], side="above", acts_on="penetration",
                      name="stop")  # fmt: skip
    load = vf.PointLoad(mass, vf.Sine(p["F"], p["om"], phase=p["ph"]))
    return vf.Scene([mass], [stop, load], initial={mass: (p["u0"], p["v0"])})


def test_gap_stiffness_and_damper_are_the_maximum_likelihood_solution() -> None:
    data, arrays = case("E1")
    best = data["solutions"][0]
    scene = scene_of({**data["true"], **best["start"]})
    parameters = [vf.Parameter("stop", field) for field in ("gap", "stiffness", "damping")]
    fit = vf.fit(scene, parameters, vf.Measured(scene.bodies[0], arrays["times"], arrays["data"], data["sigma"]))
    expected = np.array([best["estimate"][name] for name in ("gap", "K0", "c")])
    assert np.allclose(fit.values, expected, rtol=1e-9)
    assert fit.chi2 == pytest.approx(best["chi2"], rel=1e-12)
    assert np.allclose(fit.covariance, best["cov"], rtol=1e-6)
    assert fit.not_identifiable == []
    assert fit.runs <= 15
    assert "stop.gap" in fit.report()
    run = vf.simulate(fit.scene, 3.0, times=arrays["times"])
    assert np.allclose(run.displacement(scene.bodies[0]) - arrays["data"], fit.residuals, atol=1e-15)


def test_windows_that_grow_find_the_global_one_of_five_minima() -> None:
    data, arrays = case("E3")
    best = data["solutions"][0]
    measured = None
    found = {}
    for horizon in (None, "grow"):
        scene = scene_of({**data["true"], "gap": 0.0095})
        measured = vf.Measured(scene.bodies[0], arrays["times"], arrays["data"], data["sigma"])
        found[horizon] = vf.fit(scene, vf.Parameter("stop", "gap"), measured, horizon=horizon)
    assert found["grow"].values[0] == pytest.approx(best["estimate"]["gap"], rel=1e-9)
    assert found["grow"].chi2 == pytest.approx(best["chi2"], rel=1e-9)
    assert found[None].chi2 > 1e3 * best["chi2"]
    assert [note.startswith("misfit: chi2 = ") for note in found[None].notes] == [True]
    assert found["grow"].notes == []


def test_numbers_on_which_the_data_do_not_depend_are_named() -> None:
    data, arrays = case("E5_not_identifiable")
    scene = scene_of(data["true"])
    parameters = [vf.Parameter("stop", "gap"), vf.Parameter("stop", "stiffness"), vf.Parameter("m", "mass")]
    fit = vf.fit(scene, parameters, vf.Measured(scene.bodies[0], arrays["times"], arrays["data"], data["sigma"]))
    assert fit.not_identifiable == ["stop.gap", "stop.stiffness"]
    assert fit.runs <= 8
    assert fit.values[:2].tolist() == [0.5, 900.0]
    assert fit.deviation[2] == pytest.approx(data["std_m"], rel=1e-3)
    assert np.all(np.isnan(fit.deviation[:2]))
    assert "not determined" in fit.report()


def test_noisy_data_are_explained_within_their_deviations() -> None:
    true = {"m": 1.0, "k": 40.0, "d": 0.3, "F": 2.0, "om": 5.2, "ph": 0.4, "gap": 0.02, "K0": 900.0, "c": 0.0,
            "u0": 0.0, "v0": 0.0}  # fmt: skip
    times = np.linspace(0.02, 1.0, 50)
    exact = scene_of(true)
    clean = vf.simulate(exact, 1.0, times=times, method="event_driven").displacement(exact.bodies[0])
    start = scene_of({**true, "gap": 0.021, "K0": 800.0})
    parameters = [vf.Parameter("stop", "gap"), vf.Parameter("stop", "stiffness")]
    within, runs = 0, 0
    for seed in range(12):
        data = clean + 2e-4 * np.random.default_rng(seed).standard_normal(times.size)
        fit = vf.fit(start, parameters, vf.Measured(start.bodies[0], times, data, 2e-4))
        within += bool(np.all(np.abs(fit.values - [0.02, 900.0]) < 3.0 * fit.deviation))
        runs = max(runs, fit.runs)
    assert within >= 11
    assert runs <= 15


def test_several_kinds_of_data_and_an_unknown_zero() -> None:
    beam = vf.Beam(1.0, EI=10.0, rhoA=1.0, elements=4, supports={"left": "clamped"}, name="beam")
    tip = beam.at(1.0)
    stop = vf.Contact(tip, gap=0.02, stiffness=2000.0, damping=1.0, side="below", acts_on="penetration", name="stop")
    load, damping = vf.PointLoad(tip, vf.Sine(2.0, 9.0)), vf.ModalDamping(0.02)
    true = vf.Scene([beam], [stop, load, damping])
    parameters = [
        vf.Parameter(beam, "EI"), vf.Parameter(beam, "rhoA"), vf.Parameter(stop, "gap"),
        vf.Parameter(load, "f.amplitude"), vf.Parameter(damping, "ratio"),
    ]  # fmt: skip
    times = np.linspace(0.01, 0.8, 60)
    run = vf.simulate(true, 0.8, times=times, method="event_driven")
    contact = run.contacts["stop"]
    data = [
        vf.Measured(tip, times, run.displacement(tip) + 0.003, 1e-5, offset=True),
        vf.Measured(beam.at(0.6), times, run.velocity(beam.at(0.6)), 1e-4, quantity="velocity"),
        vf.Measured(beam.at(0.6), times, run.acceleration(beam.at(0.6)), 1e-2, quantity="acceleration"),
        vf.MeasuredEvents(stop, contact.closings, contact.openings, 1e-5),
        vf.MeasuredFrequencies(vf.modes(true, 3).frequencies, 1e-2),
        vf.MeasuredStatics(tip, [0.1, 0.2], [vf.equilibrium(true, t).displacement(tip) for t in (0.1, 0.2)], 1e-5),
    ]
    values = np.array([parameter.value(true) for parameter in parameters])
    start = true
    for parameter, value, factor in zip(parameters, values, (1.02, 0.97, 1.03, 0.98, 1.1), strict=True):
        start = parameter.carried(true, start).at(start, value * factor)
    mine = [parameter.carried(true, start) for parameter in parameters]
    fit = vf.fit(start, mine, data)
    assert np.allclose(fit.values, values, rtol=1e-7)
    assert fit.offsets[0] == pytest.approx(0.003, rel=1e-6)
    assert fit.chi2 < 1e-8
    assert pytest.approx(10.0, rel=1e-7) == fit.scene.bodies[0].EI


def test_a_zero_that_is_far_off_does_not_mislead() -> None:
    true, times = (0.018, 230.0), np.linspace(0.02, 4.0, 60)
    exact, start = driven(*true), driven(0.0175, 240.0)
    motion = vf.simulate(exact, 4.0, times=times, method="event_driven").displacement(exact.bodies[0])
    parameters = [vf.Parameter("stop", "gap"), vf.Parameter("stop", "stiffness"), vf.Parameter("m", "damping")]
    fit = vf.fit(start, parameters, vf.Measured(start.bodies[0], times, motion + 1.0, 1e-4, offset=True))
    assert np.allclose(fit.values, [*true, 0.1], rtol=1e-8)
    assert fit.offsets[0] == pytest.approx(1.0, rel=1e-9)


def test_several_starts_find_the_best_minimum_and_say_where_each_one_ended() -> None:
    data, arrays = case("E3")
    scene = scene_of({**data["true"], "gap": 0.0095})
    gap = vf.Parameter("stop", "gap", bounds=(0.011, 0.015))
    measured = vf.Measured(scene.bodies[0], arrays["times"][:30], arrays["data"][:30], data["sigma"])
    with pytest.raises(vf.ArgumentError, match="outside of its bounds"):
        vf.fit(scene, gap, measured)
    scene = scene_of({**data["true"], "gap": 0.0148})
    fit = vf.fit(scene, gap, measured, starts=3)
    assert len(fit.starts) == 3
    assert fit.chi2 == min(start.chi2 for start in fit.starts)
    assert fit.values[0] == pytest.approx(data["solutions"][0]["estimate"]["gap"], abs=2e-5)


def test_a_picture_of_a_fit(tmp_path: Path) -> None:
    from vofem.io import plot

    data, arrays = case("E5_not_identifiable")
    scene = scene_of(data["true"])
    measured = vf.Measured(scene.bodies[0], arrays["times"], arrays["data"], data["sigma"])
    fit = vf.fit(scene, vf.Parameter("m", "mass"), measured)
    assert plot.fit(fit, tmp_path / "fit.png").stat().st_size > 10_000


def test_a_fit_from_a_file_is_the_same(tmp_path: Path) -> None:
    data, arrays = case("E5_not_identifiable")
    scene = scene_of(data["true"])
    mass = scene.bodies[0]
    parameters = [vf.Parameter("stop", "gap"), vf.Parameter(mass, "mass", bounds=(0.1, None))]
    measured = vf.Measured(mass, arrays["times"], arrays["data"] + 0.1, data["sigma"], offset=True)
    end = 0.5 * arrays["times"][-1]
    fit = vf.fit(scene, parameters, measured, horizon=end, starts=2)
    path = fit.save(tmp_path / "fit.h5")
    loaded = vf.load(path)
    assert isinstance(loaded, vf.Fit)
    for name in ("values", "offsets", "covariance", "deviation", "residuals"):
        assert np.array_equal(getattr(loaded, name), getattr(fit, name), equal_nan=True), name
    for name in ("not_identifiable", "notes", "chi2", "until", "runs"):
        assert getattr(loaded, name) == getattr(fit, name), name
    assert loaded.report() == fit.report()
    assert "not identifiable: the data do not determine stop.gap" in loaded.report()
    assert [one.values.tolist() for one in loaded.starts] == [one.values.tolist() for one in fit.starts]
    assert [one.bounds for one in loaded.parameters] == [(-np.inf, np.inf), (0.1, np.inf)]
    assert [one.value(loaded.scene) for one in loaded.parameters] == fit.values.tolist()
    runs = [vf.simulate(one.scene, end, method="event_driven") for one in (fit, loaded)]
    derivatives = [vf.sensitivities(run, one.parameters) for run, one in zip(runs, (fit, loaded), strict=True)]
    assert np.array_equal(runs[0].displacement(fit.scene.bodies[0]), runs[1].displacement(loaded.scene.bodies[0]))
    slopes = [d.displacement(one.scene.bodies[0]) for d, one in zip(derivatives, (fit, loaded), strict=True)]
    assert np.array_equal(*slopes)
    own = vf.load(path, scene=fit.scene)
    assert own.scene is fit.scene
    assert own.report() == fit.report()
    with pytest.raises(vf.ArgumentError, match="the scene is another one"):
        vf.load(path, scene=scene_of({**data["true"], "m": 7.0}))
    with pytest.raises(vf.OutputError, match="exists"):
        fit.save(path)
    loaded.save(path, overwrite=True)
    assert vf.load(path).report() == fit.report()
    with pytest.raises(vf.ArgumentError, match=r"make them again, as in vofem\.Measured"):
        vf.fit(loaded.scene, loaded.parameters, loaded.data)


def test_elements_and_all_kinds_of_data_are_in_files_of_fits(tmp_path: Path) -> None:
    from vofem.io import plot

    beam = vf.Beam(1.0, EI=10.0, rhoA=1.0, elements=4, supports={"left": "clamped"}, name="beam")
    loads = [vf.PointLoad(beam.at(1.0), 2.0), vf.PointLoad(beam.at(0.5), 1.0)]
    scene = vf.Scene([beam], loads)
    parameters = [vf.Parameter(beam, "EI", element=[0, 1]), vf.Parameter(loads[1], "f.value")]
    first = vf.equilibrium(scene, 0.0).displacement(beam.at(1.0))
    data = [
        vf.MeasuredStatics(beam.at(1.0), [0.0], [1.1 * first], 1e-5),
        vf.MeasuredFrequencies(1.02 * vf.modes(scene, 2).frequencies, 1e-3),
    ]
    fit = vf.fit(scene, parameters, data)
    loaded = vf.load(fit.save(tmp_path / "fit.h5"))
    assert loaded.parameters[0].elements == (0, 1)
    assert loaded.parameters[1].found(loaded.scene) == (loaded.scene.effects[1],)
    assert "PointLoad(beam@0.5).f.value" in loaded.report()
    assert loaded.scene.bodies[0].EI.tolist() == fit.scene.bodies[0].EI.tolist()
    assert [one.describe() for one in loaded.data] == [one.describe() for one in data]
    drawn = [plot.fit(one).flat for one in (fit, loaded)]
    lines = [[line.get_xydata().tolist() for ax in axes for line in ax.lines] for axes in drawn]
    assert lines[0] == lines[1]


def driven(gap: float, stiffness: float) -> vf.Scene:
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="m")
    stop = vf.Contact(mass, gap=gap, stiffness=stiffness, side="above", acts_on="penetration", name="stop")
    return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(0.15, 0.8), name="load")])


def test_amplitudes_over_frequency_are_fitted_on_all_sheets_of_a_branch() -> None:
    true, noise, rng = (1.0, 8.0), 1e-5, np.random.default_rng(11)
    branch = vf.continuation(
        lambda f: vf.Parameter("load", "f.omega").at(driven(*true), 2.0 * np.pi * f), 0.158, 0.183, method="shooting"
    )
    sheets = {f: branch.at(f) for f in (0.16, 1.09 / (2.0 * np.pi))}
    assert [len(several) for several in sheets.values()] == [1, 3]
    orbits = [(f, one) for f, several in sheets.items() for one in several]
    where = np.array([f for f, _ in orbits])
    amplitudes = np.array([one.amplitude(one.scene.bodies[0]) for _, one in orbits])
    amplitudes += noise * rng.standard_normal(where.size)
    start = driven(1.005, 8.1)
    parameters = [vf.Parameter("stop", "gap"), vf.Parameter("stop", "stiffness"), vf.Parameter("load", "f.omega")]
    fit = vf.fit(start, parameters, vf.MeasuredCurve(start.bodies[0], where, amplitudes, noise, span=(0.158, 0.183)))
    # The frequency is that of the data, so that the one of the scene plays no part.
    assert fit.not_identifiable == ["load.f.omega"]
    assert np.all(np.abs(fit.values[:2] - true) < 3.0 * fit.deviation[:2])
    assert fit.runs <= 8

    def amplitude(near: vf.PeriodicOrbit, f: float, numbers: np.ndarray) -> float:
        scene = vf.Parameter("load", "f.omega").at(driven(*numbers), 2.0 * np.pi * f)
        orbit = vf.periodic(scene, guess=near, method="shooting")
        return orbit.amplitude(orbit.scene.bodies[0])

    slopes = np.empty((where.size, 2))
    for k, step in enumerate(np.diag([1e-5, 1e-4])):
        for row, (f, near) in enumerate(orbits):
            ends = [amplitude(near, f, fit.values[:2] + sign * step) for sign in (1.0, -1.0)]
            slopes[row, k] = (ends[0] - ends[1]) / (2.0 * step[k])
    assert np.allclose(fit.covariance[:2, :2], np.linalg.inv(slopes.T @ slopes) * noise**2, rtol=1e-5)


@pytest.mark.parametrize("function", [
    2.0 * vf.Sine(0.1, 0.8), vf.Sine(0.05, 0.8) + 3.0 * vf.Sine(0.05, 0.8),
    0.5 * (vf.Sine(0.3, 0.8) + vf.Sine(0.1, 0.8)),
])  # fmt: skip
def test_sines_within_sums_and_multiples_have_the_measured_frequency(function) -> None:
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="m")
    scene = vf.Scene(
        [mass], [vf.PointLoad(mass, function, name="sum"), vf.PointLoad(mass, vf.Sine(0.1, 0.8), name="load")]
    )
    frequencies = np.array([0.1, 0.12])
    omega = 2.0 * np.pi * frequencies
    data = vf.MeasuredCurve(mass, frequencies, 0.3 / np.abs(1.0 - omega**2 + 0.1j * omega), 1.0)
    assert np.max(np.abs(vf.fit(scene, vf.Parameter("load", "f.omega"), data).residuals)) < 1e-6


def test_parameters_given_twice_and_data_at_the_start_alone_are_refused() -> None:
    start = driven(1.0, 8.0)
    body = start.bodies[0]
    data = vf.Measured(body, np.linspace(0.0, 1.0, 11), np.zeros(11), 0.1)
    with pytest.raises(vf.ArgumentError, match=r"holds stop\.gap more than once"):
        vf.fit(start, [vf.Parameter("stop", "gap"), vf.Parameter(start.effects[0], "gap")], data)
    beam = vf.Beam(1.0, EI=5.0, rhoA=1.0, elements=3, supports={"left": "clamped"}, name="beam")
    load = vf.PointLoad(beam.at(1.0), 1.0)
    for one, other in (
        (vf.Parameter(beam, "EI"), vf.Parameter(beam, "EI", element=1)),
        (vf.Parameter(load, "f"), vf.Parameter(load, "f.value")),
        (vf.Parameter(load, "x"), vf.Parameter(load, "point.x")),
    ):
        for pair in ([one, other], [other, one]):
            with pytest.raises(vf.ArgumentError, match="more than once, also within"):
                vf.fit(vf.Scene([beam], [load]), pair, vf.Measured(beam.at(1.0), [0.1, 0.2], [0.0, 0.0]))
    with pytest.raises(vf.ArgumentError, match="all data lie at t = 0"):
        vf.fit(start, vf.Parameter("stop", "gap"), vf.Measured(body, np.zeros(1), np.zeros(1), 0.1))


def test_data_that_are_numbers_are_refused_in_a_short_message() -> None:
    start = driven(1.0, 8.0)
    with pytest.raises(vf.ArgumentError, match=r"fit: data is an array of 500, expected what vofem\.Measured returns"):
        vf.fit(start, vf.Parameter("stop", "gap"), np.zeros(500))
    with pytest.raises(vf.ArgumentError, match="fit: data is empty, expected"):
        vf.fit(start, vf.Parameter("stop", "gap"), [])
    with pytest.raises(vf.ArgumentError, match=r"values is \['a', .*\.\.\.\], expected an array of numbers") as refused:
        vf.Measured(start.bodies[0], np.arange(500.0), ["a"] * 500)
    assert len(str(refused.value)) < 100


def test_sheets_that_are_meant_and_curves_that_are_refused() -> None:
    start, frequency = driven(1.0, 8.0), 1.09 / (2.0 * np.pi)
    mass, gap = start.bodies[0], vf.Parameter("stop", "gap")
    found = {}
    for sheet in ("upper", "lower"):
        # The first frequency lies before the folds; only the second one has several orbits.
        data = vf.MeasuredCurve(mass, [0.16, frequency], [0.0, 0.0], 1.0, sheet=sheet, span=(0.16, 0.183))
        found[sheet] = vf.fit(start, vf.Parameter("load", "f.omega"), data).residuals
    assert found["upper"][1] > 1.5 * found["lower"][1] > 0.0
    assert found["upper"][0] == pytest.approx(found["lower"][0], rel=1e-9)
    still = vf.Scene([mass], [start.effects[0], vf.PointLoad(mass, 1.0)])
    with pytest.raises(vf.ArgumentError, match="no load of the scene has a Sine"):
        vf.fit(still, gap, vf.MeasuredCurve(mass, [0.1, 0.2], [0.0, 0.0]))
    with pytest.raises(vf.ArgumentError, match="at least two of them different"):
        vf.MeasuredCurve(mass, [0.1], [1.0])
    with pytest.raises(vf.ArgumentError, match="with the data"):
        vf.MeasuredCurve(mass, [0.1, 0.2], [1.0, 1.0], span=(0.15, 0.3))
    with pytest.raises(vf.ArgumentError, match="sheet"):
        vf.MeasuredCurve(mass, [0.1, 0.2], [1.0, 1.0], sheet="top")


def test_wrong_data_are_refused() -> None:
    data, _ = case("E1")
    scene = scene_of(data["true"])
    mass = scene.bodies[0]
    with pytest.raises(vf.ArgumentError, match="increasing"):
        vf.Measured(mass, [1.0, 0.5], [0.0, 0.0])
    with pytest.raises(vf.ArgumentError, match="shape"):
        vf.Measured(mass, [1.0, 1.5], [0.0])
    with pytest.raises(vf.ArgumentError, match="positive"):
        vf.Measured(mass, [1.0], [0.0], [-1.0])
    with pytest.raises(vf.ArgumentError, match="increasing times of closings"):
        vf.MeasuredEvents("stop")
    measured = vf.Measured(mass, [0.1, 0.2], [0.0, 0.0])
    with pytest.raises(vf.ArgumentError, match="expected a time in s or 'grow'"):
        vf.fit(scene, vf.Parameter("stop", "gap"), measured, horizon="all")
    with pytest.raises(vf.ArgumentError, match=r"expected what vofem\.Measured"):
        vf.fit(scene, vf.Parameter("stop", "gap"), [1.0])
    with pytest.raises(vf.ArgumentError, match="give it for all of them"):
        vf.fit(scene, vf.Parameter("stop", "gap"), [measured, vf.Measured(mass, [0.3], [0.0], 1.0)])
    with pytest.raises(vf.ArgumentError, match="data are in Hz and m, and only their noise"):
        vf.fit(scene, vf.Parameter("stop", "gap"), [measured, vf.MeasuredFrequencies([1.0])])


def two_loads() -> tuple[vf.Scene, vf.Mass, list[vf.Parameter]]:
    mass = vf.Mass(2.0, stiffness=50.0, name="m")
    load = vf.PointLoad(mass, vf.Sine(1.0, 0.5) + vf.Constant(2.0))
    scene = vf.Scene([mass], [load])
    fields = ("f.terms.0.amplitude", "f.terms.1.value")
    return scene, mass, [*(vf.Parameter(load, field) for field in fields), vf.Parameter(mass, "stiffness")]


def test_unknown_noise_is_that_of_linear_regression() -> None:
    scene, mass, parameters = two_loads()
    times = np.linspace(0.3, 3.0, 6)
    columns = np.stack([np.sin(0.5 * times), np.ones(times.size)], axis=1) / 50.0
    data = columns @ [1.0, 2.0] + 1e-4 * np.random.default_rng(3).standard_normal(times.size)
    best, (rest,), _, _ = np.linalg.lstsq(columns, data)
    expected = np.linalg.inv(columns.T @ columns) * rest / (times.size - 2)
    # A zero of the instrument cannot be told from a constant force: both are lost, and one freedom, not two.
    for offset, known in ((False, [0, 1]), (True, [0])):
        fit = vf.fit(scene, parameters[:2], vf.MeasuredStatics(mass, times, data, offset=offset))
        assert np.allclose(fit.values[known], best[known], rtol=1e-8)
        assert np.allclose(fit.covariance[np.ix_(known, known)], expected[np.ix_(known, known)], rtol=1e-7)
        assert fit.not_identifiable == ([parameters[1].name] if offset else [])


def test_data_that_are_too_few_do_not_look_exact() -> None:
    scene, mass, parameters = two_loads()
    both = [vf.Parameter(mass, "mass"), parameters[2]]
    fit = vf.fit(scene, both, vf.MeasuredFrequencies([0.8], 1e-3))
    assert fit.not_identifiable == ["m.mass", "m.stiffness"]
    assert np.all(np.isnan(fit.covariance))
    fit = vf.fit(scene, both[1], vf.MeasuredFrequencies([0.8]))
    assert fit.values[0] == pytest.approx(2.0 * (2.0 * np.pi * 0.8) ** 2, rel=1e-9)
    assert np.isnan(fit.deviation[0])
    assert fit.not_identifiable == []
    assert "of unknown deviation" in fit.report()
    assert "1 data determine as many numbers" in fit.report()
    with pytest.raises(vf.ArgumentError, match=r"horizon is 0\.1 s, before the first of the data"):
        vf.fit(scene, both, vf.Measured(mass, [0.5, 1.0], [0.0, 0.0]), horizon=0.1)


def test_what_a_number_may_be_is_its_bound() -> None:
    mass = vf.Mass(1.0, stiffness=50.0, name="m")
    scenes = [vf.Scene([mass], [vf.RigidStop(mass, gap=0.01, restitution=e, side="above", name="stop")],
                       initial={mass: (0.0, 1.0)}) for e in (1.0, 0.98)]  # fmt: skip
    times = np.linspace(0.05, 1.0, 20)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(times.size)
    data = vf.simulate(scenes[0], 1.0, times=times, method="event_driven").displacement(mass) + noise
    fit = vf.fit(scenes[1], vf.Parameter("stop", "restitution"), vf.Measured(mass, times, data, 1e-3))
    assert fit.values[0] == pytest.approx(1.0, abs=1e-9)
    assert fit.notes == ["bound: stop.restitution lies at a bound, 1"]


@pytest.mark.parametrize(("true", "bounds"), [(-0.2, (0.0, 1.0)), (0.3, (None, 0.0))])
def test_a_value_at_a_bound_of_zero_is_told(true: float, bounds: tuple[float | None, float | None]) -> None:
    """It is some 1e-19 rad from the bound, which is no small share of itself."""
    mass, times = vf.Mass(1.0, stiffness=50.0, damping=0.4, name="m"), np.linspace(0.03, 3.0, 100)
    scenes = [vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, 6.0, phase=phase), name="load")])
              for phase in (true, -2.5 * true)]  # fmt: skip
    data = vf.simulate(scenes[0], 3.0, times=times, method="event_driven").displacement(mass)
    fit = vf.fit(scenes[1], vf.Parameter("load", "f.phase", bounds=bounds), vf.Measured(mass, times, data))
    assert fit.values[0] == pytest.approx(0.0, abs=1e-15)
    assert [note.partition(",")[0] for note in fit.notes] == ["bound: load.f.phase lies at a bound"]


def test_no_linked_number_and_no_place_leaves_its_range() -> None:
    masses = [vf.Mass(1.0, stiffness=k, name=name) for k, name in ((50.0, "a"), (10.0, "b"))]
    pushed = vf.Scene(masses, [vf.PointLoad(masses[0], 1.0)])
    beam = vf.Beam(1.0, EI=[5.0, 1.0], rhoA=1.0, elements=2, supports={"left": "clamped"}, name="beam")
    load = vf.PointLoad(beam.at(0.9), 1.0, name="load")
    bent, tip = vf.Scene([beam], [load]), beam.at(1.0)
    least = vf.Parameter(beam, "EI").at(bent, 4.001)
    below = vf.equilibrium(least, 0.0).displacement(least.bodies[0].at(1.0))
    for scene, parameter, point, value, expected in (
        (pushed, vf.Parameter(["a", "b"], "stiffness"), masses[0], 1.0 / 30.0, 40.0),
        (bent, vf.Parameter(load, "x"), tip, 2.0 * vf.equilibrium(bent, 0.0).displacement(tip), 1.0),
        (bent, vf.Parameter(beam, "EI"), tip, below, 4.001),
    ):
        fit = vf.fit(scene, parameter, vf.MeasuredStatics(point, [0.0], [value], 1e-3))
        assert fit.values[0] == pytest.approx(expected, rel=1e-6)
        assert fit.notes == ([f"bound: {parameter.name} lies at a bound, {expected:g}"] if expected != 4.001 else [])


def test_units_of_numbers_are_those_of_their_loads() -> None:
    beam = vf.Beam(1.0, 1.0, 1.0, 2, {"left": "clamped"})
    moment, line = (
        vf.PointMoment(beam.at(1.0), vf.Sine(1.0, 2.0)),
        vf.DistributedLoad(beam, 1.0, vf.Ramp(1.0, 0.0, 1.0)),
    )
    force = vf.PointLoad(beam.at(1.0), 2.0 * vf.Sine(1.0, 2.0))
    scene = vf.Scene([beam], [moment, line, force])
    cases = ((moment, "f.amplitude", "N m"), (moment, "f.omega", "rad/s"), (line, "f.slope", "1/s"), (line, "p", "N/m"),
             (force, "f.function.amplitude", "N"), (force, "f.factor", ""), (beam, "EI", "N m^2"))  # fmt: skip
    for target, field, unit in cases:
        assert vf.Parameter(target, field).unit(scene) == unit


def test_a_length_and_a_place_on_it_are_fitted_in_either_order() -> None:
    times, true, h = np.linspace(0.01, 0.3, 30), (1.01, 0.72), 1e-6

    def scene_of(length: float, x: float) -> vf.Scene:
        beam = vf.Beam(length, EI=70.0, rhoA=0.5, elements=3, supports={"left": "clamped"}, name="beam")
        stop = vf.Contact(beam.at(x), gap=0.002, stiffness=3e3, side="below", acts_on="penetration", name="stop")
        return vf.Scene([beam], [stop, vf.PointLoad(beam.at("right"), vf.Sine(4.0, 30.0))])

    def tip(length: float, x: float) -> np.ndarray:
        scene = scene_of(length, x)
        return vf.simulate(scene, 0.3, times=times, method="event_driven").displacement(scene.bodies[0].at("right"))

    slopes = np.array([tip(1.01 + h, 0.72) - tip(1.01 - h, 0.72), tip(1.01, 0.72 + h) - tip(1.01, 0.72 - h)]) / (2 * h)
    covariance = 1e-10 * np.linalg.inv(slopes @ slopes.T)
    scene = scene_of(1.0, 0.7)
    data = vf.Measured(scene.bodies[0].at("right"), times, tip(*true), 1e-5)
    parameters = [vf.Parameter("beam", "length"), vf.Parameter("stop", "x")]
    for order in ([0, 1], [1, 0]):
        fit = vf.fit(scene, [parameters[k] for k in order], data)
        assert np.allclose(fit.values, np.array(true)[order], rtol=1e-8)
        assert np.allclose(fit.values, [one.value(fit.scene) for one in fit.parameters], rtol=1e-14)
        assert np.allclose(fit.covariance, covariance[np.ix_(order, order)], rtol=1e-5)


def test_a_fit_to_motions_of_micrometres_does_not_end_before_the_one_to_motions_of_metres() -> None:
    """The gradient of the squares, in m^2, was compared with a number: estimates were off by 8 %, without a note."""
    size = 2.0**-20
    m = vf.Mass(1.0, stiffness=1.0, damping=0.24461574469981232, name="m")
    b = vf.Mass(0.5, stiffness=0.6, damping=0.2, name="b")
    stop = vf.RigidStop(m, gap=0.1437163567805589 * size, restitution=0.6, side="above", name="c")
    load = vf.PointLoad(b, vf.Sine(0.74098464797768 * size, 1.1))
    scene = vf.Scene([m, b], [vf.Spring(m, b, stiffness=1.0), stop, load])
    times = np.linspace(0.0, 8.0, 81)
    run = vf.simulate(scene, 8.0, times=times, method="event_driven")
    start = scene.replace("c", gap=1.05 * stop.gap, restitution=0.63)
    parameters = [vf.Parameter("c", "gap"), vf.Parameter("c", "restitution"), vf.Parameter("m", "damping")]
    found = vf.fit(start, parameters, vf.Measured(m, times, run.displacement(m)), horizon="grow")
    np.testing.assert_allclose(found.values, [stop.gap, 0.6, m.damping], rtol=1e-6)


@pytest.mark.parametrize("length", [2.0**-30, 2.0**20])
def test_the_stiffness_of_a_beam_is_found_in_any_unit_of_length(length: float) -> None:
    """The optimiser steps by shares of the unknowns: the bending stiffness of a nanotube is 1e-27 N m^2."""

    def beam(stiffness: float) -> vf.Beam:
        return vf.Beam(
            length, EI=stiffness * length**3, rhoA=1.0 / length, elements=3, supports={"left": "clamped"}, name="beam"
        )

    frequencies = vf.modes(vf.Scene([beam(2.0)])).frequencies[:3]
    found = vf.fit(vf.Scene([beam(1.5)]), [vf.Parameter("beam", "EI")], vf.MeasuredFrequencies(frequencies, 0.01))
    assert found.values[0] / length**3 == pytest.approx(2.0, rel=1e-9)


def test_a_step_of_one_number_is_not_small_because_another_one_is_large_in_its_unit() -> None:
    """SciPy compares the length of a step, here of N/m and N s/m together, with that of all unknowns: 74 % off."""
    times = np.linspace(0.01, 3.0, 300)

    def scene_of(damping: float) -> vf.Scene:
        a, b = vf.Mass(1e9, stiffness=1e12, name="a"), vf.Mass(1.0, stiffness=50.0, damping=damping, name="b")
        return vf.Scene([a, b], [vf.PointLoad(a, vf.Sine(1e9, 7.0)), vf.PointLoad(b, vf.Sine(1.0, 7.0))])

    run, start = vf.simulate(scene_of(0.1), 3.0, times=times, method="event_driven"), scene_of(0.3)
    parameters = [vf.Parameter("a", "stiffness"), vf.Parameter("b", "damping")]
    fit = vf.fit(start, parameters, [vf.Measured(one, times, run.displacement(one)) for one in start.bodies])
    np.testing.assert_allclose(fit.values, [1e12, 0.1], rtol=1e-9)


def test_a_gap_under_the_displacement_law_is_not_negative() -> None:
    mass = vf.Mass(1.0, name="m")
    stop = vf.Contact(mass, gap=1e-3, stiffness=10.0, side="above", acts_on="displacement", name="s")
    scene = vf.Scene([mass], [stop], initial={mass: (-0.01, 1.0)})
    fit = vf.fit(scene, vf.Parameter(stop, "gap"), vf.MeasuredEvents(stop, closings=[0.005, 4.0]))
    assert fit.values[0] == pytest.approx(0.0, abs=2e-9)
    assert any(note.startswith("bound: s.gap") for note in fit.notes)


def test_a_fit_ends_where_a_trial_depends_on_no_parameter() -> None:
    """Steps of no slope had no length: the trial had a gap that is no number."""
    mass = vf.Mass(1.0, stiffness=1.0, name="m")
    stop = vf.Contact(mass, gap=0.9, stiffness=10.0, side="above", acts_on="penetration", name="s")
    scene, times = vf.Scene([mass], [stop], initial={mass: (0.0, 1.0)}), np.linspace(0.1, 3.0, 30)
    fit = vf.fit(scene, vf.Parameter(stop, "gap"), vf.Measured(mass, times, 1.1 * np.sin(times), 1e-3))
    assert fit.values[0] > 1.0
    assert fit.not_identifiable == ["s.gap"]


def test_two_unnamed_loads_at_a_point_are_told_apart() -> None:
    mass, times = vf.Mass(1.0, stiffness=50.0, damping=0.4, name="m"), np.linspace(0.1, 5.0, 50)
    loads = vf.PointLoad(mass, vf.Sine(1.0, 3.0)), vf.PointLoad(mass, vf.Sine(0.0, 3.0))
    scene, parameters = vf.Scene([mass], loads), [vf.Parameter(load, "f.amplitude") for load in loads]
    run = vf.simulate(scene, 5.0, times=times, method="event_driven")
    names = ["PointLoad(m).f.amplitude (1)", "PointLoad(m).f.amplitude (2)"]
    found = vf.sensitivities(run, parameters)
    assert found.names == names
    assert found.to_dataframe(mass).shape == (50, 3)
    fit = vf.fit(scene, parameters, vf.Measured(mass, times, run.displacement(mass)))
    assert fit.not_identifiable == names


@pytest.mark.parametrize("start", [-5.0, 20.0])
def test_a_trial_that_buckles_is_answered_by_a_shorter_step(start: float) -> None:
    """The fit ended in its error: steps from other axial forces lead beyond the critical one, -9.87 N."""
    scenes = []
    for tension in (-9.5, start):
        beam = vf.Beam(1.0, 1.0, 1.0, 4, {"left": "pinned", "right": "pinned"}, tension=tension, name="beam")
        scenes.append(vf.Scene([beam], [vf.PointLoad(beam.at(0.5), 1.0)]))
    frequencies = vf.modes(scenes[0], 2).frequencies
    deflection = vf.equilibrium(scenes[0], 0.0).displacement(scenes[0].bodies[0].at(0.5))
    statics = vf.MeasuredStatics(scenes[1].bodies[0].at(0.5), [0.0], [deflection], 1e-6)
    for data in (vf.MeasuredFrequencies(frequencies, 1e-6), statics):
        fit = vf.fit(scenes[1], vf.Parameter("beam", "tension"), data)
        assert fit.values[0] == pytest.approx(-9.5, rel=1e-9)
