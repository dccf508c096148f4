"""Low-frequency rattling: many impacts a period between two stops."""

import numpy as np
import pytest
from reference_integration import Reference

import vofem as vf


def rattler(omega, damping=3.0):
    """A mass that nothing holds but two stops, thrown from one to the other."""
    mass = vf.Mass(1.0, damping=0.01, name="mass")
    stops = [
        vf.Contact(mass, gap=0.05, stiffness=1e3, damping=damping, side=side, acts_on="penetration", name=side)
        for side in ("above", "below")
    ]
    return vf.Scene([mass], [*stops, vf.PointLoad(mass, vf.Sine(1.0, omega))])


def test_an_orbit_with_28_impacts_a_period():
    scene = rattler(0.5)
    orbit = vf.periodic(scene)
    assert orbit.stable is True
    assert orbit.residual < 1e-12
    impacts = sum(orbit.result.contacts[side].closings.size for side in ("above", "below"))
    assert impacts == 28
    start = vf.Scene(scene.bodies, scene.effects, initial=orbit)
    outcome = Reference(start, orbit.period).run()
    assert outcome.q[-1] == pytest.approx(start.initial_state().q, abs=1e-9)
    assert outcome.v[-1] == pytest.approx(start.initial_state().v, abs=1e-8)


@pytest.mark.parametrize("search", [vf.periodic, lambda scene: vf.continuation(lambda _: scene, 0.5, 0.6)])
def test_a_motion_that_never_repeats_is_told(search):
    """A mass without a spring is pushed away from its stop for ever."""
    mass = vf.Mass(1.0, name="mass")
    stop = vf.Contact(mass, gap=0.1, stiffness=10.0, side="above", acts_on="penetration", name="stop")
    scene = vf.Scene([mass], [stop, vf.Dashpot(mass, damping=1.0), vf.PointLoad(mass, vf.Sine(1.0, 1.0) - 0.5)])
    with pytest.raises(vf.ConvergenceError, match=r"no orbit was found\. after 200 periods .* where the motion is reg"):
        search(scene)


def test_an_orbit_is_found_near_a_motion_that_does_not_settle():
    orbit = vf.periodic(rattler(0.5, damping=1.0))
    assert orbit.stable is False
    assert orbit.residual < 1e-8
    assert any("where the motion nearly repeats" in note for note in orbit.notes)


def test_a_branch_does_not_go_back_through_a_grazing():
    """Another grazing lies within reach of a step; the one that the branch has come through leads back along it."""
    branch = vf.continuation(rattler, 0.5, 0.45, max_points=75)
    grazings = [s for s in branch.special if s.kind == "grazing"]
    # The last two are one orbit and its mirror image: the branch crosses that of the symmetric orbits between them.
    assert [s.value for s in grazings] == pytest.approx([0.4871399376, 0.4770683140, 0.4770683140], abs=1e-9)
    assert [s.contact for s in grazings] == ["below", "above", "below"]
    assert grazings[1].value == pytest.approx(grazings[2].value, abs=1e-12)
    # It turns there, where multipliers are rounding; the value is that of the branch point's own equations.
    turns = [s for s in branch.special if s.kind in ("fold", "branch_point")]
    (turn,) = [s for s in turns if grazings[1].place < s.place < grazings[2].place]
    assert (turn.kind, turn.value) == ("branch_point", pytest.approx(0.47706814138271, abs=1e-10))
    assert not any("may be missing" in note for note in branch.notes)
    # Orbits and not only values are new, and the branch has not come back to where it began.
    states = np.array([[*o.unknowns, 100.0 * value] for o, value in zip(branch.orbits, branch.values, strict=True)])
    away = np.linalg.norm(states[:, None] - states[None, :], axis=2)
    apart = np.abs(np.subtract.outer(np.arange(len(states)), np.arange(len(states)))) > 5
    assert away[apart].min() > 1e-6
    assert max(orbit.residual for orbit in branch.orbits) < 1e-8
