"""Figures: axes that are given and returned, units on every axis, styles, windows, envelopes, spectra, impacts."""

import re

import matplotlib

matplotlib.use("Agg")

import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure
from orbit_scenes import impact_oscillator
from scenes import on_stop, paper_beam

import vofem as vf
from vofem.io import plot
from vofem.io.pictures import axes as look
from vofem.io.pictures.histories import envelope_of
from vofem.io.pictures.spectra import amplitudes, density


@pytest.fixture(scope="module")
def run():
    beam, scene = paper_beam("displacement", elements=4)
    return beam.at(1.0), vf.simulate(scene, 12.0)


@pytest.fixture(scope="module")
def orbit():
    scene = impact_oscillator(0.6)
    return scene.bodies[0], vf.periodic(scene)


def drawn(run, orbit):
    """Every function of `plot` with arguments that it takes, without a path, by its name."""
    point, result = run
    mass, steady = orbit
    section = vf.poincare(vf.simulate(steady.scene, 3.0 * steady.period, initial=steady), steady.period)
    serial = {"executor": "serial"}
    yield "time_history", plot.time_history(result, point)
    yield "time_history", plot.time_history(result, point, envelope=True)
    yield "shapes", plot.shapes(result, [1.0, 2.0])
    yield "space_time", plot.space_time(result)
    for kind in ("amplitude", "psd", "spectrogram"):
        yield "spectrum", plot.spectrum(result, point, kind=kind, quantity="velocity")
    yield "force_histogram", plot.force_histogram(result)
    yield "impact_statistics", plot.impact_statistics(result)
    yield "event_raster", plot.event_raster(result)
    yield "phase_portrait", plot.phase_portrait(steady, mass)
    yield "multipliers", plot.multipliers(steady)
    yield "multipliers", plot.multipliers([steady, steady])
    yield "poincare_section", plot.poincare_section(section, mass)
    for grid in ({"k": [1.0, 2.0]}, {"k": [1.0, 2.0], "d": [1.0, 2.0]}):
        swept = vf.sweep(lambda **point: {"x": 1.0}, grid, **serial)
        yield "sweep_curves", plot.sweep_curves(swept, units={"x": "m", "k": "N/m", "d": "m"})
    branch = vf.continuation(impact_oscillator, 0.6, 0.605, guess=steady)
    yield "response_curve", plot.response_curve(branch, branch.orbits[0].scene.bodies[0], parameter="omega [rad/s]")
    curve = vf.Locus(values=np.array([[0.6, 1.0], [0.7, 2.0]]), kind="fold", special=[], counters=branch.counters)
    yield "locus", plot.locus(curve, parameter="omega [rad/s]", other="amplitude [N]")
    diagram = vf.bifurcation_diagram(impact_oscillator, [0.6, 0.61], periods=2, skip=2, **serial)
    yield "bifurcation", plot.bifurcation(diagram, label="omega [rad/s]")
    free = vf.Mass(1.0, stiffness=1.0, name="m")
    stop = vf.Contact(free, gap=0.1, stiffness=1.0, side="above", acts_on="penetration", name="s")
    yield "backbone_curve", plot.backbone_curve(vf.backbone(vf.Scene([free], [stop]), 1, [0.02, 0.05]))
    basins = vf.basins(
        steady.scene, {"x": [0.0, 0.1], "v": [0.0, 0.1]}, start=lambda x, v: {mass: (x, v)}, periods=2, skip=2, **serial
    )
    yield "basin_map", plot.basin_map(basins, labels=("x [m]", "v [m/s]"))
    states = vf.stability_map(lambda x, y: impact_oscillator(x), [0.6, 0.61], [0.0], **serial)
    for quantity in ("amplitude", "multiplier"):
        yield "state_map", plot.state_map(states, quantity=quantity, labels=("omega [rad/s]", "y [m]"))
    scene = vf.Scene([free], [stop], {free: (0.0, 1.0)})
    study = vf.accuracy.work_precision(scene, 3.0, methods=["energy_conserving"], dt=[0.1], point=free, repeats=1)
    yield "work_precision", plot.work_precision(study)
    released = vf.Scene([free], [], {free: (0.1, 0.0)})
    start = vf.Parameter(free, "initial.displacement")
    yield "fit", plot.fit(vf.fit(released, [start], vf.Measured(free, [0.5, 1.0], [0.17, 0.1], noise=0.01)))


def labels(axes):
    """Labels of both axes of each panel; those of panels that share an axis stand at its last or first one."""
    for one in np.ravel(np.asarray(axes, dtype=object)):
        place = one.get_subplotspec()
        if place.is_last_row() or len(one.get_shared_x_axes().get_siblings(one)) == 1:
            yield one.get_xlabel()
        if place.is_first_col() or len(one.get_shared_y_axes().get_siblings(one)) == 1:
            yield one.get_ylabel()
    yield from (other.get_ylabel() for other in one.figure.axes if other.get_label() == "<colorbar>")


def test_every_axis_has_a_unit(run, orbit):
    names = set()
    for name, axes in drawn(run, orbit):
        names.add(name)
        for text in labels(axes):
            assert re.search(r"\[.+\]$", text), f"{name}: {text!r} has no unit"
        pyplot.close("all")
    assert names == set(plot.__all__)


def test_axes_are_taken_and_returned_and_files_are_still_written(run, tmp_path):
    point, result = run
    figure = Figure()
    upper, lower = figure.subplots(2)
    assert plot.time_history(result, point, ax=upper) is upper
    assert len(figure.axes) == 2
    assert not lower.lines
    found = plot.time_history(result, point, ax=[upper, lower])
    assert found[1] is lower
    assert lower.lines
    for name in ("a.png", "a.pdf", "a.svg"):
        assert plot.spectrum(result, point, tmp_path / name, ax=figure.add_subplot()) == tmp_path / name
        assert (tmp_path / name).stat().st_size > 1000
    # Without axes pyplot shows the figure, with a file it never hears of it.
    count = len(pyplot.get_fignums())
    plot.space_time(result, tmp_path / "b.png")
    assert len(pyplot.get_fignums()) == count
    axes = plot.space_time(result)
    assert pyplot.fignum_exists(axes.figure.number)


def test_wrong_axes_are_refused(run):
    point, result = run
    with pytest.raises(vf.ArgumentError, match="spectrum: ax is 3, expected matplotlib axes"):
        plot.spectrum(result, point, ax=3)
    with pytest.raises(vf.ArgumentError, match="4 matplotlib axes in a sequence"):
        plot.impact_statistics(result, ax=Figure().subplots())


def test_what_is_no_subject_of_a_picture_is_refused(run, orbit, tmp_path):
    point, result = run
    for draw, wrong, words in (
        (plot.time_history, 3, "time_history: result is 3, expected Result, or mapping of titles to Results"),
        (plot.time_history, result.scene, "expected Result, or mapping"),
        (plot.time_history, {}, "result is {}, expected Result"),
        (plot.time_history, {"one": 3}, "expected Result"),
        (plot.spectrum, [result], "spectrum: result is .* expected Result"),
        (plot.phase_portrait, [], "phase_portrait: orbit is .* expected PeriodicOrbit, or several of them"),
        (plot.phase_portrait, [orbit, result], "expected PeriodicOrbit, or several of them"),
        (plot.response_curve, orbit, "expected Branch, or several of them"),
        (plot.poincare_section, orbit, "expected PoincareSection"),
    ):
        with pytest.raises(vf.ArgumentError, match=words):
            draw(wrong, point, tmp_path / "a.png")
    for draw in (plot.force_histogram, plot.event_raster, plot.fit, plot.sweep_curves, plot.basin_map):
        with pytest.raises(vf.ArgumentError, match=f"{draw.__name__}: .* is 3, expected "):
            draw(3, path=tmp_path / "a.png")
    with pytest.raises(vf.ArgumentError, match=r"shapes: times has shape \(0,\), expected one or more numbers"):
        plot.shapes(result, [], tmp_path / "a.png")
    with pytest.raises(vf.ArgumentError, match="no contact is named '3'"):
        plot.time_history(result, point, tmp_path / "a.png", contact=3)
    with pytest.raises(vf.ArgumentError, match="bins is 1000000000000, expected a whole number from 1 to 100000"):
        plot.impact_statistics(result, path=tmp_path / "a.png", bins=10**12)
    assert not list(tmp_path.iterdir())


def test_style_sheets_restyle_figures(run):
    point, result = run
    plain = plot.time_history(result, point, ax=None)[0]
    assert plain.lines[0].get_color() == look.INK
    with pyplot.style.context(["dark_background", {"lines.linewidth": 3.0, "axes.grid": False}]):
        dark = plot.time_history(result, point)[0]
        first = matplotlib.rcParams["axes.prop_cycle"].by_key()["color"][0]
    assert dark.lines[0].get_color() == first != look.INK
    assert dark.get_facecolor() == (0.0, 0.0, 0.0, 1.0)
    assert dark.lines[0].get_linewidth() == pytest.approx(2.0 * plain.lines[0].get_linewidth())
    assert dark.spines["top"].get_visible()
    assert not plain.spines["top"].get_visible()


def test_a_window_shows_that_part_alone(run):
    point, result = run
    axes = plot.time_history(result, point, window=(3.0, 5.0))[0]
    times = axes.lines[0].get_xdata()
    assert (times[0], times[-1]) == (3.0, 5.0)
    assert axes.get_xlim() == (3.0, 5.0)
    with pytest.raises(vf.ArgumentError, match="window"):
        plot.time_history(result, point, window=(3.0, 50.0))


def test_the_envelope_of_a_long_history_encloses_it():
    """A fast oscillation of slowly growing amplitude: the envelope is its amplitude."""
    times = np.linspace(0.0, 10.0, 100_001)
    middle, low, high = envelope_of(times, times * np.sin(400.0 * times), (0.0, 10.0), 400)
    assert middle.size == 400
    assert np.all(np.abs(high[40:] / middle[40:] - 1.0) < 0.02)
    assert np.all(np.abs(low[40:] / middle[40:] + 1.0) < 0.02)
    mass, scene = on_stop(vf.Mass(1.0, stiffness=1.0, name="m"), gap=0.5, stiffness=10.0, start=(0.0, 1.0))
    result = vf.simulate(scene, 2000.0)
    upper, lower = plot.time_history(result, mass)
    assert upper.collections
    assert lower.get_ylabel() == "closed share [-]"
    share = next(patch for patch in lower.patches if hasattr(patch, "get_data")).get_data().values
    assert share.mean() == pytest.approx(result.contacts["stop"].statistics().closed_share, rel=1e-9)
    upper, lower = plot.time_history(result, mass, window=(0.0, 30.0))
    assert not upper.collections
    assert "K_" in lower.get_ylabel()


def test_spectra_of_a_sum_of_sines():
    step, n = 1e-3, 20_000
    times = step * np.arange(n)
    values = 0.7 + 0.3 * np.sin(2.0 * np.pi * 50.0 * times) + 0.02 * np.cos(2.0 * np.pi * 120.0 * times)
    frequency, height = amplitudes(values, step)
    peak = {f: height[np.argmin(np.abs(frequency - f))] for f in (50.0, 120.0)}
    assert peak[50.0] == pytest.approx(0.3, rel=1e-9)
    assert peak[120.0] == pytest.approx(0.02, rel=1e-9)
    assert height[np.abs(frequency - 85.0) < 20.0].max() < 1e-12
    # White noise of variance 4, and the sine: the integral of the density is the variance.
    noise = 2.0 * np.random.default_rng(1).standard_normal(200_000)
    frequency, power = density(noise, step)
    assert np.sum(power) * frequency[1] == pytest.approx(np.var(noise), rel=0.01)
    assert power[5:-5].mean() == pytest.approx(4.0 * 2.0 * step, rel=0.01)


@pytest.mark.parametrize("kind", ["amplitude", "psd", "spectrogram"])
def test_the_spectrum_of_a_run_at_rest_is_drawn(kind, tmp_path):
    mass = vf.Mass(1.0, 1.0)
    assert plot.spectrum(vf.simulate(vf.Scene([mass]), 1.0), mass, tmp_path / "a.png", kind=kind).exists()


def test_impacts_are_counted_in_whole_numbers_and_none_is_left_out_silently():
    ball = vf.Mass(1.0, name="ball")
    floor = vf.RigidStop(ball, gap=0.0, restitution=0.8, side="below", name="floor")
    result = vf.simulate(vf.Scene([ball], [vf.Gravity(9.81), floor], initial={ball: (0.5, 0.0)}), 3.0)
    axes = np.ravel(plot.impact_statistics(result))
    count = result.contacts["floor"].impacts.closing.size
    assert [one.get_xlabel() for one in axes[:2]] == [f"peak force of 1 of {count} impacts [N]", "impulse [N s]"]
    assert all(float(tick).is_integer() for one in axes for tick in one.get_yticks())


def test_labels_are_texts(orbit):
    mass, steady = orbit
    diagram = vf.bifurcation_diagram(impact_oscillator, [0.6], periods=1, skip=1, executor="serial")
    branch = vf.continuation(impact_oscillator, 0.6, 0.605, guess=steady)
    for label in (None, 3, ["m"]):
        for draw in (
            lambda label: plot.bifurcation(diagram, label=label),
            lambda label: plot.response_curve(branch, mass, parameter=label),
        ):
            with pytest.raises(vf.ArgumentError, match=r"a label of a picture is .*, expected a text"):
                draw(label)
    # One branch needs no list around it, and two labels are no text of two letters.
    drawn = [len(plot.bifurcation(diagram, branches=given).lines) for given in (branch, [branch], ())]
    assert drawn[0] == drawn[1] > drawn[2]
    states = vf.stability_map(lambda x, y: impact_oscillator(x), [0.6], [0.0], executor="serial")
    swept = vf.sweep(lambda x: {"y": x}, {"x": [1.0]}, executor="serial")
    for draw, message in (
        (lambda: plot.bifurcation(diagram, branches=[steady]), "branches is .* expected a Branch"),
        (lambda: plot.bifurcation(diagram, ylim=1.0), r"ylim has shape \(\), expected \(2,\)"),
        (lambda: plot.state_map(states, labels="xy"), "state_map: labels is 'xy', expected two texts"),
        (lambda: plot.sweep_curves(swept, units="m"), "units is 'm', expected a dict"),
        (lambda: plot.sweep_curves(swept, names=3), "3"),
    ):
        with pytest.raises(vf.ArgumentError, match=message):
            draw()


def test_the_spectrum_of_a_run_has_its_frequency():
    mass = vf.Mass(1.0, stiffness=(2.0 * np.pi * 3.0) ** 2, name="m")
    result = vf.simulate(vf.Scene([mass], initial={mass: (0.01, 0.0)}), 20.0)
    line = plot.spectrum(result, mass, limit=10.0).lines[0]
    frequency, height = line.get_data()
    assert frequency[np.argmax(height)] == pytest.approx(3.0)
    assert height.max() == pytest.approx(0.01, rel=1e-6)
    # Without a limit it ends where nothing more is seen, and not at the highest frequency of 32 768 samples, 819 Hz.
    for kind in ("amplitude", "psd", "spectrogram"):
        axes = plot.spectrum(result, mass, kind=kind)
        assert 3.0 < (axes.get_ylim() if kind == "spectrogram" else axes.get_xlim())[1] < 100.0
    few = vf.simulate(result.scene, 20.0, method="energy_conserving", dt=1e-2, times=np.linspace(0.0, 20.0, 5))
    with pytest.raises(vf.ArgumentError, match="stored 5 times"):
        plot.spectrum(few, mass)


def test_histograms_count_what_there_is(run):
    _, result = run
    axes = plot.force_histogram(result)
    assert sum(patch.get_height() for patch in axes.patches) == pytest.approx(1.0)
    panels = plot.impact_statistics(result)
    count = len(result.contacts["stop"].impacts)
    for axes in panels.flat:
        assert sum(patch.get_height() for patch in axes.patches) == count
    bars = plot.event_raster(result).collections[0].get_paths()
    assert len(bars) == count
    with pytest.raises(vf.ArgumentError, match="does not close"):
        plot.impact_statistics(result, window=(0.0, 0.5))
