"""Every example runs, and a number that it prints is right."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import LAWS, reference
from scipy.optimize import brentq, curve_fit

import vofem as vf

EXAMPLES = Path(__file__).parent.parent / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def check_cantilever(example, result, printed):
    stop = result.contacts["stop"]
    assert stop.closings[0] == pytest.approx(3.8131224981, abs=1e-9)
    assert result.counters.events == 12
    assert "3.813122498" in printed
    assert "12 contact events" in printed


def check_two_masses(example, results, printed):
    """Displacements of both masses at all times, and the events, as in multi-precision arithmetic."""
    for (acts_on, case), result in results.items():
        data = reference(f"two_masses_{case}_{acts_on}")
        for body, key in zip(result.scene.bodies, ("w_xi1", "w_xi2"), strict=True):
            assert result.displacement(body, data["t"]) == pytest.approx(data[key], abs=1e-9)
        contact = result.contacts["contact"]
        assert contact.closings == pytest.approx(data["event_time"][data["event_is_closing"]], abs=1e-9)
        assert f"{data['w_xi1'][-1]:.9f}" in printed
    assert len(results) == 6


def check_beam_shapes(example, runs, printed):
    """Deflections of all nodes as in multi-precision arithmetic, and the integer-order model with both."""
    for acts_on in LAWS:
        data = reference(f"beam_shape_{acts_on}")
        reference_nodes = data["snap_X"][:50:2]
        exact, same, plain = runs[acts_on]
        nodes = np.linspace(0.0, 1.0, 26)[1:]
        assert exact.deflection(nodes, data["snap_t"]) == pytest.approx(reference_nodes, abs=1e-9)
        # Eq. 21 is of first order under the jump law.
        assert plain[1:] == pytest.approx(reference_nodes, abs=5e-6 if acts_on == "displacement" else 1e-7)
        assert same == pytest.approx(plain, abs=5e-9)
        assert f"{reference_nodes[-1, 1]:.9f}" in printed


def check_several_stops(example, result, printed):
    """The tip is struck, and the stops are met from there inwards; random scenes have an independent integration."""
    first = [result.contacts[name].closings[0] for name in ("far", "middle", "near", "upper")]
    assert first == sorted(first)
    assert all(f"{time:.9f}" in printed for time in first)
    assert "closed: near, middle, far" in printed
    assert result.energy.balance_error < 1e-12


def check_one_sided_foundation(example, outcome, printed):
    """Contact over pi/(2 lambda) on each side, w0 = (P lambda/2k) coth(pi/2)."""
    rows, result = outcome
    exact = 0.125 / np.tanh(np.pi / 2)
    assert f"{exact:.9f}" in printed
    for elements, half, w0 in rows:
        h = 12.0 / elements
        assert half == pytest.approx(np.pi / 2, abs=h)
        assert w0 == pytest.approx(exact, rel=4e-3 * h**2)
    assert result.energy.balance_error < 1e-10
    assert result.counters.events > 100
    # Symmetric about the middle, as scene and start are.
    x = np.linspace(0.0, 6.0, 13)
    assert result.deflection(x, [5.0]) == pytest.approx(result.deflection(12.0 - x, [5.0]), abs=1e-9)


def check_chain_of_masses(example, results, printed):
    """The first closing in closed form."""
    own, forced = np.sqrt(0.1), 2.0

    def first(t):
        return (np.sin(forced * t) - forced / own * np.sin(own * t)) / (own**2 - forced**2) - 0.05

    closing = brentq(first, 0.1, 1.0, xtol=1e-14)
    for count, result in results.items():
        assert result.contacts["gap 1"].closings[0] == pytest.approx(closing, abs=1e-11)
        assert f"{result.counters.statuses:d}   {2 ** (count - 1):10d}" in printed
        assert result.counters.statuses <= 2 ** (count - 1)
    assert results[8].energy.balance_error < 1e-12


def check_switching_operator(example, outcome, printed):
    """10, 50 and 90 % of C0 at s0 s = 0.100, 0.585, 1.907; ds/dt = 4.5 m/s at 3 s."""
    delays, levels = outcome
    assert delays == pytest.approx(np.array([0.100, 0.585, 1.907]) / 4.5e5, rel=1e-12)
    assert levels == pytest.approx([0.2, 1.0, 1.8], abs=5e-3)
    assert "50% of C0 after 1.300 us" in printed
    # Closed in (3, 3.5), (4, 4.5) and from 5 on.
    values = [line.split()[2:] for line in printed.splitlines()[1:7]]
    assert values == [["0.0", "0.0"], ["2.0", "2.0"]] * 3


def check_laws_on_constants(example, numbers, printed):
    """In contact above K0 before exp(-0.5772) s only; open -452 K0 at -2 mm and 4e256 K0 at -5 mm."""
    assert numbers["bound"] == pytest.approx(0.5615, abs=1e-4)
    assert numbers["peak 0.1"] == pytest.approx(1.80, abs=5e-3)
    assert numbers["peak 0.3"] > 1.0
    assert numbers["peak 0.5615"] <= 1.0
    assert numbers["peak 1"] < 1.0
    assert numbers["open -2"] == pytest.approx(-np.log10(452.0), abs=1e-3)
    assert numbers["open -5"] == pytest.approx(256.6, abs=0.05)
    assert "10^256.6 K0" in printed


def check_hysteresis(example, paths, printed):
    """Peaks 4, 8, 14 m; residual elongations 0, 2, 7 m; the jump from 10 to 3 m that the other law does not make."""
    for name, peak, residual in (("a", 4.0, 0.0), ("b", 8.0, 2.0), ("c", 14.0, 7.0)):
        assert paths["single"][name][[140, -1]] == pytest.approx([peak, residual], abs=1e-13)
    xi = paths["reloading"]
    step = example.RELOADING[201] - 3.0
    assert xi["printed"][[200, 201]] == pytest.approx([10.0, 3.0 + step], abs=1e-12)
    assert xi["cyclic"][[200, 201]] == pytest.approx([10.0, 10.0 + step], abs=1e-12)
    assert xi["cyclic"][-1] == pytest.approx(12.5, abs=1e-11)
    assert "printed  3.0450 m at 3.0450 N" in printed


def check_impact_oscillator(example, outcome, printed):
    """The period doubling, and motions along falling values on the branch where that is stable."""
    branch, diagram = outcome
    (doubling,) = [special for special in branch.special if special.kind == "period_doubling"]
    # By an independent program, to 1e-11.
    assert doubling.value == pytest.approx(0.915840977165114, abs=1e-10)
    stable = diagram.values > doubling.value + 0.01
    (mass,) = branch.orbits[0].scene.bodies
    for value, samples in zip(diagram.values[stable], diagram.displacement(start="down")[stable], strict=True):
        (orbit,) = branch.at(value)
        assert orbit.stable
        assert samples[-1] == pytest.approx(orbit.result.displacement(mass, [0.0])[0], abs=1e-5)
    assert np.count_nonzero(stable) >= 3
    assert "period_doubling at w = 0.91584097716" in printed


def check_cantilever_map(example, found, printed):
    """Where the tip does not reach the stop the amplitude is that of the linear beam; at resonance a close stop
    makes it smaller.

    Where the linear motion would not reach the stop, another motion beside it may, with a larger amplitude.
    """
    untouched = 0
    for k, omega in enumerate(found.x):
        scene = example.scene_at(omega, 1.0)
        tip = scene.effects[0].a
        response = vf.frequency_response(scene, [omega / (2.0 * np.pi)]).displacement(tip)
        linear = example.FORCE * abs(response[0])
        free = (found.y > linear) & ~(found.amplitude[k] > found.y)
        assert found.amplitude[k, free] == pytest.approx(linear, rel=1e-9)
        untouched += np.count_nonzero(free)
        if abs(omega - 3.52) < 1.5:
            near = found.amplitude[k, found.y < 0.5 * linear]
            assert near.size > 0
            assert np.all(near[np.isfinite(near)] < linear)
    assert untouched > 10
    assert np.count_nonzero(found.stable == 1.0) > 15
    assert "% stable" in printed


def check_stop_placement(example, found, printed):
    """The tip reaches its limit, and no stop beside the best one is hit more softly."""
    best, trials = found
    x, gap, force = best.x
    last = example.Trial(x, gap)
    assert last.lowest == pytest.approx(-example.LIMIT, rel=1e-6)
    assert last.peaks.max() == pytest.approx(force, rel=1e-6)
    assert force < 0.82 * trials[0].peaks.max()
    for angle in np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False):
        beside = example.Trial(x + 2e-3 * np.cos(angle), gap + 2e-5 * np.sin(angle))
        assert beside.peaks.max() > force or beside.lowest < -example.LIMIT
    assert len(trials) < 30
    assert f"{len(trials)} runs" in printed


def check_afm_contact(example, fit, printed):
    """Two straight lines that meet at the contact point, as an ordinary fit of them finds them."""
    travel, deflection, stiffness, noise = example.curve(None)

    def lines(x, meets, slope, zero):
        return zero + slope * np.maximum(x - meets, 0.0)

    (meets, slope, _), _ = curve_fit(lines, 1e6 * travel, 1e6 * deflection, [4.8, 0.5, -0.01])
    assert fit.values == pytest.approx([1e-6 * meets, stiffness * slope / (1.0 - slope)], rel=1e-6)
    assert fit.runs <= 15
    # What the model leaves out is larger than the noise, and no larger than a few nanometres.
    assert 2.0 * noise < np.std(fit.residuals) < 2e-9
    assert np.max(np.abs(fit.residuals)) == -fit.residuals.min() < 1e-8
    assert f"{fit.values[1]:.5f} N/m" in printed


CHECKS = {
    "afm_contact": check_afm_contact,
    "beam_shapes": check_beam_shapes,
    "cantilever_map": check_cantilever_map,
    "cantilever_on_stop": check_cantilever,
    "chain_of_masses": check_chain_of_masses,
    "hysteresis": check_hysteresis,
    "impact_oscillator": check_impact_oscillator,
    "laws_on_constants": check_laws_on_constants,
    "one_sided_foundation": check_one_sided_foundation,
    "several_stops": check_several_stops,
    "stop_placement": check_stop_placement,
    "switching_operator": check_switching_operator,
    "two_masses": check_two_masses,
}


def test_every_example_has_a_check_and_a_line():
    names = {path.stem for path in EXAMPLES.glob("*.py")}
    assert names == set(CHECKS)
    listed = (EXAMPLES / "README.md").read_text()
    for name in names:
        assert f"python examples/{name}.py" in listed


@pytest.mark.parametrize("name", sorted(CHECKS))
def test_example(name, tmp_path, capsys):
    example = load(name)
    result = example.main(tmp_path)
    printed = capsys.readouterr().out
    pictures = sorted(tmp_path.glob("*.png"))
    assert pictures
    for picture in pictures:
        assert str(picture) in printed
        assert picture.stat().st_size > 5000
    CHECKS[name](example, result, printed)
