"""Ceilings on counted work for the standard scenes: a regression of speed that no noise of a machine can hide."""

import sys
from pathlib import Path

import numpy as np
import pytest
from orbit_scenes import nlvib_03
from scenes import paper_beam, two_masses

import vofem as vf
from vofem.integrators.event_driven import pieces, regime

BENCHMARKS = Path(__file__).parent.parent / "benchmarks"


def counters(scene, t_end, **options):
    return vf.simulate(scene, t_end, times=[0.0, t_end], **options).counters


@pytest.mark.parametrize(
    ("law", "stiffness", "events", "looks"),
    [("penetration", 1.0, 10, 200), ("displacement", 1.0, 12, 260), ("penetration", 1e4, 60, 1500)],
)
def test_events_of_the_beam(law, stiffness, events, looks):
    _, scene = paper_beam(law, stiffness=stiffness)
    found = counters(scene, 20.0)
    assert (found.events, found.steps, found.statuses) == (events, events + 1, 2)
    assert (found.eigensolves, found.rank_one_updates, found.factorizations) == (1, 1, 0)
    assert found.gap_evaluations <= looks
    assert found.load_evaluations == 0


@pytest.mark.parametrize(("case", "events"), [("a", 0), ("b", 21), ("c", 26)])
def test_events_of_the_masses(case, events):
    *_, scene = two_masses(case, "penetration")
    found = counters(scene, 100.0)
    assert (found.events, found.steps) == (events, events + 1)
    assert found.gap_evaluations <= 25 * found.steps


@pytest.mark.parametrize("method", ["energy_conserving", "generalized_alpha", "central_difference"])
def test_steps_factor_once_and_solve_contacts_only_where_one_may_close(method):
    _, scene = paper_beam("penetration", elements=5)
    t_end, dt = 20.0, 1e-3
    found = counters(scene, t_end, method=method, dt=dt)
    assert found.steps == 20_000
    assert found.factorizations <= 2
    assert found.rejected == 0
    assert found.damping_evaluations == 0
    assert found.gap_evaluations <= 2.5 * found.steps
    assert found.load_evaluations <= found.steps + 10
    # Closed for less than a fifth of the time.
    assert found.contact_solves <= 0.4 * found.steps


def test_steps_that_follow_a_tolerance_grow_like_its_root():
    _, scene = paper_beam("penetration", elements=5)
    steps = [counters(scene, 5.0, method="energy_conserving", tol=tol).steps for tol in (1e-2, 1e-4)]
    assert steps[1] <= 20 * steps[0]
    assert steps[1] <= 20_000


def test_large_beams_take_few_vectors():
    _, scene = paper_beam("penetration", elements=1000)
    result = vf.simulate(scene, 20.0)
    assert result.truncation.vectors <= 64
    assert result.counters.gap_evaluations <= 400


def test_ten_contacts_take_one_eigenproblem(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from cases import many_contacts

    found = counters(many_contacts(25, 10), 20.0)
    assert found.eigensolves == 1
    assert found.rank_one_updates <= found.statuses
    assert found.gap_evaluations <= 10 * 15 * found.steps
    sys.modules.pop("cases", None)


def test_benchmarks_measure_what_they_say(monkeypatch):
    """The scenes and tables of the benchmarks, without their timings."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import cases
    import side_by_side
    from peers.problem import problem

    case = problem(4)
    assert case.mass[case.tip, case.tip] > 0.0
    own = vf.simulate(case.scene, 20.0, times=case.times).displacement(case.scene.contacts[0].a)
    np.testing.assert_allclose(case.reference(), own, rtol=0.0, atol=1e-12)
    system = cases.chain(6, 2)
    assert np.linalg.eigvalsh(system.stiffness.toarray())[0] > 0.0
    ours = side_by_side.Measured("vofem event_driven", True, [{}], [0.01], [1e-13])
    peer = side_by_side.Measured("peer", False, [{}, {}], [0.1, 1.0], [1e-3, 1e-5])
    assert peer.time_to(1e-4) == (pytest.approx(10**-0.5), False)
    assert peer.time_to(1e-7) == (pytest.approx(10.0), True)
    assert peer.time_to(1e-2) == (0.1, False)
    table = side_by_side.ratio_table([ours, peer])
    assert "| peer | 100 ms (10 times) | ~3.16 s (~316 times) | ~100 s (~10000 times) |" in table
    absent = side_by_side.Measured("absent", False, missing="it is not installed")
    assert side_by_side.missing_lines([peer, absent]) == "- left out: absent: it is not installed"


@pytest.mark.parametrize("name", ["numpy_newmark", "scipy_radau", "scipy_dop853"])
def test_peers_solve_the_same_problem(name, monkeypatch):
    """On a coarse mesh, where all are fast, each comes as near as its method allows."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from dataclasses import replace
    from importlib import import_module

    from peers.problem import problem

    case = problem(1)
    case = replace(case, t_end=6.0, times=np.linspace(0.0, 6.0, 301))
    peer = import_module(f"peers.{name}")
    assert peer.missing() is None
    level = {"numpy_newmark": {"dt": 2e-3}, "scipy_radau": {"rtol": 1e-7}, "scipy_dop853": {"rtol": 1e-10}}[name]
    seconds, history = peer.run(case, peer.prepare(case), level)
    allowed = {"numpy_newmark": 1e-4, "scipy_radau": 1e-5, "scipy_dop853": 1e-9}[name]
    assert seconds > 0.0
    truth = case.reference()
    assert np.max(np.abs(history - truth)) < allowed * np.max(np.abs(truth))


def test_a_branch_computes_what_belongs_to_a_status_once(monkeypatch):
    """Answers to constant forces are those of a status; only the ones to harmonics are computed for each frequency."""
    calls = {"_to_lines": [], "add_waves": []}
    for (name, given), module in zip(calls.items(), (regime, pieces), strict=True):
        work = getattr(module, name)

        def counted(first, *others, work=work, given=given):
            given.append(first)
            return work(first, *others)

        monkeypatch.setattr(module, name, counted)
    branch = vf.continuation(nlvib_03, 0.8, 0.77)
    statuses = {id(spectrum) for spectrum in calls["_to_lines"]}
    # Durations of a run are rounded up to powers of two, so a status may be asked for two of them.
    assert len(calls["_to_lines"]) <= 3 * len(statuses) <= 12
    assert len(calls["add_waves"]) > len(branch)
