"""Branches of steady states against independent special points, closed forms and integrations.

``python tests/test_continuation.py`` prints how far each of the 43 special points of the bilinear oscillator is from
the reference data.
"""

import itertools
import json
import re
import shutil
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from orbit_scenes import bilinear, impact_oscillator, masses_at, nlvib_03, state_at_cosine
from scenes import DATA, between_stops, on_stop
from scipy.integrate import solve_ivp

import vofem as vf
from vofem.studies.steady.following.follow import Follower

KINDS = {"pd": "period_doubling", "graze": "grazing", "fold": "fold", "ns": "neimark_sacker"}


def known_points(low, high):
    points = json.loads((DATA / "orbits" / "P1.json").read_text())["special"]
    return [(KINDS[p["kind"]], p["omega"], p["y0"]) for p in points if low < p["omega"] < high]


def compared(branch, low, high):
    """Return kind, frequency and errors of frequency and state of every known point; all must be on the branch."""
    known = known_points(low, high)
    assert len(branch.special) == len(known)
    rows = []
    for kind, omega, y0 in known:
        mine = min((s for s in branch.special if s.kind == kind), key=lambda s: abs(s.value - omega))
        rows.append((kind, omega, abs(mine.value - omega), np.abs(mine.orbit.unknowns - y0).max()))
    return rows


@pytest.fixture(scope="module")
def bilinear_branch():
    return vf.continuation(bilinear, 6.0, 0.385)


@pytest.fixture(scope="module")
def slow_branch():
    return vf.continuation(bilinear, 0.385, 0.19)


@pytest.fixture(scope="module")
def masses_branch():
    return vf.continuation(nlvib_03, 0.8, 0.5)


@pytest.mark.parametrize(("branch", "low", "high", "count"), [
    ("bilinear_branch", 0.385, 6.0, 17), ("slow_branch", 0.19, 0.385, 26),
])  # fmt: skip
def test_special_points_of_the_bilinear_oscillator(branch, low, high, count, request):
    """All 43 flips, grazings and folds, some 2e-9 from a grazing: 1e-10 in frequency, 1e-9 in the state."""
    rows = compared(request.getfixturevalue(branch), low, high)
    assert len(rows) == count
    for kind, omega, error, state in rows:
        assert error < 1e-10, (kind, omega)
        assert state < 1e-9, (kind, omega)


def test_certified_flips(bilinear_branch):
    """40-digit arithmetic from another formulation."""
    certificates = json.loads((DATA / "orbits" / "P1_certificates.json").read_text())["P1"]["special"]
    flips = [Decimal(c["omega"]) for c in certificates if c["kind"] == "pd"]
    assert len(flips) == 4
    for flip in flips:
        assert min(abs(float(Decimal(s.value) - flip)) for s in bilinear_branch.special) < 1e-11


def test_work_for_the_bilinear_oscillator(bilinear_branch, slow_branch):
    """At most six flows a point, and no eigenvalue problem but the first."""
    for branch in (bilinear_branch, slow_branch):
        counters = branch.counters
        assert counters.points == len(branch)
        assert counters.flows <= 6 * counters.points
        assert counters.check_flows <= 1.2 * counters.points
        assert counters.eigensolves == 1
        assert len(branch) < 320


def test_the_branch_that_leaves_at_a_flip(bilinear_branch):
    flip = bilinear_branch.special[1]
    assert flip.value == pytest.approx(2.338157973248634, abs=1e-11)
    assert flip.orbit.stable is None
    leaving = bilinear_branch.switch(flip)
    assert leaving.periods == 2
    assert leaving.orbits[5].periods == 2
    flips = [s.value for s in leaving.special if s.kind == "period_doubling"]
    assert min(abs(value - 2.570983419519) for value in flips) < 1e-10
    (orbit,) = leaving.at(2.45)
    assert orbit.stable is True
    # A long transient ends there.
    scene = bilinear(2.45)
    run = vf.simulate(scene, 300 * orbit.period)
    assert np.ptp(run.displacement(scene.bodies[0], run.times[-1] - np.linspace(0, orbit.period, 400))) / 2 == (
        pytest.approx(orbit.amplitude(scene.bodies[0]), rel=1e-4)
    )


def test_a_branch_of_doubled_orbits_ends_at_its_flip():
    """It does not walk on along the same orbits, a period later."""
    branch = vf.continuation(bilinear, 2.45, 2.2, periods=2)
    (end,) = branch.special
    assert end.kind == "period_doubling"
    assert end.value == pytest.approx(2.338157973248634, abs=1e-10)
    assert branch.values.min() == end.value
    assert any("over 1 period" in note for note in branch.notes)
    with pytest.raises(vf.ArgumentError, match="fewer periods"):
        branch.switch(end)


def between_two_stops(omega):
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="mass")
    return between_stops(mass, load=vf.Sine(0.8, omega), gap=0.5, stiffness=20.0)[1]


def test_symmetry_breaks_at_a_branch_point():
    """Between two equal stops: the orbits that leave are not symmetric, and their branch closes upon itself."""
    branch = vf.continuation(between_two_stops, 0.75, 1.2)
    points = [s for s in branch.special if s.kind == "branch_point"]
    assert len(points) == 2
    mass = between_two_stops(1.0).bodies[0]
    (symmetric,) = branch.at(0.95)
    least, largest = symmetric.extremes(mass)
    assert largest == pytest.approx(-least, rel=1e-9)
    leaving = branch.switch(points[0])
    assert any("closed" in note for note in leaving.notes)
    # It turns at the other branch point, where its orbits are symmetric again: no fold, and back onto their branch.
    (far,) = [s for s in leaving.special if s.kind == "branch_point"]
    assert far.value == pytest.approx(points[1].value, abs=1e-10)
    back = leaving.switch(far)
    least, largest = back.orbits[-1].extremes(mass)
    assert largest == pytest.approx(-least, rel=1e-9)
    assert [s.value for s in back.special] == pytest.approx([points[0].value], abs=1e-10)
    pair = [orbit.extremes(mass) for orbit in leaving.at(1.0)]
    assert len(pair) == 2
    # Two orbits that mirror each other.
    assert pair[0] == pytest.approx((-pair[1][1], -pair[1][0]), rel=1e-8)
    assert abs(pair[0][0] + pair[0][1]) > 1e-3


def with_damping(damping):
    return lambda omega: bilinear(omega, damping=damping)


@pytest.mark.parametrize(("damping", "apart"), [(1.2276, 1.3e-2), (1.2276185, 5.4e-4), (1.227618531355, 5.5e-6)])
def test_two_flips_within_one_step(damping, apart):
    """With so much damping orbits are unstable between two close flips only; no neighbour on the branch shows it."""
    build = with_damping(damping)
    wide = vf.continuation(build, 6.0, 2.0)
    flips = [s for s in wide.special if s.kind == "period_doubling"]
    assert len(flips) == len(wide.special) == 2
    assert int(flips[0].place) == int(flips[1].place)
    assert all(orbit.stable for orbit in wide.orbits)
    first, second = (flip.value for flip in flips)
    assert first - second == pytest.approx(apart, rel=0.05)
    for flip in flips:
        assert np.min(np.abs(flip.orbit.multipliers + 1.0)) < 1e-9

    def beyond(value):
        """Return how far the leading multiplier lies beyond -1."""
        return -1.0 - vf.periodic(build(value), guess=flips[0].orbit).multipliers.real.min()

    # The multiplier passes -1 at both, between them it lies beyond, and on both sides it does not.
    middle = beyond(0.5 * (first + second))
    assert middle > 0.0
    assert beyond(first + 0.5 * apart) < -middle
    assert beyond(second - 0.5 * apart) < -middle
    assert wide.counters.flows <= 6 * len(wide)
    assert wide.counters.refinement_flows < 170


def test_two_folds_within_one_step():
    """Just beyond the load at which a resonance curve begins to lean over: three orbits between them, one beside."""

    def build(omega):
        mass = vf.Mass(1.0, stiffness=1.0, damping=0.2, name="m")
        cubic = vf.NonlinearSpring(mass, potential=lambda u: u**4 / 4, force=lambda u: u**3)
        return vf.Scene([mass], [cubic, vf.PointLoad(mass, vf.Sine(0.1648, omega))])

    branch = vf.continuation(build, 1.0, 2.0, harmonics=9)
    assert [s.kind for s in branch.special] == ["fold", "fold"]
    first, second = branch.special
    assert 0.0 < first.value - second.value < 3e-6
    assert int(first.place) == int(second.place)
    middle, apart = 0.5 * (first.value + second.value), first.value - second.value
    assert [len(branch.at(value)) for value in (middle - apart, middle, middle + apart)] == [1, 3, 1]


@pytest.mark.parametrize("difference", [0.0, 1e-6])
def test_two_oscillators_that_flip_together(difference):
    """Two masses without a connection: both flips are on the branch, also where they coincide or nearly do."""

    def alone(omega, k=0):
        mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="ab"[k])
        stiffness = 8.0 * (1.0 + k * difference)
        stop = vf.Contact(mass, gap=0.0, stiffness=stiffness, side="above", acts_on="penetration", name=f"stop {k}")
        return [mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, omega))]

    def both(omega):
        first, second = alone(omega), alone(omega, 1)
        return vf.Scene(first[0] + second[0], first[1] + second[1])

    known = [vf.continuation(lambda w, k=k: vf.Scene(*alone(w, k)), 2.4, 2.3).special[0].value for k in range(2)]
    found = vf.continuation(both, 2.4, 2.3, guess=vf.periodic(both(2.4), method="harmonic_balance")).special
    assert [s.kind for s in found] == ["period_doubling"] * 2
    assert sorted(s.value for s in found) == pytest.approx(sorted(known), abs=1e-11)


def test_sheets_are_solved_again(bilinear_branch):
    """Three sheets between two folds; none outside of the branch."""
    sheets = bilinear_branch.at(0.51)
    assert len(sheets) == 3
    for orbit in sheets:
        assert orbit.omega == 0.51
        assert orbit.residual < 1e-10
    assert bilinear_branch.at(6.5) == []
    assert len(bilinear_branch.at(1.5)) == 1


def test_the_parameter_may_be_a_stiffness():
    """Modes change with the parameter: unknowns keep their meaning."""

    def build(stiffness):
        a, b = vf.Mass(1.0, stiffness=stiffness, damping=0.1, name="a"), vf.Mass(1.0, stiffness=1.0, name="b")
        stop = vf.Contact(a, gap=0.3, stiffness=5.0, side="above", acts_on="penetration", name="stop")
        load = vf.PointLoad(b, vf.Sine(0.5, 0.9))
        return vf.Scene([a, b], [vf.Spring(a, b, stiffness=1.0), vf.Dashpot(a, b, damping=0.1), stop, load])

    branch = vf.continuation(build, 1.0, 2.0)
    assert branch.values[-1] == 2.0
    scene = build(2.0)
    known = vf.periodic(scene)
    found = branch.orbits[-1]
    for name in ("a", "b"):
        for mine, theirs in zip(found.state_of(name), known.state_of(name), strict=True):
            assert mine == pytest.approx(theirs, abs=1e-10)


@pytest.mark.parametrize(
    ("name", "ends"), [("dashpot", (0.3, 0.0)), ("damping", (2.0, 0.0)), ("stiffness", (200.0, 1.0))]
)
def test_scenes_beyond_the_interval_are_not_needed(name, ends):
    """Negative ones are refused, and the branch arrives all the same; so it does where a function fails there."""
    amplitude = 0.1 if name == "stiffness" else 0.3

    def build(value):
        if value < ends[1]:
            raise ValueError("no scene is known here")
        return nlvib_03(0.7, amplitude, **{name: value})

    for built in (lambda value: nlvib_03(0.7, amplitude, **{name: value}), build):
        branch = vf.continuation(built, *ends)
        assert branch.values[-1] == ends[1]
        assert not any("lost" in note for note in branch.notes)
        assert max(orbit.residual for orbit in branch.orbits) < 1e-8

    def broken(value):
        if value < 0.5 * sum(ends):
            raise ValueError("no scene is known here")
        return nlvib_03(0.7, amplitude, **{name: value})

    with pytest.raises(ValueError, match="no scene is known here") as raised:
        vf.continuation(broken, *ends)
    assert raised.value.branch.values[0] == ends[0]
    assert len(raised.value.branch) > 1


def test_a_branch_begins_and_ends_where_nothing_moves():
    """The linear motion is in proportion to its load."""
    up = vf.continuation(lambda amplitude: nlvib_03(0.7, amplitude), 0.0, 0.05)
    assert up.values[-1] == 0.05
    mass = up.orbits[-1].scene.bodies[0]
    whole = up.orbits[-1].amplitude(mass)
    assert [orbit.amplitude(mass) for orbit in up.orbits] == pytest.approx(whole * up.values / 0.05, abs=1e-12)
    down = vf.continuation(lambda amplitude: nlvib_03(0.7, amplitude), 0.05, 0.0)
    assert 0.0 < down.values[-1] < 1e-10
    assert "where the motion vanishes" in down.notes[-1]
    assert not any("lost" in note for note in down.notes)


def test_a_pair_that_is_outside_when_it_becomes_one():
    """Beyond a fold two real multipliers lie above 1 and meet there; the pair passes the circle a little later."""

    def build(omega):
        return nlvib_03(2.0 * omega, phase=0.0, pushed=(vf.Sine(0.05, 3.0 * omega, 0.3),))

    known = {"a": (-1.647114, 0.339184), "b": (-0.572629, -0.145304)}
    guess = masses_at(known)
    branch = vf.continuation(build, 0.249494, 0.24956, guess=guess)
    assert [one.kind for one in branch.special] == ["fold", "neimark_sacker"]
    assert [one.value for one in branch.special] == pytest.approx([0.249530735001, 0.249530727880], abs=1e-12)
    sizes = np.sort(np.abs(branch.special[1].orbit.multipliers))[-2:]
    assert sizes == pytest.approx([1.0, 1.0], abs=1e-8)


def test_two_masses_on_a_stop(masses_branch):
    """NLvib's example 03: the linear response grazes, and everything beyond."""
    branch = masses_branch
    of = {kind: [s for s in branch.special if s.kind == kind] for kind in KINDS.values()}
    grazings = sorted(s.value for s in of["grazing"])
    assert grazings == pytest.approx([0.5818996390393119, 0.6534401404162605], abs=1e-12)
    fold = min(of["fold"], key=lambda s: abs(s.value - 0.755627352609))
    assert fold.value == pytest.approx(0.755627352609, abs=1e-11)
    assert state_at_cosine(fold.orbit) == pytest.approx(
        [-0.676029456452, -0.817604707124, 1.050878187814, 0.190765997506], abs=1e-9
    )
    flip = min(of["period_doubling"], key=lambda s: abs(s.value - 0.755586159356))
    assert flip.value == pytest.approx(0.755586159356, abs=1e-11)
    assert state_at_cosine(flip.orbit) == pytest.approx(
        [-0.602889368436, -0.810675818536, 1.039703264833, 0.274093674871], abs=1e-9
    )
    assert len(of["period_doubling"]) == 2
    assert of["neimark_sacker"]
    for point in of["neimark_sacker"]:
        size = np.abs(point.orbit.multipliers)
        assert np.min(np.abs(size - 1.0)) < 1e-10
        assert point.orbit.multipliers[np.argmin(np.abs(size - 1.0))].imag != 0.0
    (orbit,) = [o for o in branch.at(0.635) if len(o.result.contacts["stop"].closings)]
    assert state_at_cosine(orbit)[0] == pytest.approx(0.9613616024620069, abs=1e-11)
    assert branch.counters.eigensolves <= 2


def test_the_impact_oscillator_of_ing():
    """Grazing in closed form; the flip at which the impacting orbit becomes stable."""
    branch = vf.continuation(impact_oscillator, 0.75, 1.1)
    grazing, *flips = branch.special
    assert grazing.kind == "grazing"
    assert grazing.value == pytest.approx(0.8019281065932354, abs=1e-12)
    assert flips[-1].kind == "period_doubling"
    assert flips[-1].value == pytest.approx(0.915840977165114, abs=1e-11)
    assert state_at_cosine(flips[-1].orbit) == pytest.approx([1.3903338627988389, 0.19430976298846372], abs=1e-9)
    assert flips[-1].orbit.multipliers[1] == pytest.approx(-0.87178602, abs=1e-7)
    assert branch.orbits[-1].stable is True
    assert branch.at(0.85)[0].stable is False


def jumping(omega):
    return bilinear(omega, amplitude=0.15, gap=1.0, acts_on="displacement")


def returned(orbit, start):
    """Return the state a period later by an integration with events of its own."""
    omega, t = orbit.omega, 0.0
    y, end = np.array(start), orbit.period

    def rates(t, y, closed):
        return [y[1], 0.15 * np.sin(omega * t) - 0.1 * y[1] - y[0] - (8.0 * y[0] if closed else 0.0)]

    closed = bool(y[0] > 1.0)
    while t < end:

        def gap(t, y, closed):
            return y[0] - 1.0

        gap.terminal, gap.direction = True, -1.0 if closed else 1.0
        run = solve_ivp(rates, (t, end), y, "DOP853", rtol=1e-12, atol=1e-14, events=gap, args=(closed,))
        t, y = run.t[-1], run.y[:, -1]
        closed = not closed
    return y


def test_the_displacement_law_on_a_branch():
    """Force jumps: both grazings, where the leading multiplier has no bound, a fold and a flip, all confirmed."""
    branch = vf.continuation(jumping, 0.8, 1.5)
    kinds = [s.kind for s in branch.special]
    assert kinds.count("grazing") == 2
    assert "fold" in kinds
    assert "period_doubling" in kinds
    for point in branch.special:
        start = point.orbit.unknowns
        if point.kind == "grazing":
            # The linear response reaches the stop: in closed form.
            w = point.value
            assert 0.15 / abs(1.0 - w**2 + 0.1j * w) == pytest.approx(1.0, abs=1e-11)
            # The multipliers are those of one side.
            assert point.orbit.stable is None
            assert "at a grazing" in point.orbit.stability
            continue
        assert returned(point.orbit, start) == pytest.approx(start, abs=1e-9)
        # Differences of the return along the eigenvector of the critical multiplier.
        critical = 1.0 if point.kind == "fold" else -1.0
        assert min(abs(point.orbit.multipliers - critical)) < 1e-8
        columns = []
        for k in range(2):
            moved = np.zeros(2)
            moved[k] = 1e-5
            columns.append((returned(point.orbit, start + moved) - returned(point.orbit, start - moved)) / 2e-5)
        assert np.min(np.abs(np.linalg.eigvals(np.array(columns).T) - critical)) < 1e-4
    # Just beyond a grazing the leading multiplier is large, the larger the nearer.
    largest = max(np.abs(orbit.multipliers[0]) for orbit in branch.orbits)
    assert largest > 1e3


def test_a_branch_is_saved_and_loaded(tmp_path):
    branch = vf.continuation(bilinear, 2.4, 2.2)
    path = branch.save(tmp_path / "branch.h5")
    loaded = vf.load(path)
    assert np.array_equal(loaded.values, branch.values)
    assert list(loaded.stable) == list(branch.stable)
    assert [(s.kind, s.value) for s in loaded.special] == [(s.kind, s.value) for s in branch.special]
    mass = bilinear(1.0).bodies[0]
    # The segments of a loaded orbit begin at another phase, from the state at t = 0 that the file holds.
    assert loaded.amplitude(mass) == pytest.approx(branch.amplitude(mass), rel=1e-12)
    assert np.array_equal(loaded.orbits[3].multipliers, branch.orbits[3].multipliers)
    assert loaded.counters == branch.counters
    (mine,), (again,) = branch.at(2.3), loaded.at(2.3)
    assert again.unknowns == pytest.approx(mine.unknowns, abs=1e-11)
    assert again.multipliers == pytest.approx(mine.multipliers, abs=1e-9)
    with pytest.raises(vf.ArgumentError, match="follow the branch again"):
        loaded.switch(loaded.special[0])
    with pytest.raises(vf.OutputError):
        branch.save(path)


def on_a_stop(beam):
    """Return the tip of a cantilever on a stop, and three orbits of it."""
    tip = beam.at("right")
    stop = vf.Contact(tip, gap=0.002, stiffness=10.0, side="below", acts_on="penetration", name="stop")

    def build(omega):
        return vf.Scene([beam], [stop, vf.PointLoad(tip, vf.Sine(0.02, omega)), vf.ModalDamping(0.02)])

    return tip, vf.continuation(build, 1.0, 1.2, max_points=3)


def test_a_branch_needs_no_mesh_file(tmp_path):
    mesh = Path(shutil.copy(Path(__file__).parent.parent / "meshes" / "beam25.msh", tmp_path / "beam.msh"))
    tip, branch = on_a_stop(vf.Beam.from_mesh(mesh, 1.0, 1.0, {"left": "clamped"}, name="b"))
    path = branch.save(tmp_path / "branch.h5")
    mesh.unlink()
    assert vf.load(path).amplitude(tip) == pytest.approx(branch.amplitude(tip), rel=1e-12)


def test_a_branch_whose_scenes_a_file_cannot_hold_says_so(tmp_path):
    tip, branch = on_a_stop(vf.Beam(1.0, lambda x: 1.0 + x, 1.0, 4, {"left": "clamped"}, name="b"))
    loaded = vf.load(branch.save(tmp_path / "branch.h5"))
    assert loaded.notes == branch.notes
    assert "branch.h5 holds the numbers of orbits, but not their motion" in loaded.notes[-1]
    assert np.array_equal(loaded.omega, branch.omega)
    with pytest.raises(vf.MissingCallableError, match="callable"):
        loaded.amplitude(tip)


def test_orbits_of_a_loaded_branch_on_all_sheets(masses_branch, tmp_path):
    """Between the folds there are three orbits; a number that is a power of the parameter is found between scenes."""
    branch = masses_branch
    loaded = vf.load(branch.save(tmp_path / "folds.h5"))
    mine, again = branch.at(0.7545), loaded.at(0.7545)
    assert len(mine) == len(again) == 3
    for one, other in zip(mine, again, strict=True):
        assert other.unknowns == pytest.approx(one.unknowns, abs=1e-10)
    ing = vf.continuation(impact_oscillator, 0.75, 0.79)
    value = 0.5 * (ing.values[1] + ing.values[2])
    (one,), (other,) = ing.at(value), vf.load(ing.save(tmp_path / "ing.h5")).at(value)
    assert other.unknowns == pytest.approx(one.unknowns, abs=1e-12)
    # A scene leaves out a number that is the default.
    hard = vf.continuation(lambda damping: nlvib_03(0.7, 0.3, damping=damping), 0.0, 1.0)
    loaded = vf.load(hard.save(tmp_path / "hard.h5"))
    for value in (0.0, 0.5, 1.0):
        (one,), (other,) = hard.at(value), loaded.at(value)
        assert other.unknowns == pytest.approx(one.unknowns, abs=1e-11)
    odd = vf.continuation(lambda w: bilinear(2.4, amplitude=float(np.exp(w))), 0.0, 0.2)
    with pytest.raises(vf.ArgumentError, match=r"amplitude.* is no polynomial"):
        vf.load(odd.save(tmp_path / "odd.h5")).at(0.1)


def test_progress_and_interruption():
    seen = []

    def tell(value, stop):
        seen.append((value, stop))
        if len(seen) == 5:
            import _thread

            _thread.interrupt_main()

    branch = vf.continuation(bilinear, 2.3, 1.0, progress=tell)
    assert seen[0] == (2.3, 1.0)
    assert 4 <= len(branch) <= 8
    assert any("interrupted" in note for note in branch.notes)


def test_bad_arguments():
    with pytest.raises(vf.ArgumentError, match="build"):
        vf.continuation(bilinear(1.0), 1.0, 2.0)
    with pytest.raises(vf.ArgumentError, match=r"called as build\(value\): missing a required argument: 'gap'"):
        vf.continuation(lambda omega, gap: bilinear(omega, gap=gap), 1.0, 2.0)
    with pytest.raises(TypeError, match="float"):  # One of its own.
        vf.continuation(lambda omega: bilinear(omega + "1"), 1.0, 2.0)
    with pytest.raises(vf.ArgumentError, match="returned"):
        vf.continuation(lambda value: value, 1.0, 2.0)
    with pytest.raises(vf.ArgumentError, match="interval"):
        vf.continuation(bilinear, 1.0, 1.0)
    with pytest.raises(vf.ArgumentError, match="interval"):
        vf.continuation(bilinear, 1.0, 1.0 + 1e-15)
    for ends in ((0.7, 0.8), (0.8, 0.7)):
        with pytest.raises(vf.MethodError, match=r"2 contacts and sliders, and 1|1 contacts and sliders, and 2"):
            vf.continuation(lambda w: nlvib_03(w, sides=("above", "below")[: 1 + (w > 0.75)]), *ends)
    with pytest.raises(vf.ArgumentError, match="periods"):
        vf.continuation(bilinear, 1.0, 2.0, periods=1.5)
    branch = vf.continuation(bilinear, 1.5, 1.6, max_points=3)
    assert any("max_points" in note for note in branch.notes)
    # A limit says, as a loss does, what contacts do there: here the branch has just grazed the stop.
    branch = vf.continuation(jumping, 0.918, 1.5, max_points=8)
    assert "raise max_points to go on; the orbit there has a touch at 'stop' for" in branch.notes[-1]
    branch = vf.continuation(bilinear, 3.0, 1.0, max_seconds=1e-3)
    assert 1 <= len(branch) < 5
    assert any("max_seconds" in note for note in branch.notes)
    with pytest.raises(vf.ArgumentError, match="special"):
        branch.switch("fold")


def test_a_branch_that_leaves_through_its_own_start():
    """The note names the fold at which it turned."""
    branch = vf.continuation(nlvib_03, 0.74, 0.8, guess=vf.continuation(nlvib_03, 0.62, 0.74).orbits[-1])
    fold = next(s for s in branch.special if s.kind == "fold")
    assert branch.values[-1] == branch.values[0] == 0.74
    assert fold.value == pytest.approx(0.755627352609, abs=1e-11)
    (note,) = [note for note in branch.notes if "own start" in note]
    assert f"{fold.value:.12g}" in note


@pytest.mark.parametrize("stop", [0.84375, 0.84625, 0.8475])
def test_no_branch_leaves_its_interval(stop):
    """At the flank of a resonance a long step leads farther than it was predicted."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.05)
    branch = vf.continuation(lambda w: vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(1.0, w))]), 0.5, stop, max_step=0.5)
    assert branch.values[-1] == branch.values.max() == stop


def test_a_walk_that_comes_back_along_its_own_orbits_is_told(monkeypatch):
    """No branch does so. Here one direction is reversed, as by a step to another part of the branch."""
    accepted, steps = Follower._accepted, itertools.count()

    def reversed_once(self, *given):
        after = accepted(self, *given)
        return after.turned() if next(steps) == 6 else after

    monkeypatch.setattr(Follower, "_accepted", reversed_once)
    branch = vf.continuation(nlvib_03, 0.62, 0.74)
    assert branch.values[-1] == branch.values[0] == 0.62
    assert re.search(r"turned round near 0\.6\d+ and came back along its own orbits, .* max_step=", branch.notes[-1])


if __name__ == "__main__":
    whole = vf.continuation(bilinear, 6.0, 0.19)
    print(whole, whole.counters)
    for row in compared(whole, 0.19, 6.0):
        print("{:16s} {:.16f}  frequency {:.1e}  state {:.1e}".format(*row))


def test_an_undamped_linear_mass_has_no_special_points():
    """Its multipliers lie on the unit circle, and rounding does not carry them across it."""
    mass = vf.Mass(1.0, stiffness=1.0, name="m")
    branch = vf.continuation(lambda w: vf.Scene([mass], [vf.PointLoad(mass, vf.Sine(0.1, w))]), 0.3, 0.8)
    assert branch.values[-1] == 0.8
    assert not branch.special


def test_pairs_that_meet_on_the_unit_circle_without_damping():
    """Two pairs of multipliers meet on the unit circle and leave it; the others stay on it all along the branch."""

    def build(omega, *others):
        beam = vf.Beam(1.0, EI=1.0, rhoA=1.0, elements=5, supports={"left": "clamped"}, name="beam")
        return on_stop(beam.at(1.0), *others, load=vf.Sine(0.02, omega), gap=0.02, stiffness=50.0, side="below")[1]

    start = vf.periodic(build(2.884, vf.ModalDamping(0.02)))
    branch = vf.continuation(build, 2.884, 2.8875, guess=start)
    met = [special for special in branch.special if special.kind == "neimark_sacker"]
    assert [special.value for special in met] == pytest.approx([2.885190539], abs=1e-8)
    size = np.abs(met[0].orbit.multipliers)
    assert [size.min(), size.max()] == pytest.approx([1.0, 1.0], abs=1e-5)
    # Before it all lie on the circle, beyond it two pairs do not.
    leading = [np.abs(orbit.multipliers).max() for orbit in branch.orbits]
    assert leading[0] == pytest.approx(1.0, abs=1e-8)
    assert leading[-1] > 1.01


@pytest.mark.parametrize("far", [1.0, 1e5])
def test_a_fold_beside_a_grazing_is_one_in_an_interval_of_any_size(far):
    """They are 2e-7 rad/s apart, and a wide interval makes the rate of the parameter small."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="m")
    stop = vf.Contact(mass, gap=0.5, stiffness=8.0, side="above", acts_on="penetration", name="s")
    branch = vf.continuation(
        lambda x: vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, -x))]), -0.2821, far, max_points=40
    )
    assert [one.kind for one in branch.special] == ["grazing", "fold"]
    assert branch.special[1].value == pytest.approx(-0.281264635800429, rel=1e-12)
    assert "left the interval through its own start" in branch.notes[-1]


def test_multipliers_beside_grazings_of_a_stiff_damped_contact():
    """The reference has 60 digits: saltation matrices between exponentials, both computed with mpmath."""
    beam = vf.Beam(
        length=0.17892164734428406, EI=0.06973657374099713, rhoA=0.0985850884844551, elements=2,
        supports={"left": "clamped"}, name="beam",
    )  # fmt: skip
    end, mass = beam.at(0.5 * beam.length), vf.Mass(0.0006227086738661865, stiffness=23.116089027097836, name="m")
    law = {"stiffness": 12144243.72400639, "damping": 62.900841886417936, "acts_on": "penetration"}
    stop = vf.Contact(end, mass, gap=0.00022339532975242625, name="stop", **law)

    def scene(omega):
        load = vf.PointMoment(end, vf.Sine(0.0011623757832971008, omega, phase=0.5 * np.pi))
        return vf.Scene([beam, mass], [vf.ModalDamping(0.03949835377892572), stop, load])

    branch = vf.continuation(scene, 81.75, 81.81397)
    assert [one.kind for one in branch.special] == [
        "grazing", "neimark_sacker", "fold", "fold", "neimark_sacker",
    ]  # fmt: skip
    assert not branch.notes
    last = branch.special[-1]
    assert last.value == pytest.approx(81.8139550381561, rel=1e-12)
    pair = last.orbit.multipliers[np.argsort(np.abs(np.abs(last.orbit.multipliers) - 1.0))[:2]]
    assert pair.real == pytest.approx(0.798904, abs=1e-6)
    assert np.abs(pair.imag) == pytest.approx(0.601458, abs=1e-6)
