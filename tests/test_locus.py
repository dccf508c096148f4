"""Curves of special points in two parameters, against branches at other values and a known meeting of two flips."""

import numpy as np
import pytest
from orbit_scenes import bilinear, masses_at, nlvib_03
from populations import drawn
from scenes import cantilever

import vofem as vf
from vofem.errors import ArgumentError, MethodError
from vofem.io import plot


def damped(omega, damping):
    return bilinear(omega, damping=damping)


def between_stops(omega, amplitude, gap=0.5):
    mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="mass")
    stops = [
        vf.Contact(
            mass, gap=gap if side == "below" else 0.5, stiffness=20.0, side=side, acts_on="penetration", name=side
        )
        for side in ("above", "below")
    ]
    return vf.Scene([mass], [*stops, vf.PointLoad(mass, vf.Sine(amplitude, omega))])


@pytest.fixture(scope="module")
def branches():
    """Return the branches of the two masses for two amplitudes of the load."""
    return [vf.continuation(lambda omega, a=a: nlvib_03(omega, a), 0.8, 0.5) for a in (0.1, 0.105)]


@pytest.fixture(scope="module")
def flips():
    branch = vf.continuation(lambda omega: damped(omega, 1.2), 6.0, 2.0)
    return [s for s in branch.special if s.kind == "period_doubling"]


@pytest.fixture(scope="module")
def between_flips(flips):
    return vf.locus(damped, flips[0], 1.2, 1.5)


def test_two_flips_meet(flips, between_flips):
    """The locus begins at one flip, turns where both meet, and comes back through the other."""
    found = between_flips
    assert found.kind == "period_doubling"
    assert tuple(found.values[0]) == pytest.approx((flips[0].value, 1.2), abs=1e-11)
    assert tuple(found.values[-1]) == pytest.approx((flips[1].value, 1.2), abs=1e-11)
    (turn,) = found.special
    assert turn.kind == "turn"
    assert turn.other == pytest.approx(1.2276185314, abs=1e-10)
    assert found.values[:, 1].max() == turn.other
    assert np.min(np.abs(turn.orbit.multipliers + 1.0)) < 1e-8
    assert any("turned" in note for note in found.notes)


def nearest(branch, special, kind=None):
    return min((s for s in branch.special if s.kind == special.kind), key=lambda s: abs(s.value - special.value))


@pytest.mark.parametrize(("index", "kind"), [
    (0, "grazing"), (1, "fold"), (2, "fold"), (3, "period_doubling"), (5, "neimark_sacker"), (7, "grazing"),
])  # fmt: skip
def test_a_locus_leads_to_the_special_point_of_another_branch(branches, index, kind):
    """Also a fold that lies 6e-9 rad/s from its grazing."""
    first, second = branches
    special = first.special[index]
    assert special.kind == kind
    found = vf.locus(nlvib_03, special, 0.1, 0.105)
    assert found.contact == special.contact
    value, other = found.values[-1]
    assert other == 0.105
    assert value == pytest.approx(nearest(second, special).value, abs=1e-10)


def test_loci_of_folds_and_flips_meet_at_one_point(branches):
    """Where both multipliers lie on the circle, the point is on either curve."""
    fold, flip = branches[0].special[2:4]
    (at_fold,) = vf.locus(nlvib_03, fold, 0.1, 0.105).special
    (at_flip,) = vf.locus(nlvib_03, flip, 0.1, 0.105).special
    assert (at_fold.kind, at_flip.kind) == ("period_doubling", "fold")
    assert (at_fold.value, at_fold.other) == pytest.approx((at_flip.value, at_flip.other), abs=1e-10)
    multipliers = at_fold.orbit.multipliers
    assert max(np.min(np.abs(multipliers - one)) for one in (1.0, -1.0)) < 1e-6


def test_two_folds_meet_at_a_cusp():
    """A softly limited beam has no folds below the cusp, two close ones above, and the locus has its tip there."""
    beam = cantilever(2, name="beam")
    tip = beam.at(1.0)
    rest = [
        vf.Contact(tip, gap=0.005, stiffness=5.0, side="below", acts_on="penetration", name="stop"),
        vf.ModalDamping(0.03),
    ]

    def build(omega, amplitude):
        return vf.Scene([beam], [*rest, vf.PointLoad(tip, vf.Sine(amplitude, omega))])

    start = 0.0011
    folds = [s for s in vf.continuation(lambda w: build(w, start), 3.0, 4.5).special if s.kind == "fold"]
    assert len(folds) == 2
    found = vf.locus(build, folds[0], start, 0.0009)
    assert found.values[-1] == pytest.approx((folds[1].value, start), abs=1e-10)
    (cusp,) = found.special
    assert cusp.kind == "cusp"
    assert found.values[:, 1].min() == cusp.other
    apart = []
    for factor in (1.0001, 0.9999):
        branch = vf.continuation(lambda w, f=factor: build(w, f * cusp.other), 3.3, 3.8)
        apart.append([s.value for s in branch.special if s.kind == "fold"])
    assert [len(one) for one in apart] == [2, 0]
    assert apart[0] == pytest.approx([cusp.value] * 2, abs=1e-3)


def test_folds_beside_a_grazing_meet_at_a_cusp():
    """The touch is short at first, so that equations and null vectors change fast; either fold leads to the other."""

    def build(omega, stiffness=20.0, damping=0.1):
        mass = vf.Mass(1.0, stiffness=1.0, damping=damping, name="mass")
        stop = vf.Contact(mass, gap=0.3, stiffness=stiffness, side="above", acts_on="penetration", name="stop")
        return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(0.5, omega))])

    upper, lower = (s for s in vf.continuation(build, 0.6, 0.75).special if s.kind == "fold")
    by_stiffness = vf.locus(build, upper, 20.0, 2.0)
    by_damping = vf.locus(lambda omega, damping: build(omega, damping=damping), lower, 0.1, 0.4, max_points=100)
    for found, first, last in ((by_stiffness, upper, lower), (by_damping, lower, upper)):
        assert found.values[[0, -1], 0] == pytest.approx([first.value, last.value], abs=1e-10)
        assert [one.kind for one in found.special] == ["cusp"]


def test_branch_points_of_a_symmetric_scene():
    """Both branch points are ends of one curve; they exist for equal stops alone."""
    points = vf.continuation(lambda w: between_stops(w, 0.65), 0.75, 1.2).special
    assert [s.kind for s in points] == ["branch_point"] * 2
    found = vf.locus(between_stops, points[0], 0.65, 0.5, max_step=0.25)
    assert found.values[-1] == pytest.approx((points[1].value, 0.65), abs=1e-10)
    (turn,) = found.special
    assert turn.kind == "turn"
    assert 0.5 < turn.other < 0.65
    with pytest.raises(ArgumentError, match="not symmetric"):
        vf.locus(lambda w, gap: between_stops(w, 0.65, gap), points[0], 0.5, 0.6)


@pytest.mark.parametrize("ends", [(0.45, 0.54), (0.49, 0.52)])
def test_a_locus_begins_where_another_contact_grazes_too(ends):
    """Both stops of a symmetric scene are grazed at once, and a constant load parts them."""

    def build(omega, push):
        return nlvib_03(omega, 0.3, phase=0.0, sides=("above", "below"), pushed=(None, vf.Constant(push)))

    grazing = next(one for one in vf.continuation(lambda w: build(w, 0.0), *ends).special if one.contact == "other")
    found = vf.locus(build, grazing, 0.0, 0.1)
    assert [one.kind for one in found.special] == ["grazing", "period_doubling", "turn"]
    assert found.values[-1] == pytest.approx((0.5051829, 0.0), abs=1e-7)
    assert found.values[:, 1].max() > 8e-6


def test_a_grazing_by_its_closed_form(branches):
    """The linear response reaches the stop: amplitude times compliance equals the gap, along the whole curve."""
    found = vf.locus(nlvib_03, branches[0].special[0], 0.1, 0.3)
    for omega, amplitude in found.values:
        stiffness = np.array([[1.0, -1.0], [-1.0, 2.0]])
        damping = 0.03 * stiffness
        matrix = stiffness + 1j * omega * damping - omega**2 * np.eye(2)
        assert abs(amplitude * np.linalg.solve(matrix, [0.0, 1.0])[0]) == pytest.approx(1.0, abs=1e-9)


def test_folds_by_harmonic_balance():
    """With five harmonics the fold of a mass on a stop moves as that of another branch with five harmonics does."""

    def build(omega, amplitude):
        mass = vf.Mass(1.0, stiffness=1.0, damping=0.05, name="mass")
        stop = vf.Contact(mass, gap=0.5, stiffness=3.0, side="above", acts_on="penetration", name="stop")
        return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(amplitude, omega))])

    first, second = (
        vf.continuation(lambda w, a=a: build(w, a), 1.25, 1.35, method="harmonic_balance", harmonics=5).special[0]
        for a in (0.3, 0.32)
    )
    assert first.kind == "fold"
    found = vf.locus(build, first, 0.3, 0.32)
    assert found.values[-1] == pytest.approx((second.value, 0.32), abs=1e-10)


def test_folds_meet_where_multipliers_are_not_known():
    """The force of a spring that slips depends on the past, so only the equations tell where two folds vanish."""

    def build(omega, amplitude):
        mass = vf.Mass(1.0, stiffness=1.0, damping=0.04, name="mass")
        cubic = vf.NonlinearSpring(mass, potential=lambda u: 0.25 * u**4, force=lambda u: u**3)
        slip = vf.BilinearSpring(mass, stiffness=0.02, linear_limit=0.05)
        return vf.Scene([mass], [cubic, slip, vf.PointLoad(mass, vf.Sine(amplitude, omega))])

    fold = vf.continuation(lambda w: build(w, 0.0138), 1.03, 1.06, harmonics=1).special[0]
    assert fold.kind == "fold"
    assert fold.orbit.multipliers is None
    found = vf.locus(build, fold, 0.0138, 0.013)
    (cusp,) = found.special
    assert cusp.kind == "cusp"
    assert cusp.other == pytest.approx(found.values[:, 1].min(), abs=1e-6)
    branch = vf.continuation(lambda w: build(w, cusp.other * (1.0 + 1e-4)), 1.03, 1.06, harmonics=1)
    assert [one.kind for one in branch.special] == ["fold", "fold"]


def test_a_locus_is_saved_loaded_and_drawn(between_flips, tmp_path):
    found = between_flips
    again = vf.load(found.save(tmp_path / "locus.h5"))
    assert isinstance(again, vf.Locus)
    assert np.array_equal(again.values, found.values)
    assert (again.kind, again.notes, again.counters) == (found.kind, found.notes, found.counters)
    assert [(s.kind, s.value, s.other) for s in again.special] == [(s.kind, s.value, s.other) for s in found.special]
    assert again.special[0].orbit.multipliers == pytest.approx(found.special[0].orbit.multipliers)
    assert plot.locus(again, tmp_path / "locus.png").exists()
    assert "turn" in repr(again)
    with pytest.raises(ArgumentError, match=r"is a locus .* leave out scene="):
        vf.load(tmp_path / "locus.h5", scene=damped(3.0, 1.2))
    with pytest.raises(ArgumentError, match="expected Locus, or several of them"):
        plot.locus([])


def test_limits_and_interruption(flips):
    few = vf.locus(damped, flips[0], 1.2, 1.5, max_points=4)
    assert len(few) == 4
    assert "max_points" in few.notes[-1]
    assert "max_seconds" in vf.locus(damped, flips[0], 1.2, 1.5, max_seconds=1e-9).notes[-1]
    seen = []
    vf.locus(damped, flips[0], 1.2, 1.21, progress=lambda now, stop: seen.append((now, stop)))
    assert seen[-1] == (1.21, 1.21)


def test_bad_arguments(flips, branches):
    flip = flips[0]
    for arguments, message in [
        ((None, flip, 1.2, 1.3), "expected a function"),
        ((damped, flip.orbit, 1.2, 1.3), "an entry of the list special"),
        ((damped, flip, 1.2, 1.2), "both 1.2"),
        ((damped, flip, 1.2, "far"), "stop"),
        ((damped, flip, 1.21, 1.3), "as start the value of the other parameter"),
        ((nlvib_03, flip, 1.2, 1.3), "degrees of freedom|bod"),
        ((lambda value: damped(value, 1.2), flip, 1.2, 1.3), r"build\(value, other\): too many positional arguments"),
        ((lambda value, other: None, flip, 1.2, 1.3), r"build\(3.56647, 1.2\) returned None"),
    ]:
        with pytest.raises(ArgumentError, match=message):
            vf.locus(*arguments)
    special = branches[0].special[0]
    with pytest.raises(ArgumentError, match="'none'"):
        vf.locus(nlvib_03, vf.SpecialPoint("grazing", special.value, special.orbit, "none"), 0.1, 0.2)
    with pytest.raises(ArgumentError, match="no complex multipliers"):
        vf.locus(damped, vf.SpecialPoint("neimark_sacker", flip.value, flip.orbit), 1.2, 1.3)
    with pytest.raises(ArgumentError, match=r"no period_doubling: .* nearest to -1 is"):
        vf.locus(nlvib_03, vf.SpecialPoint("period_doubling", special.value, special.orbit), 0.1, 0.2)
    orbit = vf.periodic(damped(3.0, 1.2), method="harmonic_balance", harmonics=5)
    with pytest.raises(MethodError, match="harmonic balance"):
        vf.locus(damped, vf.SpecialPoint("period_doubling", 3.0, orbit), 1.2, 1.3)


@pytest.mark.parametrize("stop", ["rigid", "damped"])
def test_a_period_doubling_moves_with_the_load_where_impacts_lose_energy(stop):
    """With one gap all lengths grow with the load, so the locus is a straight line."""

    def build(gap, load):
        mass = vf.Mass(1.0, stiffness=1.0, damping=0.05, name="mass")
        wall = (
            vf.RigidStop(mass, gap=gap, restitution=0.7, side="above", name="wall")
            if stop == "rigid"
            else vf.Contact(
                mass, gap=gap, stiffness=200.0, damping=1.5, acts_on="penetration", side="above", name="wall"
            )
        )
        return vf.Scene([mass], [wall, vf.PointLoad(mass, vf.Sine(load, 2.6))])

    found = vf.continuation(lambda gap: build(gap, 1.0), 0.1, -0.1).special
    doubling = [point for point in found if point.kind == "period_doubling"][-1]
    locus = vf.locus(build, doubling, 1.0, 0.5)
    gaps, loads = locus.values.T
    assert loads[-1] == 0.5
    np.testing.assert_allclose(gaps, doubling.value * loads, rtol=1e-10)
    assert len(gaps) < 30


def test_two_period_doublings_of_a_damped_stop_meet():
    """Their common end is where the flips of branches under nearby loads merge, found by bisection of det(Phi + I)."""

    def build(omega, load):
        a, b = vf.Mass(1.0, name="a"), vf.Mass(1.0, stiffness=1.0, damping=0.03, name="b")
        stop = vf.Contact(a, gap=1.0, stiffness=100.0, damping=0.3, side="above", acts_on="penetration", name="stop")
        effects = [vf.Spring(a, b, stiffness=1.0), vf.Dashpot(a, b, damping=0.03), stop]
        return vf.Scene([a, b], [*effects, vf.PointLoad(b, vf.Sine(load, omega, phase=0.5 * np.pi))])

    found = vf.continuation(lambda omega: build(omega, 0.1), 0.8, 0.7).special
    for doubling in (point for point in found if point.kind == "period_doubling"):
        (turn,) = vf.locus(build, doubling, 0.1, 0.09).special
        assert (turn.kind, turn.value) == ("turn", pytest.approx(0.748299, abs=2e-6))
        assert turn.other == pytest.approx(0.0961421, abs=1e-7)


def test_a_fold_is_followed_from_a_stop_without_damper_to_a_damped_one():
    """The damper is the second parameter; a branch of the damped stop has its fold at the end of the locus."""

    def build(omega, damping):
        mass = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="mass")
        stop = vf.Contact(
            mass, gap=0.5, stiffness=20.0, damping=damping, side="above", acts_on="penetration", name="stop"
        )
        return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, omega))])

    ends = [vf.continuation(lambda omega, c=c: build(omega, c), 0.69, 0.75).special for c in (0.0, 0.5)]
    before, after = ([point for point in found if point.kind == "fold"] for found in ends)
    assert len(before) == len(after) == 2
    for one, other in zip(before, after, strict=True):
        there, back = vf.locus(build, one, 0.0, 0.5), vf.locus(build, other, 0.5, 0.0)
        np.testing.assert_allclose(there.values[-1], (other.value, 0.5), rtol=1e-9)
        np.testing.assert_allclose(back.values[-1], (one.value, 0.0), rtol=1e-9)


@pytest.mark.parametrize("stop", [2.58, 2.69, 2.72])
def test_a_grazing_is_followed_along_a_beam(stop):
    """The place of the stop is the second parameter; a motion without touches reaches the gap there."""

    def build(omega, place):
        beam = cantilever(name="beam")
        contact = vf.Contact(
            beam.at(place), gap=0.004, stiffness=60.0, side="below", acts_on="penetration", name="stop"
        )
        load = vf.PointLoad(beam.at("right"), vf.Sine(0.01, omega))
        return vf.Scene([beam], [contact, vf.ModalDamping(0.03), load])

    grazing = vf.continuation(lambda omega: build(omega, 0.7), 2.5, stop).special[0]
    assert grazing.kind == "grazing"
    locus = vf.locus(build, grazing, 0.7, 0.9)
    assert locus.special == []
    assert locus.values[-1, 1] == 0.9
    for omega, place in locus.values:
        scene = build(omega, place)
        response = vf.frequency_response(scene, [omega / (2.0 * np.pi)], loads="scene")
        assert abs(response.displacement(scene.bodies[0].at(place))[0]) == pytest.approx(0.004, rel=1e-11)


def test_a_locus_beside_a_stiff_stop():
    """Four masses and a stop 3e5 times as stiff: derivatives of the condition by a short difference are rounding."""
    case = drawn(2511)
    state = {
        "m0": (4.600124718, 29.009111797),
        "m1": (0.690654886, 36.525586603),
        "m2": (13.784923753, 43.748023412),
        "m3": (-0.076191156, 22.470794616),
    }
    guess = masses_at(state)

    def build(omega, share):
        scene = case.build(omega)
        load = scene.effects[-1]
        return scene.replace(load, **{"f.amplitude": share * load.f.amplitude})

    (fold,) = vf.continuation(lambda omega: build(omega, 1.0), 0.345904828, 0.3463, guess=guess).special
    assert fold.value == pytest.approx(0.346169748451, abs=1e-12)
    locus = vf.locus(build, fold, 1.0, 0.8)
    # A branch with this load, from the lower end of the population's interval, has its fold there.
    assert locus.values[-1] == pytest.approx([0.345153223458, 0.8], abs=1e-11)


def test_a_grazing_passes_a_switch_of_another_contact():
    """The touch without length comes before another contact closes, and later after it; a damper acts in it."""

    def chain(omega, load):
        a, b = vf.Mass(1.0, stiffness=1.0, damping=0.04, name="a"), vf.Mass(0.6, name="b")
        c = vf.Mass(0.7, stiffness=0.4, damping=0.02, name="c")
        law = {"acts_on": "penetration"}
        return vf.Scene(
            [a, b, c],
            [
                vf.Spring(a, b, stiffness=0.9),
                vf.Dashpot(a, b, damping=0.02),
                vf.Spring(b, c, stiffness=1.4),
                vf.Dashpot(b, c, damping=0.05),
                vf.Contact(a, b, gap=0.25, stiffness=8.0, damping=0.3, name="between", **law),
                vf.Contact(c, gap=0.5, stiffness=3.0, side="below", name="floor", **law),
                vf.PointLoad(b, vf.Sine(load, omega)),
                vf.PointLoad(c, vf.Constant(-0.15)),
                vf.PointLoad(a, vf.Sine(0.5 * load, 2.0 * omega, phase=0.7)),
            ],
        )

    def grazing(omega, start, stop):
        branch = vf.continuation(lambda load: chain(omega, load), start, stop)
        (found,) = [one for one in branch.special if one.kind == "grazing" and one.contact == "between"]
        return found

    first = grazing(1.3, 0.6, 0.65)
    after, pairs = [], []
    for end in (1.299, 1.31):
        locus = vf.locus(lambda load, omega: chain(omega, load), first, 1.3, end)
        load, omega = locus.values[-1]
        assert omega == end
        at = grazing(end, 0.98 * load, 1.02 * load)
        assert at.value == pytest.approx(load, rel=1e-12)
        run = at.orbit.result
        one, other = (run.displacement(mass) for mass in at.orbit.scene.bodies[:2])
        inner = (one - other)[1:-1]
        peaks = (inner > (one - other)[:-2]) & (inner > (one - other)[2:]) & (abs(inner - 0.25) < 1e-3)
        after.append(run.times[1:-1][peaks][0] > run.contacts["floor"].closings[0])
        # With the touch the equations of a damper are singular, and tell of no multipliers.
        pairs += [one for one in locus.special if one.kind == "neimark_sacker"]
    assert after == [False, True]
    (pair,) = pairs
    assert np.abs(pair.orbit.multipliers[:2]) == pytest.approx(1.0, abs=1e-9)
