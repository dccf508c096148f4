"""Large systems in few Ritz vectors: solutions free of the rounding in K, and truncation errors that notes report."""

import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from scenes import cantilever, paper_beam
from scipy.sparse import csr_matrix

import vofem as vf
from vofem.errors import MethodError, SingularSystemError
from vofem.integrators.event_driven.truncated import FULL_UNKNOWNS, MOST_VECTORS
from vofem.integrators.reduction import loss_in_all_modes
from vofem.linalg.eigen import modal_basis
from vofem.linalg.orthogonal import OrthogonalFactor, elimination_orders
from vofem.linalg.ritz import RitzBasis

TIMES = np.linspace(0.0, 20.0, 401)


def system_of(beam, *effects):
    return vf.Scene([beam], effects).model.system


def distance(a, b):
    return float(np.abs(a - b).max() / np.abs(b).max())


# -- the orthogonal factor ------------------------------------------------------------------------


def test_a_matrix_of_any_pattern():
    rng = np.random.default_rng(3)
    full = rng.standard_normal((40, 25)) * (rng.random((40, 25)) < 0.2)
    full[:25] += 3.0 * np.eye(25)
    load = rng.standard_normal(25)
    expected = np.linalg.solve(full.T @ full, load)
    for order in elimination_orders(csr_matrix(full), np.zeros(25, dtype=bool)):
        assert OrthogonalFactor(csr_matrix(full), order).solve(load) == pytest.approx(expected, rel=1e-10)


def test_a_loose_motion_and_a_band_too_wide_are_named():
    with pytest.raises(SingularSystemError, match="without stiffness"):
        OrthogonalFactor(csr_matrix([[1.0, -1.0]]), np.arange(2))
    n = 40_000
    wide = csr_matrix((np.ones(2), ([0, 0], [0, n - 1])), shape=(1, n))
    with pytest.raises(SingularSystemError, match="half-bandwidth"):
        OrthogonalFactor(wide, np.arange(n))


def fine_beam(supports, *, nodes=10_000, **more):
    return vf.Beam(1.0, 1.0, 1.0, nodes, supports, **more)


def graded(ratio, fine_at_support):
    """Nodal matrices lose everything at element sizes of 1 : 1e6."""
    nodes = np.concatenate([[0.0], np.cumsum(np.geomspace(1.0, ratio, 50)[:: 1 if fine_at_support else -1])])
    return fine_beam({"left": "clamped"}, nodes=nodes / nodes[-1])


def on_springs(stiffness):
    beam = fine_beam({})
    return beam, [vf.Spring(beam.at(x), stiffness=stiffness) for x in (0.0, 1.0)]


def on_a_foundation():
    beam = fine_beam({})
    return beam, [vf.Foundation(beam, stiffness=500.0)]


#: Hetenyi, Beams on Elastic Foundation, 1946: a free beam of length 1 loaded in the middle.
ROOT = (500.0 / 4.0) ** 0.25
HETENYI = ROOT / 1000.0 * (2.0 + np.cosh(ROOT) + np.cos(ROOT)) / (np.sinh(ROOT) + np.sin(ROOT))

#: Beam and effects, the place of a load of 1 N, the displacement there, and its digits.
STATIC = {
    "clamped at the right": (lambda: (fine_beam({"right": "clamped"}), []), 0.0, 1.0 / 3.0, 1e-12),
    "pinned": (lambda: (fine_beam({"left": "pinned", "right": "pinned"}), []), 0.5, 1.0 / 48.0, 1e-12),
    "clamped": (lambda: (fine_beam({"left": "clamped", "right": "clamped"}), []), 0.5, 1.0 / 192.0, 1e-12),
    "guided": (lambda: (fine_beam({"left": "guided", "right": "pinned"}), []), 0.0, 1.0 / 3.0, 1e-12),
    **{
        f"graded 1 : {ratio:g}, {fine}": (lambda r=ratio, f=fine: (graded(r, f), []), 1.0, 1.0 / 3.0, 1e-13)
        for ratio in (1e2, 1e6, 1e10)
        for fine in (True, False)
    },
    **{f"springs, {k:g} N/m": (lambda k=k: on_springs(k), 0.5, 0.5 / k + 1.0 / 48.0, 1e-12) for k in (1e-9, 1.0, 1e6)},
    "foundation": (on_a_foundation, 0.5, HETENYI, 1e-11),
    "tension": (
        lambda: (fine_beam({"left": "pinned", "right": "pinned"}, tension=100.0), []),
        0.5, (0.25 - np.tanh(5.0) / 20.0) / 100.0, 1e-11,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", STATIC)
def test_static_responses_keep_their_digits(name):
    build, x, compliance, digits = STATIC[name]
    beam, effects = build()
    rest = vf.equilibrium(vf.Scene([beam], [*effects, vf.PointLoad(beam.at(x), 1.0)]))
    assert rest.displacement(beam.at(x)) == pytest.approx(compliance, rel=digits)


@pytest.mark.parametrize("elements", [1000, 10_000, 100_000])
def test_equilibrium_of_fine_meshes(elements):
    """Half of the answer would be lost with K at 10 000 elements."""
    beam = cantilever(elements)
    load = vf.PointLoad(beam.at(1.0), -1.0)
    free = vf.equilibrium(vf.Scene([beam], [load]))
    assert free.displacement(beam.at(1.0)) == pytest.approx(-1.0 / 3.0, rel=1e-11)
    stop = vf.Contact(beam.at(1.0), gap=0.1, stiffness=9.0, side="below", acts_on="penetration", name="stop")
    held = vf.equilibrium(vf.Scene([beam], [load, stop]))
    assert held.contacts["stop"].force == pytest.approx(9.0 * (1.0 + 0.9) / 12.0 - 0.9, rel=1e-10)
    loose = vf.Beam(1.0, 1.0, 1.0, elements, {})
    stops = [vf.Contact(loose.at(x), gap=0.0, stiffness=1e3, side="below", acts_on="penetration") for x in (0.0, 1.0)]
    rest = vf.equilibrium(vf.Scene([loose], [*stops, vf.PointLoad(loose.at(0.5), -1.0)]))
    assert rest.displacement(loose.at(0.5)) == pytest.approx(-0.5e-3 - 1.0 / 48.0, rel=1e-10)


# -- Ritz vectors ---------------------------------------------------------------------------------


def test_dependent_loads_make_no_further_vectors():
    mass = csr_matrix(np.eye(3))
    basis = RitzBasis(mass, lambda f: f / np.array([1.0, 2.0, 3.0]), np.zeros((3, 0)), [np.ones(3)] * 2, [np.ones(3)])
    assert basis.grow(10).shape == (3, 3)


# -- runs -----------------------------------------------------------------------------------------


def test_ten_thousand_elements_follow_the_converged_beam():
    """A mesh of 10 000 differs from one of 100 by the error of the latter, h^4, and by the truncation."""
    runs = {}
    for elements in (50, 100, 10_000):
        beam, scene = paper_beam("penetration", elements=elements)
        runs[elements] = vf.simulate(scene, 20.0, times=TIMES), beam.at(1.0)
    fine, _ = runs[10_000]
    tips = {n: run.displacement(point) for n, (run, point) in runs.items()}
    assert fine.truncation is not None
    assert fine.truncation.error < 1e-6
    assert fine.truncation.rounding < 1e-11
    # Impacts excite all modes, so the mesh error falls at a lower rate than h^4.
    coarse, medium = distance(tips[50], tips[10_000]), distance(tips[100], tips[10_000])
    assert medium < 2e-6
    assert medium < coarse / 4.0
    closings = fine.contacts["stop"].closings
    assert closings == pytest.approx(runs[100][0].contacts["stop"].closings, abs=1e-6)
    assert fine.energy.balance_error < 1e-12
    assert any(note.startswith("truncation: 32 Ritz vectors") for note in fine.notes)
    assert any(note.startswith("rounding: ") for note in fine.notes)
    # Deflection, gap and reaction agree with the point, without all degrees of freedom at all times.
    assert fine.deflection([1.0])[0] == pytest.approx(tips[10_000], rel=1e-12)
    assert fine.contacts["stop"].gap_function == pytest.approx(-tips[10_000] - 0.03, rel=1e-9)
    moment, coarser = fine.reaction(fine.scene.bodies[0], "left").moment, runs[100][0]
    assert distance(moment, coarser.reaction(coarser.scene.bodies[0], "left").moment) < 1e-3


CASES = [("displacement", 1.0), ("penetration", 1.0), ("penetration", 100.0), ("penetration", 1000.0)]


@pytest.mark.parametrize(("acts_on", "stiffness"), CASES)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_truncation_error_is_told_honestly(acts_on, stiffness, tolerance):
    """Against all modes of 100 elements, which rounding leaves eight digits."""
    beam, scene = paper_beam(acts_on, elements=100, stiffness=stiffness)
    full = vf.simulate(scene, 20.0, times=TIMES).displacement(beam.at(1.0))
    run = vf.simulate(scene, 20.0, times=TIMES, truncation=tolerance)
    error = distance(run.displacement(beam.at(1.0)), full)
    assert run.truncation.vectors < 200
    assert 0.1 * error < run.truncation.error < 100.0 * error
    assert run.truncation.error <= tolerance
    assert error <= tolerance
    assert run.truncation.until == 20.0


def free_beam(elements):
    beam = vf.Beam(1.0, 1.0, 1.0, elements, {})
    stops = [
        vf.Contact(beam.at(x), gap=gap, stiffness=10.0, side="below", acts_on="penetration")
        for x, gap in ((0.0, 0.01), (1.0, 0.02))
    ]
    return vf.Scene([beam], [*stops, vf.Gravity(0.3)]), beam.at(1.0)


def thrown_beam(elements):
    beam = cantilever(elements)
    stop = vf.Contact(beam.at(1.0), gap=0.01, stiffness=100.0, side="below", acts_on="penetration")
    start = {beam: (lambda x: 0.02 * x**2, lambda x: -0.1 * x**2)}
    return vf.Scene([beam], [stop, vf.RayleighDamping(0.1, 1e-4)], initial=start), beam.at(1.0)


def beam_and_mass(elements):
    beam, mass = vf.Beam(1.0, 1.0, 1.0, elements, {"left": "pinned", "right": "pinned"}), vf.Mass(0.5, stiffness=3.0)
    effects = [
        vf.Contact(beam.at(0.5), mass, gap=0.0, stiffness=50.0, damping=0.3, acts_on="penetration"),
        vf.Dashpot(beam.at(0.25), damping=0.5),
        vf.Spring(beam.at(0.75), stiffness=4.0),
        vf.PointLoad(beam.at(0.5), vf.Sine(1.0, 7.0)),
    ]
    return vf.Scene([beam, mass], effects), beam.at(0.5)


def string_on_stop(elements):
    beam = vf.Beam(1.0, 1.0, 1.0, elements, {"left": "pinned", "right": "pinned"}, tension=10.0)
    stop = vf.Contact(beam.at(0.3), gap=0.01, stiffness=100.0, side="below", acts_on="penetration")
    return vf.Scene([beam], [stop, vf.PointLoad(beam.at(0.5), vf.Sine(1.0, 3.0)), vf.ModalDamping(0.02)]), beam.at(0.5)


def joined_beams(elements):
    left = cantilever(elements)
    right = vf.Beam(1.0, 2.0, 1.0, elements, {"right": "clamped"})
    effects = [
        vf.Spring(left.at(0.5), right.at(0.5), stiffness=20.0),
        vf.Contact(left.at(1.0), right.at(0.0), gap=0.01, stiffness=30.0, acts_on="penetration"),
        vf.PointLoad(left.at(1.0), vf.Sine(1.0, 3.0)),
    ]
    return vf.Scene([left, right], effects), left.at(1.0)


@pytest.mark.parametrize("build", [free_beam, thrown_beam, beam_and_mass, string_on_stop, joined_beams])
def test_large_scenes_of_all_kinds(build):
    times = np.linspace(0.0, 5.0, 201)
    scene, point = build(60)
    expected = vf.simulate(scene, 5.0, times=times)
    scene, fine_point = build(3000)
    run = vf.simulate(scene, 5.0, times=times)
    assert run.truncation.error < 1e-6
    assert run.truncation.rounding < 1e-11
    assert run.counters.events == expected.counters.events
    assert distance(run.displacement(fine_point), expected.displacement(point)) < 1e-5
    beam, coarse = run.scene.bodies[0], expected.scene.bodies[0]
    for place in beam.supports:
        here = "left" if place == 0 else "right"
        force = expected.reaction(coarse, here).force
        assert distance(run.reaction(beam, here).force, force) < 2e-2
    # Damping is integrated mode by mode along the run.
    assert run.energy.balance_error < 1e-7


def test_chain_of_masses():
    """A free chain that is thrown at a stop: waves need many vectors, and get them."""
    count = 600
    masses = [vf.Mass(1.0 / count) for _ in range(count)]
    springs = [vf.Spring(a, b, stiffness=float(count)) for a, b in pairwise(masses)]
    stop = vf.Contact(masses[0], gap=0.0, stiffness=1.0, side="below", acts_on="penetration")
    scene = vf.Scene(masses, [stop, *springs], initial={mass: (0.0, -1.0) for mass in masses})
    times = np.linspace(0.0, 3.0, 301)
    full = vf.simulate(scene, 3.0, times=times)
    run = vf.simulate(scene, 3.0, times=times, truncation=1e-4)
    error = distance(run.displacement(masses[0]), full.displacement(masses[0]))
    assert 0.1 * error < run.truncation.error <= 1e-4
    assert error < 1e-4


def test_chaos_is_told_with_the_time_until_which_values_hold():
    _, scene = paper_beam("penetration", elements=200, stiffness=1e6)
    run = vf.simulate(scene, 6.0, truncation=1e-6)
    assert run.truncation.error > 1e-6
    assert 3.7 < run.truncation.until < 6.0
    assert any("it stays within 1e-06 until t = " in note for note in run.notes)


def test_small_systems_keep_all_modes():
    _, scene = paper_beam("displacement")
    run = vf.simulate(scene, 20.0)
    assert run.truncation is None
    assert not run.notes
    tight = vf.simulate(scene, 20.0, truncation=0.0)
    assert np.array_equal(run.samples.q, tight.samples.q)
    assert FULL_UNKNOWNS >= 2 * 400


def test_memory_is_that_of_the_vectors():
    """20 000 degrees of freedom at 1001 times would take 480 MB."""
    beam, scene = paper_beam("penetration", elements=10_000)
    run = vf.simulate(scene, 1.0)
    tracemalloc.start()
    assert run.displacement(beam.at(1.0)).size == 1001
    run.reaction(beam, "left")
    run.contacts["stop"].gap_function  # noqa: B018
    vf.Scene([beam], initial=run).initial_state()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40e6


FINE = [
    (300, {"left": "clamped"}, ()),
    (300, {"left": "pinned", "right": "pinned"}, ()),
    (150, {}, ()),
    # The two highest modes of a free beam have one frequency.
    (50, {}, ()),
    (200, {}, (1e-3, 1e-3)),
    (100, {}, (1e9, 1.0)),
]


@pytest.mark.parametrize(("elements", "supports", "springs"), FINE)
def test_all_modes_of_a_fine_mesh_are_right_to_rounding(elements, supports, springs):
    """From K alone static responses are off by 4e-9 on 300 elements, and by 5e-5 on soft springs."""
    beam = vf.Beam(1.0, 1.0, 1.0, elements, supports)
    ends = [vf.Spring(beam.at(x), stiffness=k) for x, k in zip((0.0, 1.0), springs, strict=False)]
    system = system_of(beam, *ends, vf.PointLoad(beam.at(0.4), 1.0))
    check_modes(system)


@pytest.mark.parametrize("stiffness", [1e-12, 1e-6, 1.0, 1e6])
def test_modes_of_two_equal_beams_with_a_spring_between_them(stiffness):
    """All frequencies are nearly equal in pairs."""
    left, right = (cantilever(60) for _ in range(2))
    join = vf.Spring(left.at(1.0), right.at(1.0), stiffness=stiffness)
    check_modes(vf.Scene([left, right], [join, vf.PointLoad(left.at(1.0), 1.0)]).model.system)


@pytest.mark.parametrize("finest_first", [True, False])
def test_modes_of_a_graded_mesh(finest_first):
    """From K alone static responses are off by 6e-3 if the finest elements are at the free end."""
    lengths = np.geomspace(1.0, 1e4, 50)[:: 1 if finest_first else -1]
    nodes = np.concatenate([[0.0], np.cumsum(lengths)])
    beam = vf.Beam(1.0, 1.0, 1.0, nodes / nodes[-1], {"left": "clamped"})
    check_modes(system_of(beam, vf.PointLoad(beam.at(1.0), 1.0)))


@pytest.mark.parametrize("count", [40, 41, 160])
@pytest.mark.parametrize("ground", [0.0, 1.0])
def test_modes_of_a_ring_of_equal_masses(count, ground):
    """All frequencies but the extreme ones are double, and the modes of one must come from one eigenproblem."""
    masses = [vf.Mass(1.0, stiffness=ground) if ground else vf.Mass(1.0) for _ in range(count)]
    springs = [vf.Spring(masses[i], masses[i - 1], stiffness=3.0) for i in range(count)]
    squares, _ = check_modes(vf.Scene(masses, [*springs, vf.PointLoad(masses[2], 1.0)]).model.system)
    exact = np.sort(ground + 12.0 * np.sin(np.pi * np.arange(count) / count) ** 2)
    assert squares == pytest.approx(exact, rel=1e-13, abs=1e-300)


def check_modes(system):
    squares, shapes = modal_basis(system.mass, system.stiffness, system.scale, system.rigid, system.strain)
    assert np.abs(shapes.T @ (system.mass @ shapes) - np.eye(squares.size)).max() < 1e-14
    assert loss_in_all_modes(system, squares, shapes) < 1e-13
    return squares, shapes


def test_rounding_of_all_modes_is_told():
    _, scene = paper_beam("penetration", elements=300)
    assert not any(note.startswith("rounding") for note in vf.simulate(scene, 1.0).notes)
    # K of this mesh has lost the lowest modes, so that they cannot be refined.
    lengths = np.geomspace(5e4, 1.0, 50)
    nodes = np.concatenate([[0.0], np.cumsum(lengths)])
    beam = vf.Beam(1.0, 1.0, 1.0, nodes / nodes[-1], {"left": "clamped"})
    try:
        run = vf.simulate(vf.Scene([beam], [vf.PointLoad(beam.at(1.0), 1.0)]), 1.0)
    except SingularSystemError as error:
        assert "rounding has made the stiffness matrix indefinite" in str(error)  # noqa: PT017
    else:
        assert any(note.startswith("rounding: in all 100 modes static responses are off by") for note in run.notes)


def test_too_many_contacts_and_too_many_modes_are_refused_by_name():
    beam = cantilever(4000)
    load = vf.PointLoad(beam.at(1.0), 1.0)
    bed = vf.Scene([beam], [vf.Foundation(beam, stiffness=1.0, one_sided=True), load])
    with pytest.raises(MethodError, match=rf"8000 .* 4001 contacts.* need more than {MOST_VECTORS} Ritz vectors"):
        vf.simulate(bed, 1.0, method="event_driven")
    assert vf.explain(bed).method != "event_driven"
    with pytest.raises(MethodError, match=r"at most 6000 with all modes.* leave truncation= out"):
        vf.simulate(vf.Scene([beam], [load]), 1.0, truncation=0.0)
    assert vf.explain(vf.Scene([beam], [load])).method == "event_driven"


def test_compression_on_a_fine_mesh_is_refused_by_name():
    beam = vf.Beam(1.0, 1.0, 1.0, 10_000, {"left": "pinned", "right": "pinned"}, tension=-5.0)
    with pytest.raises(MethodError, match="compressive axial force"):
        vf.simulate(vf.Scene([beam], [vf.PointLoad(beam.at(0.5), 1.0)]), 1.0)
    coarse = vf.Beam(1.0, 1.0, 1.0, 100, {"left": "pinned", "right": "pinned"}, tension=-5.0)
    scene = vf.Scene([coarse], [vf.PointLoad(coarse.at(0.5), 1.0)])
    full, run = vf.simulate(scene, 1.0), vf.simulate(scene, 1.0, truncation=1e-6)
    assert distance(run.displacement(coarse.at(0.5)), full.displacement(coarse.at(0.5))) < 1e-6
