"""Some scenes of the population whose branches are quick: they arrive, repeat, and list the same points both ways."""

import json
import re
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from orbit_scenes import masses_at
from populations import REPEATS, SAME, Outcome, away, both_ways, differing, drawn, end_of, followed, varied

import vofem as vf

#: A chain of four masses and a simply supported beam; a chain of two between mirrored stops whose forces jump, and a
#: propped beam with three special points beside a grazing; a beam whose touches become infinitely many and turn into
#: rests at the gap; a beam with a pair of Neimark-Sacker points very close behind a grazing.
#: `python tests/populations.py` follows any others.
SEEDS = (0, 7, 216, 215, 301, 313)

#: With a rigid stop and an elastic one; with both between bodies, and two loads; with a rigid stop and a dashpot.
VARIED = (64, 51, 5)


def stored(name):
    """Return the value of the parameter at which a branch begins, and a guess of its orbit there."""
    known = json.loads((Path(__file__).parent / f"data/orbits/{name}.json").read_text())
    state = np.array(known["displacement"]), np.array(known["velocity"])
    return known["value"], SimpleNamespace(state_of=lambda _: state)


@pytest.mark.parametrize(("draw", "seed"), [*((drawn, seed) for seed in SEEDS), *((varied, seed) for seed in VARIED)])
def test_a_branch_of_the_population(draw, seed):
    case = draw(seed)
    found = both_ways(case)
    assert [one.end for one in found] == ["other end"] * 2
    assert max(found[0].away + found[1].away) <= REPEATS
    assert differing(case, *found) <= SAME
    assert found[0].special


def test_a_turn_beside_a_grazing_is_not_stepped_over():
    """A fold and a Neimark-Sacker point lie a millionth of a step beside the grazing of a stiff stop."""
    case = drawn(330)
    there = vf.continuation(case.build, 0.262, 0.264)
    back = vf.continuation(case.build, 0.262, 0.264, guess=there.orbits[-1])
    assert [one.kind for one in there.special] == ["grazing", "neimark_sacker", "fold"]
    assert [one.kind for one in back.special] == ["fold", "neimark_sacker", "grazing"]
    values = [[one.value for one in branch.special] for branch in (there, back)]
    assert values[0] == pytest.approx(values[1][::-1], rel=SAME)


def test_a_pair_that_leaves_the_circle_and_returns_beside_a_grazing():
    """It is back before the next orbit of the branch, within a millionth of a step from the grazing."""
    case = drawn(214)
    branch = vf.continuation(case.build, 2140.0, 2141.0)
    assert [one.kind for one in branch.special] == ["grazing", "neimark_sacker", "neimark_sacker", "period_doubling"]
    found = [one.value for one in branch.special[1:]]
    assert found == pytest.approx([2140.7938393217814, 2140.7938393484997, 2140.793839351629], abs=1e-8)


def test_a_step_does_not_lead_to_another_branch():
    """Two branches come near to each other; a walk that changes over comes back along its own orbits."""
    case = drawn(2214)
    branch = vf.continuation(case.build, case.start, 0.34)
    assert branch.values[-1] == 0.34
    assert not branch.notes


def test_a_stiff_contact_opens_within_few_samples_of_a_switch():
    """The opening has a few thousandths of a radian, and beyond its grazing the branch bends within a millionth."""
    case = drawn(114)
    up, down = (vf.continuation(case.build, *ends) for ends in ((99.55, 99.65), (99.65, 99.55)))
    for branch, end in ((up, 99.65), (down, 99.55)):
        assert branch.values[-1] == end
        assert [one.kind for one in branch.special] == ["grazing"]
        assert max(away(orbit) for orbit in branch.orbits[::6]) <= REPEATS
    assert up.special[0].value == pytest.approx(down.special[0].value, rel=1e-10)


def test_a_touch_begins_at_the_phase_at_which_the_state_is_an_unknown():
    """The extreme of the gap is there before, so that the touch of the orbit just beyond begins behind that phase."""
    case = drawn(2029)
    known = {
        "m0": (-0.008894158, -0.01695332), "m1": (-0.05330963, -0.027429), "m2": (-0.08931829, -0.02146807),
        "m3": (-0.1087522, -0.02048951),
    }  # fmt: skip
    guess = masses_at(known)
    branch = vf.continuation(case.build, 0.391594, 0.3938, guess=guess)
    assert branch.values[-1] == 0.3938
    assert [(one.kind, one.contact) for one in branch.special] == [("grazing", "one"), ("grazing", "two")]


@pytest.mark.parametrize("stop", [0.25222, 0.252215])
def test_special_points_beside_a_grazing_are_listed_or_told(stop):
    """A pair and a real multiplier pass the circle within 2e-13 rad/s from a grazing of two stops at once."""
    case = drawn(19)
    known = {
        "m0": (-0.01968523, 0.004468025), "m1": (-0.02536175, 0.007850386), "m2": (-0.02755963, 0.01107605),
        "m3": (-0.029393, 0.01297039), "m4": (-0.03053302, 0.01324946),
    }  # fmt: skip
    guess = masses_at(known)
    branch = vf.continuation(case.build, 0.2522, stop, guess=guess)
    found = Counter(one.kind for one in branch.special)
    told = any(
        "special points just beyond the grazing at 0.252214131112 may be missing" in note for note in branch.notes
    )
    assert found == ({"grazing": 2} if told else {"grazing": 2, "neimark_sacker": 1, "branch_point": 1})
    assert [sum(abs(branch.orbits[k].multipliers) > 1.0) for k in (0, -1)] == [0, 3]


def test_a_lost_branch_tells_what_its_contacts_do():
    """A beam touches a stop whose force jumps ever more often, for ever shorter times, and a run lets it rest there."""
    case = drawn(338)
    found = followed(case, case.stop, case.start)
    assert found.end == "lost"
    assert found.reason.startswith("the branch was lost at 522.34")
    assert "the run lets 'two' rest at the gap where touches are lower than 1e-07 of it" in found.reason
    assert re.search("the orbit there has [3-9] touches at 'two', the shortest for [0-9.e-]+ rad", found.reason)
    assert found.reason.count("where a force jumps they may become infinitely many") == 1
    assert "guess=" in found.reason


def test_stiff_stops_do_not_bend_the_direction_of_a_branch():
    """Two stops magnify errors of the derivative by the parameter, which gives the direction, by a factor of 6e6."""
    case = drawn(2199)
    known = {
        "m0": (-0.06850376305727592, -0.01572870348570862), "m1": (-0.08352292067471451, -0.016715514009340588),
        "m2": (-0.1089976733698062, -0.026633096034410608), "m3": (-0.10781146654362485, -0.03687772978568574),
        "m4": (-0.10380219578557094, -0.045212692212214974),
    }  # fmt: skip
    guess = masses_at(known)
    branch = vf.continuation(case.build, 0.22618351218760765, case.start, guess=guess, max_points=60)
    assert branch.values[-1] == branch.values[0]
    assert [one.kind for one in branch.special] == ["fold", "grazing", "grazing"]
    assert branch.special[0].value == pytest.approx(0.226135437811, rel=1e-10)


def test_rounding_of_very_unstable_orbits_does_not_end_a_branch():
    """A beam hits a stiff stop seven times; the last digit of its state becomes a billionth of the motion."""
    case, value = drawn(346), 209.98456209320167
    state = (
        [0.0, 0.0, -420.5381291636403, -3.140739825149018, -972.0498277947175, 0.0],
        [0.0, 0.0, -27779.277987548536, -979.7928697414865, -78102.98828313485, 0.0],
    )
    guess = SimpleNamespace(state_of=lambda _: tuple(map(np.array, state)))
    branch = vf.continuation(case.build, value, value + 1e-3, guess=guess)
    # The walk arrives, though runs repeat only some of its orbits from t = 0.
    assert f"and {value + 1e-3:.9g}: an ordinary run over one period, which magnifies rounding" in branch.notes[0]
    assert len(branch) > 2
    assert max(map(away, branch.orbits)) <= REPEATS


def test_a_rounded_parameter_does_not_end_a_branch():
    """Beyond a fold beside a double grazing, rounding of the parameter alone changes an orbit by 1e-9 of its motion."""
    case = drawn(149)
    branch = vf.continuation(case.build, case.start, case.stop, max_points=135)
    assert "followed for 135 points" in branch.notes[-1]
    assert any(s.kind == "fold" and s.value == pytest.approx(987.28508498, abs=1e-8) for s in branch.special)
    assert abs(branch.values[-1] - 987.285084) > 1e-3
    assert max(map(away, branch.orbits[-20:])) <= REPEATS


def test_a_symmetric_orbit_touches_both_stops_at_once():
    """Rounding parts its two halves by 1e-12; with one touch alone the branch would go on as one of other orbits."""
    case = drawn(149)
    branch = vf.continuation(case.build, case.stop, case.start, max_points=105)
    assert "followed for 105 points" in branch.notes[-1]
    both = [s for s in branch.special if s.kind == "grazing" and s.value == pytest.approx(1014.6913603, abs=1e-6)]
    assert [s.contact for s in both] == ["one", "two"]
    orbit = branch.orbits[-1]
    one, two = (orbit.result.contacts[name].closings for name in ("one", "two"))
    assert one.size == 3
    assert np.sort((one + 0.5 * orbit.period) % orbit.period) == pytest.approx(two, abs=1e-6 * orbit.period)


def test_a_branch_bends_beside_a_grazing():
    """Touches of 1e-7 rad decide there whether the length or the parameter grows, and this is less than rounding."""
    case = drawn(167)
    start, guess = stored("stiff_cantilever")
    branch = vf.continuation(case.build, start, start - 0.01, guess=guess, max_points=46)
    found = [s.value for s in branch.special if s.kind == "grazing"]
    # The first two bound a touch that lasts for 6e-6 rad/s only; between them an ordinary run has one closing more.
    assert found[:4] == pytest.approx([263.730838708, 263.730833178, 263.73025888, 263.728734106], abs=1e-7)
    within, beyond = (
        vf.periodic(case.build(at), guess=branch.orbits[k]) for at, k in ((263.730836, 7), (263.7308, 22))
    )
    assert [len(one.result.contacts["one"].closings) for one in (within, beyond)] == [8, 7]
    assert "followed for 46 points" in branch.notes[-1]
    assert branch.values[-1] < 263.7286
    assert max(map(away, branch.orbits[-4:])) <= REPEATS


@pytest.mark.parametrize("stop", [107.13, 107.2])
def test_ripples_of_a_stiff_stop_do_not_hide_touches(stop):
    """One ripple after another passes the switch, each by a touch that begins and ends within 1e-3 or 2e-5 rad/s."""
    case = drawn(114)
    start, guess = stored("rippling_stop")
    branch = vf.continuation(case.build, start, stop, guess=guess, max_step=0.02)
    expected = [107.066196957, 107.067571832, 107.122974827, 107.122996572]
    assert [s.kind for s in branch.special] == ["grazing"] * 4
    assert [s.value for s in branch.special] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("ends", [(1101.55, 1101.72), (1101.72, 1101.55)])
def test_special_points_beside_touches_that_turn_into_a_rest(ends):
    """Where a contact begins to rest at its gap no orbit repeats; the next one beyond is found on both sides.

    A longer step over this place would miss a touch that begins 1e-3 rad/s beyond, and its period doubling.
    """
    branch = vf.continuation(drawn(2451).build, *ends)
    found = sorted((s.value, s.kind) for s in branch.special)
    assert branch.values[-1] == ends[1]
    assert [kind for _, kind in found] == ["grazing", "period_doubling"] * 2
    expected = [1101.5875454096, 1101.5878778365, 1101.6675031546, 1101.6676130866]
    assert [value for value, _ in found] == pytest.approx(expected, abs=1e-8)
    (note,) = [note for note in branch.notes if "turn into a rest" in note]
    first, last, widest = map(float, re.search(r"between (\S+) and (\S+) .* of at most (\S+)\. No", note).groups())
    assert 1101.58 < first < last < 1101.68
    assert 0.0 < widest < 0.01


def test_a_step_from_a_grazing_does_not_find_it_again():
    """The contact leaves its gap and comes back within the step; from the grazing the branch would go back."""
    case = drawn(89)
    branch = vf.continuation(case.build, case.start, case.stop, max_points=95)
    assert sum(s.kind == "grazing" and abs(s.value - 307.629964278) < 1e-6 for s in branch.special) == 1
    assert branch.values[-1] > 307.65


def test_orbits_that_no_run_repeats_are_passed_and_left_out():
    """A branch turns at the grazing of a stop whose force jumps, where multipliers grow beyond 1e8."""
    case = drawn(212)
    branch = vf.continuation(case.build, case.stop, case.start)
    assert branch.values[-1] == case.stop
    assert min(point.value for point in branch.special) == pytest.approx(414.97376315)
    assert max(map(away, branch.orbits)) <= REPEATS
    assert branch.counters.points == len(branch) == branch.values.size
    [told] = [note for note in branch.notes if "are left out" in note]
    low, high = map(float, re.search("between ([0-9.]+) and ([0-9.]+):", told).groups())
    # Special points keep their places among the orbits that are left.
    for point in branch.special:
        ends = branch.values[[int(np.floor(point.place)), min(int(np.ceil(point.place)), len(branch) - 1)]]
        assert min(*ends, 414.9737) <= point.value <= max(ends)
    # Beside them the other part of the branch, beyond its turn, has orbits that repeat.
    found = branch.at(0.5 * (low + high))
    assert len(found) == 1
    assert away(found[0]) <= REPEATS
    guess = max(branch.orbits, key=lambda one: np.abs(one.multipliers).max())
    orbit = vf.periodic(case.build(415.2), guess=guess)
    assert any("magnifies rounding" in note for note in orbit.notes)


def test_a_start_is_found_from_smaller_loads():
    """Motions settle on twice the period, and Newton's method finds no orbit from the linear response."""
    case = drawn(329)
    orbit = vf.periodic(case.build(case.stop))
    assert any("found from smaller loads" in note for note in orbit.notes)
    assert orbit.stable is False
    assert away(orbit) <= REPEATS
    assert orbit.amplitude(case.build(case.stop).bodies[0]) > 0.0


def test_a_seed_gives_the_same_scene_again():
    one, other = drawn(14), drawn(14)
    assert (one.title, one.start, one.stop) == (other.title, other.start, other.stop)
    described = [[effect.describe() for effect in case.build(5.0).effects] for case in (one, other)]
    assert described[0] == described[1]


def test_what_a_population_calls_false_and_different():
    """The checks themselves: an orbit that is none, an unequal list, a limit of time."""
    case = drawn(0)
    orbit = vf.periodic(case.build(case.start))
    assert away(orbit) < 1e-12
    orbit.start.q[0] *= 1.01
    assert away(orbit) > 1e-4
    size = max(case.start, case.stop)
    one, other = (Outcome("other end", special=[("fold", value)]) for value in (1.0, 1.0 + 1e-6))
    assert differing(case, one, other) == pytest.approx(1e-6 / size)
    assert differing(case, one, Outcome("other end", special=[("grazing", 1.0)])) == np.inf
    assert followed(case, case.start, case.stop, patience=0.05).end == "limit"
    branch = vf.continuation(case.build, case.start, case.stop, max_points=3)
    assert end_of(branch, case.start, case.stop)[0] == "limit"
