"""The balance of work along paths of equilibria: closed where equilibria are right, told where they are not.

`python tests/test_work_along_paths.py FIRST LAST` runs many seeds and prints what it finds.
"""

import random

import numpy as np
from campaigns import campaign
from numpy.testing import assert_allclose

import vofem as vf
from vofem.statics.equilibria import work_notes
from vofem.statics.solver import EquilibriumSolver


def path(seed):
    """Return the outcome of a random path of a beam on springs that remember and on contacts."""
    rng = random.Random(seed)
    beam = vf.Beam(1.0, 1.0, 1.0, rng.choice([2, 5, 30]), {"left": "clamped"}, name="beam")
    places = [beam.at(x) for x in (1.0, 0.5, 0.75)]
    effects = [
        vf.Contact(
            rng.choice(places), gap=rng.choice([0.0, 0.02, 0.1]), stiffness=10.0 ** rng.uniform(0.0, 9.0),
            side=rng.choice(["above", "below"]), acts_on=rng.choice(["penetration", "displacement"]), name=f"c{k}",
        )
        for k in range(rng.choice([0, 1, 3]))
    ]  # fmt: skip
    at = rng.choice(places)
    effects.append(
        rng.choice(
            [
                vf.BilinearSpring(at, stiffness=10.0, linear_limit=0.03, hardening=0.1),
                vf.IwanSpring(at, elongation=[0.01, 0.05, 0.2], force=[0.2, 0.6, 1.0]),
                vf.HystereticSpring(
                    at, stiffness=3.0, linear_limit=0.05, softening=vf.LinearSoftening(4.0), memory="cyclic"
                ),
                vf.CrushingStop(at, gap=0.02, side="above", stiffness=30.0, linear_limit=0.01),
            ]
        )
    )
    effects.append(vf.PointLoad(beam.at(1.0), 1.0))
    return vf.quasi_static(vf.Scene([beam], effects), [rng.uniform(-1.0, 1.0) for _ in range(rng.choice([1, 4, 40]))])


def test_work_is_taken_by_bodies_springs_and_contacts():
    """Seed 1 has three stops of 12 to 1.3e7 N/m, one of them pinned beside a law that is curved.

    Seed 139 has three stops at one point beside a stiff law; it ended without an equilibrium.
    """
    notes = {seed: path(seed).notes for seed in [*range(40), 139]}
    assert [seed for seed in notes if any(note.startswith("energy") for note in notes[seed])] == []


def test_an_equilibrium_that_is_not_one_is_told(monkeypatch):
    right = EquilibriumSolver.displacement
    monkeypatch.setattr(EquilibriumSolver, "displacement", lambda *arguments: 1.5 * right(*arguments))
    told = [seed for seed in range(40) if any(note.startswith("energy") for note in path(seed).notes)]
    # With factors far apart both bounds leave room for errors.
    assert len(told) > 10
    outcome = path(told[0])
    assert outcome.notes[0].startswith("energy: from load factor")
    assert "notes" in repr(outcome)


def test_bounds_of_the_work_are_sharp():
    factors = np.array([1.0, 2.0])
    # A linear spring of 1 N/m, and one that has taken more, or less, than the load can have given.
    assert work_notes(factors, factors, 0.5 * factors**2) == []
    assert work_notes(factors, factors, np.array([0.5, 2.5 + 1e-9])) == []
    assert len(work_notes(factors, factors, np.array([0.5, 2.6]))) == 1
    assert "0.4 J" in work_notes(factors, factors, np.array([0.5, 0.9]))[0]


def test_a_path_with_preloaded_stops_begins_where_they_have_pushed():
    """Stops with negative gaps push before any load; this is no energy that is missing."""
    mass = vf.Mass(1.0, stiffness=2.0)
    pushed = vf.Contact(mass, gap=-0.05, stiffness=30.0, side="above", acts_on="penetration")
    for factors in ([0.0, 1.0], [1.0, -1.0], [-1.0, 1.0]):
        path = vf.quasi_static(vf.Scene([mass], [pushed, vf.PointLoad(mass, 1.0)]), factors)
        assert path.notes == []
        exact = [(f - 1.5) / 32.0 if f > -0.1 else f / 2.0 for f in factors]
        assert_allclose(path.displacement(mass), exact, rtol=1e-12)
    free = vf.Mass(1.0)
    pushed = vf.Contact(free, gap=-0.05, stiffness=30.0, side="above", acts_on="penetration")
    path = vf.quasi_static(vf.Scene([free], [pushed, vf.PointLoad(free, 1.0)]), [1.0, 2.0])
    assert path.notes == []
    assert_allclose(path.displacement(free), [1.0 / 30.0 - 0.05, 2.0 / 30.0 - 0.05], rtol=1e-12)


def test_a_preloaded_stop_is_crushed_before_the_load_lets_go_of_it():
    """At first 2 u + F = 0 on the backbone F = 2 s/(1.9/3 + s), s = u + 0.5; then it is elastic with 3 N/m."""
    mass = vf.Mass(1.0, stiffness=2.0)
    stop = vf.CrushingStop(
        mass, gap=-0.5, side="above", stiffness=3.0, linear_limit=0.1 / 3.0, softening=vf.LinearSoftening(1.9)
    )
    a, b = 1.9 / 3.0, 2.0
    # 2 (s - 1/2) (a + s) + b s = 0
    approach = max(np.roots([2.0, 2.0 * a - 1.0 + b, -a]))
    force = b * approach / (a + approach)
    dent = approach - force / 3.0
    path = vf.quasi_static(vf.Scene([mass], [stop, vf.PointLoad(mass, 1.0)]), [-0.1, -2.0])
    assert_allclose(path.displacement(mass), [(-0.1 - 3.0 * (0.5 - dent)) / 5.0, -1.0], rtol=1e-12)
    assert path.notes == []


def test_the_law_as_printed_gives_back_what_it_had_dissipated():
    """Loaded to 7 N and unloaded to 3 N it stands at 10 m, and falls to 3 m when the load rises again."""
    mass = vf.Mass(1.0, name="m")
    how = {"stiffness": 1.0, "linear_limit": 5.0, "name": "s"}
    notes = {}
    for memory in ("printed", "cyclic"):
        spring = vf.HystereticSpring(mass, **how, memory=memory)
        scene = vf.Scene([mass], [spring, vf.PointLoad(mass, 1.0)])
        notes[memory] = vf.quasi_static(scene, [0.0, 7.0, 3.0, 3.1]).notes
        assert vf.quasi_static(scene, [0.0, 7.0, 3.0]).notes == []
    assert notes["cyclic"] == []
    assert "from load factor 3 to 3.1" in notes["printed"][0]
    assert "memory='cyclic'" in notes["printed"][0]


if __name__ == "__main__":
    campaign(lambda seed: path(seed).notes)
