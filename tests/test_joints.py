"""Joints: two beams that are one, a Gerber beam, joints between nodes, and what cannot be joined."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import block_diag, expm, null_space
from scipy.optimize import brentq

import vofem as vf
from vofem.errors import ArgumentError

EI, RHO = 3.0, 1.5
METHODS = {
    "event_driven": {},
    "energy_conserving": {"dt": 1e-3},
    "generalized_alpha": {"dt": 1e-3},
    "central_difference": {},
}


def one_beam(elements=8):
    whole = vf.Beam(2.0, EI, RHO, elements, {"left": "clamped"}, name="whole")
    return whole, whole.at(2.0), vf.Scene([whole], stops(whole.at(2.0)))


def two_halves(left=4, right=4, swap=False, supports=True):
    a = vf.Beam(1.0, EI, RHO, left, {"left": "clamped"} if supports else {}, name="a")
    b = vf.Beam(1.0, EI, RHO, right, name="b")
    ends = (b.at(0.0), a.at(1.0)) if swap else (a.at(1.0), b.at(0.0))
    joint = vf.Joint(*ends, kind="rigid", name="knee")
    return a, b, joint


def stops(point):
    return [
        vf.PointLoad(point, vf.Sine(1.0, 3.0)),
        vf.Contact(point, gap=0.05, stiffness=300.0, side="above", acts_on="penetration", name="stop"),
    ]


# -- two halves are a whole ------------------------------------------------------------------------


@pytest.mark.parametrize("swap", [False, True])
def test_frequencies_of_two_halves_are_those_of_the_whole(swap):
    a, b, joint = two_halves(swap=swap)
    _whole, _, scene = one_beam()
    found = vf.modes(vf.Scene([b, a] if swap else [a, b], [joint]), 16).omega
    assert found.size == 16
    assert_allclose(found, vf.modes(scene, 16).omega, rtol=1e-12)
    assert_allclose(found[0], 1.8751040687119611**2 * np.sqrt(EI / RHO) / 4.0, rtol=1e-4)


def test_static_deflection_of_two_halves():
    a, b, joint = two_halves()
    rest = vf.equilibrium(vf.Scene([a, b], [joint, vf.PointLoad(b.at(1.0), 0.7), vf.DistributedLoad(b, 0.2)]))
    x = np.linspace(0.0, 1.0, 5)
    whole = 0.7 * x**2 * (6.0 - x) / (6.0 * EI) + 0.2 * (1.5 * x**2 / 2.0 - x**3 / 6.0) / EI
    assert_allclose(rest.deflection(x, a), whole, rtol=1e-12, atol=1e-15)
    assert_allclose(rest.slope([0.0], b), rest.slope([1.0], a), rtol=1e-12)
    tip = 0.7 * 8.0 / (3.0 * EI) + 0.2 * (2.0**4 / 8.0 - (1.0 / 8.0 + 1.0 / 6.0)) / EI
    assert_allclose(rest.displacement(b.at(1.0)), tip, rtol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_a_run_with_contact_is_that_of_the_whole(method):
    a, b, joint = two_halves()
    whole, tip, scene = one_beam()
    options = {"times": np.linspace(0.0, 2.0, 21), "method": method, **METHODS[method]}
    one = vf.simulate(scene, 2.0, **options)
    two = vf.simulate(vf.Scene([a, b], [joint, *stops(b.at(1.0))]), 2.0, **options)
    assert one.contacts["stop"].closings.size >= 1
    assert_allclose(two.displacement(b.at(1.0)), one.displacement(tip), rtol=0.0, atol=1e-11)
    assert_allclose(two.velocity(b.at(0.3)), one.velocity(whole.at(1.3)), rtol=0.0, atol=1e-9)
    assert_allclose(two.contacts["stop"].closings, one.contacts["stop"].closings, rtol=1e-9)
    for part in ("force", "moment"):
        found, expected = (getattr(run.reaction(body, "left"), part) for run, body in ((two, a), (one, whole)))
        assert_allclose(found, expected, rtol=0.0, atol=1e-7)
    assert_allclose(two.energy.total, one.energy.total, rtol=0.0, atol=1e-11)


def test_a_graded_mesh_in_one_half():
    nodes = 1.0 - np.geomspace(1.0, 1e-4, 12)
    a = vf.Beam(1.0, EI, RHO, np.append(nodes, 1.0), {"left": "clamped"}, name="a")
    b = vf.Beam(1.0, EI, RHO, 3, name="b")
    whole = vf.Beam(
        2.0, EI, RHO, np.concatenate([nodes, [1.0, 1.0 + 1 / 3, 1.0 + 2 / 3, 2.0]]), {"left": "clamped"}, name="whole"
    )
    joined = vf.Scene([a, b], [vf.Joint(a.at("right"), b.at("left"), kind="rigid")])
    assert_allclose(vf.modes(joined, 30).omega, vf.modes(vf.Scene([whole]), 30).omega, rtol=1e-9)
    assert_allclose(vf.modes(joined, 6).omega, vf.modes(vf.Scene([whole]), 6).omega, rtol=1e-12)


def test_the_start_is_that_of_the_whole_also_where_no_cubic_gives_it():
    a, b, joint = two_halves()
    whole = vf.Beam(2.0, EI, RHO, 8, {"left": "clamped"}, name="whole")

    def bend(x):
        return 0.1 * (1.0 - np.cos(np.pi * x / 4.0)) + 0.02 * x**2 * np.sin(2.0 * x)

    one = vf.simulate(vf.Scene([whole], [], {whole: (bend, 0.0)}), 1.0, times=[0.0, 0.3, 1.0])
    scene = vf.Scene([a, b], [joint], {a: (bend, 0.0), b: (lambda x: bend(x + 1.0), 0.0)})
    two = vf.simulate(scene, 1.0, times=[0.0, 0.3, 1.0])
    for x in (0.2, 1.0):
        assert_allclose(two.displacement(a.at(x)), one.displacement(whole.at(x)), rtol=0.0, atol=1e-12)
        assert_allclose(two.displacement(b.at(x)), one.displacement(whole.at(1.0 + x)), rtol=0.0, atol=1e-12)


def test_a_start_that_contradicts_the_joint_is_refused():
    a, b, joint = two_halves()
    with pytest.raises(ArgumentError, match=r"initial displacement of Beam 'b' differs at a joint|of Beam 'a' differs"):
        vf.simulate(vf.Scene([a, b], [joint], {a: (lambda x: 0.1 * x**2, 0.0)}), 1.0)
    kink = {a: (lambda x: 0.1 * x**2, 0.0), b: (lambda x: 0.1 + 0.0 * x, 0.0)}
    with pytest.raises(ArgumentError, match="differs at a joint"):
        vf.simulate(vf.Scene([a, b], [joint], kink), 1.0)


# -- hinges ----------------------------------------------------------------------------------------


def gerber(elements=6):
    """Clamped at the left, a hinge in the middle, a support at the right."""
    a = vf.Beam(1.0, EI, RHO, elements, {"left": "clamped"}, name="a")
    b = vf.Beam(1.0, EI, RHO, elements, {"right": "pinned"}, name="b")
    return a, b, vf.Joint(a.at("right"), b.at("left"), kind="hinge", name="hinge")


def test_a_gerber_beam_at_rest():
    a, b, hinge = gerber()
    q = -0.4
    scene = vf.Scene([a, b], [hinge, vf.DistributedLoad(a, q), vf.DistributedLoad(b, q)])
    rest = vf.equilibrium(scene)
    # The right beam is simply supported, half of its load hangs at the tip of the left one.
    tip = q / (8.0 * EI) + 0.5 * q / (3.0 * EI)
    assert_allclose(rest.displacement(a.at(1.0)), tip, rtol=1e-12)
    assert rest.displacement(b.at(0.0)) == rest.displacement(a.at(1.0))
    assert_allclose(rest.displacement(b.at(0.5)), 0.5 * tip + 5.0 * q / (384.0 * EI), rtol=1e-12)
    run = vf.simulate(vf.Scene(scene.bodies, scene.effects, rest), 1.0, times=[0.0, 1.0])
    assert_allclose(run.reaction(a, "left").force, -1.5 * q, rtol=1e-10)
    assert_allclose(run.reaction(a, "left").moment, -(0.5 * q + 0.5 * q), rtol=1e-10)
    assert_allclose(run.reaction(b, "right").force, -0.5 * q, rtol=1e-10)
    # Upward on the left beam is against the load.
    assert_allclose(run.joint_force("hinge").force, 0.5 * q, rtol=1e-10)
    assert_allclose(run.joint_force(hinge, [0.5]).force, 0.5 * q, rtol=1e-10)
    assert np.all(run.joint_force(hinge).moment == 0.0)
    with pytest.raises(ArgumentError, match=r"no joint is named 'hing'.*hinge"):
        run.joint_force("hing")


def test_frequencies_of_a_gerber_beam():
    def determinant(beta):
        """Clamped and pinned ends are put in: sin - sinh, cos - cosh at the left; sin, sinh from the right end."""
        s, c, sh, ch = np.sin(beta), np.cos(beta), np.sinh(beta), np.cosh(beta)
        # Columns: the left beam's s - sh and c - ch at x = 1, the right beam's sin and sinh of 1 - x at x = 0.
        rows = [
            [s - sh, c - ch, -s, -sh],  # displacement
            [-s - sh, -c - ch, 0.0, 0.0],  # no moment in the left beam
            [0.0, 0.0, -s, sh],  # nor in the right one
            [-c - ch, s - sh, -c, ch],  # shear force
        ]
        return np.linalg.det(np.array(rows)) / ch**2

    grid = np.linspace(0.5, 12.0, 400)
    changes = [pair for pair in itertools.pairwise(grid) if determinant(pair[0]) * determinant(pair[1]) < 0.0]
    roots = np.array([brentq(determinant, *pair, xtol=1e-14) for pair in changes])[:4]
    a, b, hinge = gerber(24)
    error = vf.modes(vf.Scene([a, b], [hinge]), 4).omega / (roots**2 * np.sqrt(EI / RHO)) - 1.0
    # The leading error of cubic elements is (beta h)^4/1440 in the frequency, from above.
    assert np.all(error > -1e-11)
    assert_allclose(error, (roots / 24.0) ** 4 / 1440.0, rtol=0.3)


def test_a_mass_hinged_to_a_beam_is_a_point_mass():
    def scene(fix):
        beam = vf.Beam(1.0, EI, RHO, 4, {"left": "clamped"}, name="beam")
        return fix(beam)

    hinged = scene(lambda beam: vf.Scene([beam, m := vf.Mass(0.7, 5.0)], [vf.Joint(beam.at(0.6), m, kind="hinge")]))
    fixed = scene(
        lambda beam: vf.Scene([beam], [vf.PointMass(beam.at(0.6), mass=0.7), vf.Spring(beam.at(0.6), stiffness=5.0)])
    )
    assert_allclose(vf.modes(hinged, 8).omega, vf.modes(fixed, 8).omega, rtol=1e-11)


def test_rigid_motions_of_joined_free_beams():
    a, b, joint = two_halves(supports=False)
    rigid = vf.modes(vf.Scene([a, b], [joint]), 4).omega
    assert np.all(rigid[:2] == 0.0)
    assert rigid[2] > 1.0
    hinged = vf.modes(vf.Scene([a, b], [vf.Joint(a.at(1.0), b.at(0.0), kind="hinge")]), 4).omega
    assert np.all(hinged[:3] == 0.0)
    assert hinged[3] > 1.0


# -- between nodes ---------------------------------------------------------------------------------


def crossing(kind="rigid"):
    a = vf.Beam(1.0, EI, RHO, 3, {"left": "clamped"}, name="a")
    b = vf.Beam(1.4, 0.5 * EI, RHO, 4, {"right": "pinned"}, name="b")
    return a, b, vf.Joint(a.at(0.45), b.at(0.8), kind=kind, name="cross")


def conditions(a, b, kind):
    rows = np.zeros((2, a.size + b.size))
    for k, (of_a, of_b) in enumerate((a.row_at(0.45, d), b.row_at(0.8, d)) for d in (0, 1)):
        rows[k, of_a.indices] = of_a.weights
        rows[k, a.size + of_b.indices] -= of_b.weights
    return rows[: 2 if kind == "rigid" else 1]


@pytest.mark.parametrize("kind", ["rigid", "hinge"])
def test_a_joint_between_nodes_at_rest_is_the_solution_with_multipliers(kind):
    a, b, joint = crossing(kind)
    stiffness = block_diag(*(body.matrices().stiffness.toarray() for body in (a, b)))
    held = np.concatenate([a.matrices().supported, a.size + b.matrices().supported])
    free = np.setdiff1d(np.arange(a.size + b.size), held)
    rows = conditions(a, b, kind)
    m, n = rows.shape[0], free.size
    load = np.zeros(a.size + b.size)
    load[a.row_at(1.0).indices] = 0.3
    load[a.size + b.row_at(1.1).indices] += -0.2 * b.row_at(1.1).weights
    whole = np.block([[stiffness[np.ix_(free, free)], rows[:, free].T], [rows[:, free], np.zeros((m, m))]])
    solution = np.linalg.solve(whole, np.append(load[free], np.zeros(m)))
    q = np.zeros(a.size + b.size)
    q[free] = solution[:n]
    scene = vf.Scene([a, b], [joint, vf.PointLoad(a.at(1.0), 0.3), vf.PointLoad(b.at(1.1), -0.2)])
    rest = vf.equilibrium(scene)
    assert_allclose(np.concatenate([rest.state_of("a")[0], rest.state_of("b")[0]]), q, rtol=0.0, atol=1e-13)
    run = vf.simulate(vf.Scene([a, b], scene.effects, rest), 0.1, times=[0.0, 0.1])
    # The multiplier pulls a down where u_a - u_b would grow.
    assert_allclose(run.joint_force(joint).force, -solution[n], rtol=1e-9)
    if kind == "rigid":
        assert_allclose(run.joint_force(joint).moment, -solution[n + 1], rtol=1e-9)
    residual = stiffness @ q - load + rows.T @ solution[n:]
    assert_allclose(run.reaction(a, "left").force, residual[0], rtol=1e-9)
    assert_allclose(run.reaction(b, "right").force, residual[a.size + b.size - 2], rtol=1e-9)


def test_a_joint_between_nodes_in_motion_is_the_motion_in_the_null_space():
    a, b, joint = crossing()
    bodies = (a, b)
    stiffness, mass = (block_diag(*(getattr(body.matrices(), of).toarray() for body in bodies))
                       for of in ("stiffness", "mass"))  # fmt: skip
    held = np.concatenate([a.matrices().supported, a.size + b.matrices().supported])
    free = np.setdiff1d(np.arange(a.size + b.size), held)
    basis = np.zeros((a.size + b.size, free.size - 2))
    basis[free] = null_space(conditions(a, b, "rigid")[:, free])
    K, M = basis.T @ stiffness @ basis, basis.T @ mass @ basis
    n = K.shape[0]
    start = vf.equilibrium(vf.Scene([a, b], [joint, vf.PointLoad(a.at(1.0), 0.3)]))
    q0 = np.concatenate([start.state_of("a")[0], start.state_of("b")[0]])
    y0 = np.linalg.lstsq(basis, q0, rcond=None)[0]
    flow = expm(0.37 * np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), np.zeros((n, n))]]))
    q1 = basis @ (flow @ np.append(y0, np.zeros(n)))[:n]
    run = vf.simulate(vf.Scene([a, b], [joint], start), 0.37, times=[0.0, 0.37])
    found = np.concatenate([run.state_of("a")[0], run.state_of("b")[0]])
    assert_allclose(found, q1, rtol=0.0, atol=1e-10)
    assert_allclose(run.displacement(a.at(0.45)), run.displacement(b.at(0.8)), rtol=0.0, atol=1e-15)
    assert run.energy.balance_error < 1e-12


# -- what cannot be joined ---------------------------------------------------------------------------


def test_what_is_tied_already_is_refused():
    a, b, joint = two_halves()
    again = vf.Joint(a.at(1.0), b.at(0.0), kind="hinge", name="again")
    with pytest.raises(ArgumentError, match=r"Joint '(again|knee)': the displacement is tied already.*Joint"):
        vf.equilibrium(vf.Scene([a, b], [joint, again]))
    held = vf.Beam(1.0, EI, RHO, 4, {"left": "pinned"}, name="held")
    with pytest.raises(ArgumentError, match=r"'both'.*held at both points by supports"):
        vf.modes(vf.Scene([a, held], [vf.Joint(a.at(0.0), held.at(0.0), kind="hinge", name="both")]))
    near = [vf.Joint(a.at(x), b.at(x), kind="hinge", name=f"n{k}") for k, x in enumerate((0.3, 0.3 + 1e-12))]
    with pytest.raises(ArgumentError, match="tied already"):
        vf.modes(vf.Scene([a, b], near))
    several = [vf.Joint(a.at(x), b.at(x), kind="hinge") for x in (0.55, 0.6, 0.65, 0.7, 0.72)]
    with pytest.raises(ArgumentError, match="tied already"):
        vf.modes(vf.Scene([a, b], several))
    with pytest.raises(ArgumentError, match="joints named 'knee' occur more than once"):
        vf.modes(vf.Scene([a, b], [joint, vf.Joint(a.at(0.5), b.at(0.5), kind="hinge", name="knee")]))


def test_arguments_that_make_no_joint_are_refused():
    a, b, _ = two_halves()
    with pytest.raises(ArgumentError, match="expected a point of another body"):
        vf.Joint(a.at(0.2), a.at(0.7), kind="hinge")
    with pytest.raises(ArgumentError, match="kind is 'glue'"):
        vf.Joint(a.at(0.2), b.at(0.7), kind="glue")
    with pytest.raises(ArgumentError, match="no slope"):
        vf.Joint(a.at(0.2), vf.Mass(1.0), kind="rigid")
    with pytest.raises(ArgumentError, match="not in the scene"):
        vf.Scene([a], [vf.Joint(a.at(0.2), b.at(0.7), kind="hinge")])


# -- files and pictures --------------------------------------------------------------------------------


def test_pictures_show_joined_beams_at_one_place(tmp_path):
    from vofem.io.pictures.layout import arrange
    from vofem.io.pictures.snapshot import snapshot

    a, b, hinge = gerber()
    run = vf.simulate(vf.Scene([a, b], [hinge, *stops(b.at(0.2))]), 1.0, times=np.linspace(0.0, 1.0, 11))
    layout = arrange(snapshot(run, 0.5), (1600, 700), None)
    assert layout.lanes[a].axis == layout.lanes[b].axis
    assert_allclose(layout.along(a, 1.0), layout.along(b, 0.0), rtol=1e-12)
    frame = run.frame(0.5)
    of_b = np.unique(frame.extract_cells((frame["body"] == 1) & (frame["kind"] == 0))["vtkOriginalPointIds"])
    assert_allclose(frame.points[of_b[0]], [1.0, 0.0, 0.0], rtol=0.0, atol=1e-15)
    from vofem.io.render import render

    assert render(run, 0.5, tmp_path / "side.png").stat().st_size > 5000


# -- fine meshes, and runs that are broken off -----------------------------------------------------


def test_fine_meshes_keep_their_digits_through_a_joint():
    a, b, joint = two_halves(1500, 1500)
    rest = vf.equilibrium(vf.Scene([a, b], [joint, vf.PointLoad(b.at(1.0), 1.0)]))
    assert_allclose(rest.displacement(b.at(1.0)), 8.0 / (3.0 * EI), rtol=1e-11)
    a, b, hinge = gerber(1500)
    rest = vf.equilibrium(vf.Scene([a, b], [hinge, vf.DistributedLoad(b, 1.0)]))
    assert_allclose(rest.displacement(a.at(1.0)), 0.5 / (3.0 * EI), rtol=1e-11)


def test_ritz_vectors_of_joined_beams():
    tips = []
    for elements in (10, 300):
        a, b, hinge = gerber(elements)
        effects = [
            hinge,
            vf.PointLoad(b.at(0.5), vf.Sine(2.0, 3.0)),
            vf.Contact(a.at(1.0), gap=0.01, side="above", stiffness=300.0, acts_on="penetration"),
        ]
        run = vf.simulate(vf.Scene([a, b], effects), 0.6, times=[0.0, 0.3, 0.6])
        assert (run.truncation is None) == (elements == 10)
        tips.append(run.displacement(a.at(1.0)))
    assert_allclose(tips[1], tips[0], rtol=0.0, atol=2e-6)


def test_a_point_mass_may_travel_beside_a_joint_and_fields_at_the_start():
    one, other = (vf.Beam(1.0, 1.0, 1.0, 2, {end: "pinned"}, name=end) for end in ("left", "right"))
    effects = [vf.Joint(one.at(1.0), other.at(0.0), kind="hinge"), vf.PointMass(one.along(vf.Path(0.5)), mass=0.1)]
    start = {one: (lambda x: 1e-3 * x, 0.0), other: (lambda x: 1e-3 * (1.0 - x), 0.0)}
    run = vf.simulate(vf.Scene([one, other], effects, start), 0.01, method="generalized_alpha", dt=0.01)
    assert run.displacement(one.at(1.0))[0] == pytest.approx(1e-3)
