"""What accuracy costs: studies of error against time, and the mesh that they need."""

import csv
import dataclasses
from itertools import count, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import paper_beam, two_masses

import vofem as vf
from vofem import cli
from vofem.cli import show_progress
from vofem.io import plot
from vofem.io.tables import study_table, write_study
from vofem.studies.accuracy.bench import Source, default_point
from vofem.studies.accuracy.exact import Question, exact
from vofem.studies.accuracy.quantities import Observed, compare
from vofem.studies.accuracy.scaled import scaled
from vofem.studies.accuracy.spread import spread
from vofem.studies.accuracy.work_precision import applicable
from vofem.studies.remesh import can_have, element_count, remeshed

QUICK = {"repeats": 1, "samples": 201, "cap": 1.0}
METHODS = ("event_driven", "energy_conserving", "generalized_alpha")


@pytest.fixture(scope="module")
def study():
    """The paper's beam under the penetration law over 5 s: one closed interval."""
    _, scene = paper_beam("penetration", elements=8)
    steps = [5.0 / 500, 5.0 / 1000, 5.0 / 2000]
    return vf.accuracy.work_precision(
        scene, 5.0, methods=("event_driven", "energy_conserving"), dt=steps, elements=(4, 8), **QUICK
    )


# -- errors -----------------------------------------------------------------------------------------


def observed(history, events=((), ()), impulse=(), energy=None):
    history = np.asarray(history, dtype=float)
    energy = np.ones(history.size) if energy is None else np.asarray(energy)
    return Observed(
        np.arange(history.size, dtype=float), history, tuple(map(np.array, events)), np.array(impulse), energy
    )


def test_errors_are_those_of_arithmetic():
    truth = observed([3.0, 4.0, 0.0], ([1.0], [2.0]), [2.0], [1.0, 2.0, 4.0])
    run = observed([3.0, 4.3, 0.4], ([1.1], [1.8]), [2.5], [1.0, 2.0, 3.0])
    errors = compare(run, truth, np.inf)
    assert errors.largest == pytest.approx(0.4)
    assert errors.rms == pytest.approx(np.sqrt(0.25 / 3))
    assert errors.events == pytest.approx(0.2)
    assert errors.impulse == pytest.approx(0.25)
    assert errors.energy == pytest.approx(0.25)
    assert errors.level == pytest.approx(abs(np.sqrt(9 + 4.3**2 + 0.16) - 5.0) / 5.0)


def test_beyond_the_horizon_only_means_are_compared():
    truth = observed([1.0, 1.0, 1.0], ([0.5, 2.0], [1.5]))
    run = observed([1.0, 1.1, 9.0], ([0.6], [1.5, 2.5]))
    errors = compare(run, truth, 1.7)
    assert errors.largest == pytest.approx(0.1)
    assert errors.events == pytest.approx(0.1)
    assert errors.level > 4.0
    assert compare(run, truth, 3.0).events == np.inf
    assert np.isnan(compare(observed([1.0]), observed([1.0]), 1.0).events)


# -- the study --------------------------------------------------------------------------------------


def test_errors_of_steps_mesh_and_rounding_are_told_apart(study):
    runs = {(run.setting.method, run.setting.elements, run.steps): run for run in study.runs}
    assert len(runs) == 8
    for n in (4, 8):
        exact_run = next(run for key, run in runs.items() if key[:2] == ("event_driven", n))
        assert exact_run.time.largest == 0.0
        assert exact_run.total.largest == pytest.approx(exact_run.space, rel=1e-9)
        assert exact_run.rounding < 1e-12
        for steps in (500, 1000, 2000):
            run = runs["energy_conserving", n, steps]
            assert run.space == exact_run.space
            assert run.total.largest <= run.time.largest + run.space + 1e-15
            assert run.counters["steps"] == run.steps
            assert run.seconds > 0.0
            assert run.work >= run.steps
    # Cubics: fourth order in the element length for the smooth part of the motion.
    space = {run.setting.elements: run.space for run in study.runs}
    assert 3.0 < np.log2(space[4] / space[8]) < 5.0
    assert study.reference.elements == 32
    assert 0.0 < study.reference.floor < 0.05 * space[8]


def test_observed_order_of_the_penetration_law_is_two(study):
    orders = [run.order for run in study.runs if np.isfinite(run.order)]
    assert len(orders) == 4
    assert all(1.6 < order < 2.4 for order in orders)


def test_frontier_and_advice(study):
    frontier = study.frontier()
    assert all(a.seconds <= b.seconds and a.total.largest > b.total.largest for a, b in pairwise(frontier))
    good = study.meeting(1e-4)
    assert good
    assert all(study.relative(run) <= 1e-4 for run in good)
    text = study.advice(1e-4)
    assert text.startswith("For an error of 0.0001 of the largest displacement at Beam 'beam' at x = 1 m, use ")
    assert text.count(".") >= 1
    assert text.endswith(".")
    assert study.advice(1e-14).startswith("No run comes within 1e-14")


def test_a_run_whose_errors_of_steps_and_mesh_cancel_is_not_advised(study):
    """By chance its total error is a hundredth of that of its steps; a tolerance between both is not met."""
    scale = study.reference.scale
    run = max((run for run in study.runs if run.setting.method == "energy_conserving"), key=lambda run: run.steps)
    lucky = dataclasses.replace(
        run,
        total=dataclasses.replace(run.total, largest=1e-5 * scale),
        time=dataclasses.replace(run.time, largest=1e-3 * scale),
        space=1e-3 * scale,
    )
    alone = dataclasses.replace(study, runs=(lucky,))
    assert alone.relative(lucky) == pytest.approx(1e-5)
    assert alone.meeting(1e-4) == ()
    assert alone.advice(1e-4).startswith("No run comes within 0.0001")
    assert " with 1.0e-03 in " in alone.advice(1e-4)
    assert alone.meeting(1e-2) == (lucky,)


def test_what_cannot_run_is_left_out_with_its_reason():
    _, scene = paper_beam("penetration", elements=4)
    study = vf.accuracy.work_precision(
        scene, 1.0, methods=["central_difference", "energy_conserving"], dt=[0.01, 1e-8], elements=[4], **QUICK
    )
    assert [run.setting.method for run in study.runs] == ["energy_conserving"]
    reasons = {(out.setting.method, out.setting.dt): out.why for out in study.left_out}
    assert reasons["central_difference", 0.01].startswith("StepSizeError: dt is 0.01 s, beyond the critical step")
    assert "the cap is 1 s" in reasons["energy_conserving", 1e-8]
    assert "left out" in study_table(study).lower()


def test_methods_that_are_tried_are_those_that_apply():
    mass = vf.Mass(1.0, damping=1.0)
    load = vf.PointLoad(mass, vf.Ramp(1.0))
    printed = vf.HystereticSpring(mass, stiffness=1.0, linear_limit=5.0, memory="printed")
    cyclic = vf.HystereticSpring(mass, stiffness=1.0, linear_limit=5.0, memory="cyclic")
    steps = ["energy_conserving", "generalized_alpha", "central_difference"]
    for effects, expected in (([], ["event_driven", *steps]), ([printed], ["force_driven"]), ([cyclic], steps)):
        assert applicable(Source(vf.Scene([mass], [*effects, load]), None), None) == expected


def test_masses_have_no_mesh_and_tolerances_are_taken():
    *_, scene = two_masses("c", "penetration")
    study = vf.accuracy.work_precision(scene, 20.0, methods=["event_driven", "energy_conserving"], dt=[0.01],
                                       tol=[1e-2, 1e-3], **(QUICK | {"cap": 60.0}))  # fmt: skip
    assert [(r.setting.elements, r.setting.tol) for r in study.runs] == [(0, None), (0, None), (0, 1e-2), (0, 1e-3)]
    assert all(run.space == 0.0 for run in study.runs)
    assert study.runs[3].total.largest < study.runs[2].total.largest
    assert study.floor < 1e-12


def test_without_a_closed_form_steps_that_are_halved_make_the_reference():
    ball = vf.Mass(1.0, stiffness=1.0, name="ball")
    stop = vf.Contact(ball, gap=0.5, stiffness=10.0, side="above", acts_on="penetration", switch=vf.Resolved(50.0))
    scene = vf.Scene([ball], [stop], initial={ball: (0.0, 1.0)})
    study = vf.accuracy.work_precision(scene, 5.0, methods=["energy_conserving"], dt=[0.02, 0.01], **QUICK)
    assert "checked by Richardson's rule" in study.reference.how
    assert 0.0 < study.floor < 1e-6
    assert 1.7 < study.runs[1].order < 2.3


def test_a_reference_of_which_finer_steps_fail_is_the_finest_and_says_so():
    """A spring that is finite for a number of calls lets two of the runs end, or the first one alone."""

    def study(most):
        calls = count()
        mass = vf.Mass(1.0)
        spring = vf.NonlinearSpring(
            mass,
            potential=lambda u: 0.5 * u**2 + 0.25 * u**4,
            force=lambda u: u + u**3 if next(calls) < most else float("nan"),
        )
        scene = vf.Scene([mass], [spring], initial={mass: (0.0, 1.0)})
        return vf.accuracy.work_precision(scene, 1.0, methods=["energy_conserving"], dt=[0.1], **QUICK | {"cap": 1e3})

    how = study(150_000).reference.how
    assert how.startswith("energy_conserving, 4000 steps, checked by the difference to half as many (8000 steps fail: ")
    assert "returned nan" in how
    with pytest.raises(vf.InstabilityError, match="returned nan"):
        study(50_000)


def test_a_function_builds_the_scenes():
    asked = []

    def build(elements):
        asked.append(elements)
        return paper_beam("penetration", elements=elements)[1]

    study = vf.accuracy.work_precision(build, 1.0, methods=["event_driven"], elements=[4], **QUICK)
    assert sorted(set(asked)) == [4, 8, 16]
    assert study.runs[0].setting.elements == 4


def test_a_chaotic_scene_is_compared_up_to_its_horizon():
    _, scene = paper_beam("penetration", elements=6, stiffness=1e6)
    study = vf.accuracy.work_precision(scene, 8.0, methods=["event_driven"], elements=[6], **QUICK)
    assert 3.8 < study.reference.horizon < 8.0
    assert "the scene is chaotic" in study.advice()
    assert "Chaotic" in study_table(study)


def test_cheapest_meets_the_tolerance_with_the_smallest_mesh_that_can():
    _, scene = paper_beam("penetration", elements=8)
    found = vf.accuracy.cheapest(scene, 5.0, 1e-4, methods=METHODS, **QUICK)
    assert found.run is not None
    assert found.study.relative(found.run) <= 1e-4
    assert found.run.seconds == min(run.seconds for run in found.study.meeting(1e-4))
    assert str(found).startswith("For an error of 0.0001 of the largest displacement")
    none = vf.accuracy.cheapest(scene, 1.0, 1e-13, methods=["energy_conserving"], elements=[2], **QUICK)
    assert none.run is None
    assert str(none).startswith("No run comes within 1e-13")
    counts = f"{len(none.study.runs)} runs, {len(none.study.left_out)} left out"
    assert repr(none) == f"Cheapest(no run, tolerance=1e-13, Study({none.study.point} over 1 s, {counts}))"
    assert repr(found).startswith(f"Cheapest({found.run.setting} on {found.run.setting.elements} elements, ")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t_end": -1.0}, "t_end is -1.0, expected a positive number"),
        ({"methods": ["event_drven"]}, "did you mean 'event_driven'"),
        ({"methods": []}, "methods is empty"),
        ({"elements": []}, "elements is empty"),
        ({"elements": [2.5]}, "elements is 2.5, expected a whole number"),
        ({"repeats": 0}, "repeats is 0"),
        ({"samples": 1}, "samples is 1, expected a whole number, 2 or more"),
        ({"scene": "beam"}, "scene is 'beam', expected a vofem.Scene"),
        ({"scene": lambda n: None}, "elements is missing"),
    ],
)
def test_wrong_arguments_are_named(changes, message):
    _, scene = paper_beam("penetration", elements=2)
    arguments = {"scene": scene, "t_end": 1.0, **changes}
    with pytest.raises(vf.ArgumentError, match=message):
        vf.accuracy.work_precision(**arguments)


# -- its parts --------------------------------------------------------------------------------------


def test_scaled_equations_have_the_same_solution_and_other_rounding():
    _, scene = paper_beam("displacement", elements=8, extra=(vf.RayleighDamping(0.1, 1e-4),))
    other = scaled(scene)
    t = np.linspace(0.0, 8.0, 101)
    for method in ("event_driven", "energy_conserving", "generalized_alpha"):
        tips = [vf.simulate(s, 8.0, method=method, times=t).displacement(scene.contacts[0].a) for s in (scene, other)]
        assert 0.0 < np.max(np.abs(tips[0] - tips[1])) < 1e-11
    assert scene.model.system.contacts.stiffness[0] == 1.0


def test_the_estimated_error_of_the_reference_covers_the_true_one():
    _, coarse = paper_beam("penetration", elements=6)
    beam, fine = paper_beam("penetration", elements=48)
    study = vf.accuracy.work_precision(coarse, 5.0, methods=["event_driven"], elements=[6], **QUICK)
    question = Question(5.0, np.linspace(0.0, 5.0, 201), beam.at(1.0), 1.0)
    truth = exact(fine, question).observed.history
    own = exact(remeshed(coarse, 24), question).observed.history
    assert np.max(np.abs(own - truth)) < study.reference.floor


def test_default_point_is_the_contact_s_or_the_one_that_moves_most():
    beam, scene = paper_beam("penetration", elements=4)
    assert default_point(scene, 1.0) is scene.contacts[0].a
    still = vf.Mass(1.0, stiffness=1.0)
    bare = vf.Scene([still, beam], [vf.PointLoad(beam.at(1.0), 1.0)])
    point = default_point(bare, 1.0)
    assert (point.body, point.x) == (beam, 1.0)


def test_work_is_spread_over_processes_or_done_here():
    assert sorted(spread(divmod, [(7, 2), (9, 4)], 2)) == [(0, (3, 1)), (1, (2, 1))]
    assert sorted(spread(lambda f, x: f(x), [(lambda x: 2 * x, 1), (abs, -3)], 2)) == [(0, 2), (1, 3)]


# -- other meshes -----------------------------------------------------------------------------------


def motion(scene, point, t_end=2.0):
    return vf.simulate(scene, t_end, times=np.linspace(0.0, t_end, 51)).displacement(point)


def test_a_scene_on_another_mesh_is_the_one_built_so():
    beam, scene = paper_beam("displacement", elements=6, extra=(vf.RayleighDamping(0.1, 1e-4),))
    _, built = paper_beam("displacement", elements=15, extra=(vf.RayleighDamping(0.1, 1e-4),))
    again = remeshed(scene, 15)
    assert element_count(again) == 15
    assert remeshed(scene, 6) is scene
    np.testing.assert_array_equal(motion(again, beam.at(0.4)), motion(built, beam.at(0.4)))


def test_effects_coefficients_supports_and_states_move_along():
    beam = vf.Beam(
        2.0, [1.0, 2.0, 3.0], 1.0, [0.0, 0.5, 1.5, 2.0], {0.0: "pinned", 1.5: "pinned"}, tension=0.3, name="b"
    )
    ball = vf.Mass(0.5, stiffness=2.0, name="m")
    effects = [
        vf.Contact(ball, beam.at(0.7), gap=0.01, stiffness=20.0, acts_on="penetration", name="c"),
        vf.Foundation(beam, stiffness=lambda x: 1.0 + x), vf.DistributedLoad(beam, 0.1), vf.Gravity(0.2),
        vf.Spring(beam.at(1.0), ball, stiffness=1.0), vf.PointMass(beam.at(0.7), mass=0.1),
        vf.BaseMotion(ball, 0.1), vf.BaseMotion(beam, 0.1),
    ]  # fmt: skip
    scene = vf.Scene([beam, ball], effects, initial={ball: (0.0, 1.0), beam: (lambda x: 0.01 * x * (x - 1.5), 0.0)})
    fine, finer = remeshed(scene, 9), remeshed(scene, 18)
    new = fine.bodies[0]
    assert (new.name, new.tension, element_count(fine)) == ("b", 0.3, 9)
    np.testing.assert_allclose(new.nodes, [0, 1 / 6, 1 / 3, 0.5, 5 / 6, 7 / 6, 1.5, 5 / 3, 11 / 6, 2.0], atol=1e-15)
    np.testing.assert_array_equal(new.EI, np.repeat([1.0, 2.0, 3.0], 3))
    assert all(point.body in fine.bodies for effect in fine.effects for point in effect.points())
    histories = [motion(s, beam.at(1.0), 1.0) for s in (scene, fine, finer)]
    coarse_error, error = (np.max(np.abs(h - histories[2])) for h in histories[:2])
    assert error < 0.05 * coarse_error
    # From a state of the first mesh on the second, a nested one: the same field.
    state = vf.simulate(scene, 0.3)
    restarted = remeshed(vf.Scene([beam, ball], effects, initial=state), 9)
    q0 = restarted.initial_state().q
    both = [vf.simulate(s, 0.1, times=[0.0]) for s in (restarted, vf.Scene([beam, ball], effects, initial=state))]
    np.testing.assert_allclose(
        both[0].deflection([0.1, 0.7, 1.9], body="b"), both[1].deflection([0.1, 0.7, 1.9], body="b"), atol=1e-12
    )
    assert np.all(np.isfinite(q0))


def test_meshes_that_a_scene_cannot_have_are_refused():
    beam = vf.Beam(1.0, 1.0, 1.0, 6, {"left": "pinned", 0.5: "pinned"}, name="b")
    graded = vf.Beam(1.0, 1.0, 1.0, [0.0, 0.2, 1.0], {"left": "clamped"})
    assert can_have(vf.Scene([beam]), 10)
    assert not can_have(vf.Scene([beam]), 7)
    with pytest.raises(vf.ArgumentError, match=r"Beam 'b' with 7 elements would have no node at a support"):
        remeshed(vf.Scene([beam]), 7)
    with pytest.raises(vf.ArgumentError, match="can have a multiple of 2, not 3"):
        remeshed(vf.Scene([graded]), 3)
    with pytest.raises(vf.ArgumentError, match="cannot be shared"):
        remeshed(vf.Scene([beam, graded]), 9)
    with pytest.raises(vf.ArgumentError, match="has no beam"):
        remeshed(vf.Scene([vf.Mass(1.0)]), 4)
    with pytest.raises(vf.ArgumentError, match="expected a whole number, 1 or more"):
        remeshed(vf.Scene([beam]), 0)


@settings(deadline=None, max_examples=20)
@given(counts=st.lists(st.integers(1, 5), min_size=1, max_size=3), factor=st.integers(1, 4))
def test_meshes_share_elements_in_proportion(counts, factor):
    beams = [vf.Beam(1.0, 1.0, 1.0, n, {"left": "clamped"}, name=f"b{k}") for k, n in enumerate(counts)]
    new = remeshed(vf.Scene(beams), factor * sum(counts))
    assert [beam.element_lengths.size for beam in new.bodies] == [factor * n for n in counts]


# -- what is written --------------------------------------------------------------------------------


def test_table_csv_and_figure(study, tmp_path):
    text = study_table(study)
    assert "Reference: event_driven on 32 elements, known to" in text
    assert "energy_conserving, dt = 0.005 s" in text
    path = write_study(study, tmp_path / "s.csv")
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(study.runs)
    assert float(rows[0]["largest_error"]) == study.runs[0].total.largest
    assert int(rows[3]["steps"]) == study.runs[3].steps
    for kind in ("png", "svg"):
        assert plot.work_precision(study, tmp_path / f"s.{kind}", "a title").stat().st_size > 10_000


def test_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    _, scene = paper_beam("penetration", elements=3)
    vf.dump_scene(scene, "s.toml")
    command = ["accuracy", "s.toml", "--methods", "event_driven", "--elements", "3", "--repeats", "1"]
    assert cli.main(command) == cli.FAULT
    assert "add t_end to a table [run], or give --t-end" in capsys.readouterr().err
    assert cli.main([*command, "--t-end", "1", "--point", "beam@0.5", "--error", "1e-3"]) == cli.FINE
    said = capsys.readouterr()
    assert "0.001 of the largest displacement" in said.out
    assert "Displacement of Beam 'beam' at x = 0.5 m over 1 s" in said.out
    assert said.err == ""
    assert sorted(p.name for p in (tmp_path / "output" / "s").iterdir()) == [
        "accuracy.csv", "accuracy.png", "accuracy.svg",
    ]  # fmt: skip
    assert cli.main([*command, "--t-end", "1", "--point", "bean@0.5"]) == cli.FAULT
    assert "did you mean 'beam'" in capsys.readouterr().err


def test_progress_goes_to_a_terminal_only(capsys):
    show_progress(1, 2, "event_driven")
    assert capsys.readouterr().err == "\r\x1b[K1 of 2  event_driven"
