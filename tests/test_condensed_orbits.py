"""Shooting on fine meshes: few vectors stand for all modes, and the orbit says what they leave out."""

import numpy as np
import pytest

import vofem as vf
from vofem.studies.steady.condensed import condensable, slowest_decay


def cantilever(omega, elements, stiffness=5.0, gap=0.005, damping=0.03):
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=elements, supports={"left": "clamped"}, name="beam")
    tip = beam.at(1.0)
    effects = [
        vf.Contact(tip, gap=gap, stiffness=stiffness, side="below", acts_on="penetration", name="stop"),
        vf.ModalDamping(damping),
        vf.PointLoad(tip, vf.Sine(0.02, omega)),
    ]
    return vf.Scene([beam], effects)


def test_a_fine_mesh_has_the_orbit_of_a_coarse_one_in_all_modes():
    """1000 elements: amplitudes, multipliers and closings differ from those of 50 elements as the meshes do."""
    fine, coarse = (vf.periodic(cantilever(4.0, elements)) for elements in (1000, 50))
    assert coarse.truncation is None
    assert fine.result.contacts["stop"].closings.size
    tips = [orbit.scene.bodies[0].at(1.0) for orbit in (fine, coarse)]
    # Cubic elements: the error of frequencies falls with the fourth power of their length, 4e-8 of all at 50.
    assert fine.amplitude(tips[0]) == pytest.approx(coarse.amplitude(tips[1]), rel=2e-7)
    # All multipliers that are not nothing, in the order of their size.
    assert np.abs(fine.multipliers[6]) > 1e-3
    assert np.abs(fine.multipliers[:7]) == pytest.approx(np.abs(coarse.multipliers[:7]), abs=2e-6)
    assert fine.stable is True
    left_out = fine.truncation
    assert left_out.modes + fine.unknowns.size // 2 == 2000
    assert left_out.error < 1e-8
    assert "twice as many would change displacements" in left_out.what
    assert left_out.what in fine.notes
    assert any(left_out.what in note for note in fine.result.notes)
    # The result is the orbit itself, and closes as the orbit does.
    ends = fine.result.displacement(tips[0])[[0, -1]]
    assert abs(np.diff(ends)[0]) < 1e-12 * fine.amplitude(tips[0])


def test_all_modes_and_few_vectors_on_one_mesh(monkeypatch):
    """The two differ by no more than the error that is told, and multipliers left out stay below the bound."""
    scene = cantilever(4.0, 110)
    assert condensable(scene.model.system)
    few = vf.periodic(scene)
    monkeypatch.setattr("vofem.studies.steady.segments.shooting.condensable", lambda system: False)
    every = vf.periodic(cantilever(4.0, 110))
    assert every.truncation is None
    tip = scene.bodies[0].at(1.0)
    times = few.result.times
    off = few.result.displacement(tip) - every.result.displacement(every.scene.bodies[0].at(1.0), times)
    assert np.abs(off).max() < 1e-9 * few.amplitude(tip)
    kept = few.multipliers[np.abs(few.multipliers) > 1e-9]
    assert kept.size >= 8
    for value in kept:
        assert np.abs(every.multipliers - value).min() < 1e-8
    for value in every.multipliers[np.abs(every.multipliers) > max(few.truncation.largest, 1e-9)]:
        assert np.abs(few.multipliers - value).min() < 1e-8


def test_a_fine_mesh_agrees_with_harmonic_balance():
    scene = cantilever(4.0, 1000)
    tip = scene.bodies[0].at(1.0)
    exact = vf.periodic(scene)
    balance = vf.periodic(scene, method="harmonic_balance", harmonics=40, guess=exact)
    assert balance.amplitude(tip) == pytest.approx(exact.amplitude(tip), rel=1e-6)


def test_the_work_is_that_of_few_unknowns():
    orbit = vf.periodic(cantilever(4.0, 3000))
    assert orbit.unknowns.size == orbit.multipliers.size <= 200
    # An orbit as guess tells how many vectors are enough.
    near = vf.periodic(cantilever(4.01, 3000), guess=orbit)
    assert near.unknowns.size == orbit.unknowns.size
    assert near.truncation.error == orbit.truncation.error


def test_a_branch_of_a_fine_mesh(tmp_path):
    """A grazing where the linear response says; the branch is saved with what its orbits leave out."""

    def build(gap):
        return cantilever(3.0, 400, gap=gap)

    linear = build(1.0)
    response = vf.frequency_response(linear, np.array([3.0]) / (2.0 * np.pi))
    reached = 0.02 * abs(response.displacement(linear.bodies[0].at(1.0))[0])
    branch = vf.continuation(build, 0.9 * reached, 1.1 * reached)
    (grazing,) = [point for point in branch.special if point.kind == "grazing"]
    assert grazing.value == pytest.approx(reached, rel=1e-9)
    loaded = vf.load(branch.save(tmp_path / "branch.h5"))
    assert loaded.orbits[0].truncation == branch.orbits[0].truncation
    tip = loaded.orbits[0].scene.bodies[0].at(1.0)
    assert loaded.orbits[0].amplitude(tip) == pytest.approx(branch.amplitude(build(1.0).bodies[0].at(1.0))[0], rel=1e-9)


def test_decay_rates():
    """Rayleigh damping holds high modes back again: their slower rate tends to 1/beta."""
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=3, supports={"left": "clamped"})
    rates = {
        name: slowest_decay(vf.Scene([beam], [] if effect is None else [effect]).model.system, 10.0)
        for name, effect in (
            ("none", None), ("mass", vf.RayleighDamping(0.4, 0.0)), ("stiffness", vf.RayleighDamping(0.0, 0.01)),
            ("modal", vf.ModalDamping(0.02)), ("strong", vf.RayleighDamping(0.0, 0.5)),
        )
    }  # fmt: skip
    assert rates["none"] == 0.0
    assert rates["mass"] == pytest.approx(0.2)
    assert rates["stiffness"] == pytest.approx(0.5)
    assert rates["modal"] == pytest.approx(0.2)
    assert rates["strong"] == pytest.approx(2.0, rel=1e-9)


def test_many_contacts_on_a_large_system_are_refused():
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=400, supports={"left": "clamped"}, name="beam")
    stops = [
        vf.Contact(beam.at(k / 80), gap=0.01, stiffness=1.0, side="below", acts_on="penetration", name=f"s{k}")
        for k in range(1, 81)
    ]
    scene = vf.Scene([beam], [*stops, vf.PointLoad(beam.at(1.0), vf.Sine(1.0, 2.0))])
    with pytest.raises(vf.MethodError, match="at most 600 where many"):
        vf.periodic(scene, method="shooting")
    with pytest.raises(vf.MethodError, match="at most 600"):
        vf.backbone(vf.Scene([beam], stops), 1, [1e-3])
    with pytest.raises(vf.MethodError, match="at most 600"):
        vf.lyapunov(scene, 1.0)


def test_modes_that_no_load_reaches_are_among_the_multipliers():
    """Load and stop at midspan: antisymmetric modes are at rest, and their multipliers are those of free decay."""

    def on_two_supports(elements):
        beam = vf.Beam(1.0, 1.0, 1.0, elements, {"left": "pinned", "right": "pinned"}, name="beam")
        middle = beam.at(0.5)
        stop = vf.Contact(middle, gap=0.002, stiffness=200.0, side="below", acts_on="penetration", name="stop")
        return vf.Scene([beam], [stop, vf.ModalDamping(0.02), vf.PointLoad(middle, vf.Sine(0.3, 8.0))])

    orbit = vf.periodic(on_two_supports(400))
    assert orbit.truncation.error < 1e-8
    for mode in (2, 4, 6):
        free = np.exp(-0.02 * (mode * np.pi) ** 2 * orbit.period)
        assert np.sum(np.abs(np.abs(orbit.multipliers) - free) < 1e-6 * free + 1e-12) >= 2


def test_too_many_vectors_are_told(monkeypatch):
    monkeypatch.setattr("vofem.studies.steady.condensed._MOST", 96)
    monkeypatch.setattr("vofem.studies.steady.steady_state.GOOD", 1e-30)
    orbit = vf.periodic(cantilever(4.0, 150))
    assert orbit.unknowns.size == 192
    assert np.isnan(orbit.truncation.error)
    assert any("trust no more digits" in note for note in orbit.notes)


def test_a_backbone_of_a_fine_mesh():
    """Free oscillations of 400 elements are those of 20 elements, whose frequencies are off by 1e-7."""
    found = []
    for elements in (400, 20):
        beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=elements, supports={"left": "clamped"}, name="beam")
        stop = vf.Contact(beam.at(1.0), gap=0.01, stiffness=1.0, side="below", acts_on="penetration", name="stop")
        found.append(vf.backbone(vf.Scene([beam], [stop]), 1, amplitudes=[0.005, 0.0101, 0.0112]))
    fine, coarse = found
    assert fine.omega == pytest.approx(coarse.omega, rel=1e-6)
    assert fine.energy == pytest.approx(coarse.energy, rel=1e-6)
    assert np.ptp(fine.omega) > 0.01
    tip = fine.orbits[-1].scene.bodies[0].at(1.0)
    assert np.abs(fine.q0(tip)) == pytest.approx([0.005, 0.0101, 0.0112], rel=1e-9)
    for orbit in fine.orbits:
        assert orbit.truncation.error < 1e-8
        assert orbit.residual < 1e-10
        ends = orbit.result.displacement(tip)[[0, -1]]
        assert abs(np.diff(ends)[0]) < 1e-9 * orbit.amplitude(tip)


def test_exponents_of_a_fine_mesh_are_those_of_its_multipliers():
    scene = cantilever(4.0, 400)
    orbit = vf.periodic(scene)
    expected = np.log(np.abs(orbit.multipliers[0])) / orbit.period
    found = vf.lyapunov(scene, 200.0 * orbit.period, skip=100.0)
    assert found.exponents[0] == pytest.approx(expected, rel=5e-3)
    assert "vectors" in found.notes[0]
