"""Runs of every kind, which files, checkpoints and scene files must keep as they are: one line for a new effect."""

import dataclasses

import numpy as np
from scenes import LAWS, alone, cantilever, on_stop, paper_beam, two_masses

import vofem as vf
from vofem.histories.tables import points_of_interest

STEPS = {
    "conserving": {"method": "energy_conserving"},
    "alpha": {"method": "generalized_alpha"},
    "differences": {"method": "central_difference"},
}


def everything():
    """Beams and masses with all that event_driven takes: dampers, a foundation, base motion, tables, tension."""
    beam = vf.Beam(2.0, vf.Polynomial((1.0, 0.5)), 1.0, [1.0, 1.3, 1.7, 2.2, 3.0],
                   {"left": "clamped", 2.2: "pinned"}, tension=0.1, name="bridge")  # fmt: skip
    mass = vf.Mass(0.3, stiffness=2.0, damping=0.05, name="ball")
    table = vf.Tabulated([0.0, 0.7, 2.0], [0.0, 0.4, -0.3])
    effects = [
        vf.Contact(beam.at(1.9), mass, gap=0.004, stiffness=80.0, damping=0.3, acts_on="penetration", name="hit"),
        vf.Foundation(beam, stiffness=3.0, one_sided=True, gap=0.002, name="bed"),
        vf.Spring(beam.at("right"), stiffness=1.0),
        vf.Dashpot(beam.at(1.5), mass, damping=0.02),
        vf.RotationalSpring(beam.at(3.0), stiffness=0.2),
        vf.PointMass(beam.at(2.6), mass=0.1, inertia=0.01),
        vf.RayleighDamping(0.1, 1e-4),
        vf.ModalDamping([0.01, 0.3]),
        vf.BaseMotion(beam, table),
        vf.BaseMotion(mass, table),
        vf.PointLoad(mass, 0.5 * vf.Sine(1.0, 3.0) + vf.Pulse(1.0, 0.5, 0.3)),
        vf.DistributedLoad(beam, vf.Polynomial((1.0, -0.3)), vf.Ramp(0.5, 0.1, 0.9)),
        vf.Gravity(0.1),
    ]
    return vf.Scene([beam, mass], effects, initial={beam: (0.0, lambda x: 0.1 * (x - 1.0) ** 2 * (x - 2.2))})


def chatter():
    """A mass that comes to rest at its gap: hard case of the jump law."""
    ball = vf.Mass(1.0, damping=0.05, name="ball")
    return on_stop(ball, load=0.4, start=(1.0, 0.3), gap=1.0, stiffness=1.0, acts_on="displacement")[1]


def resolved():
    _, scene = paper_beam("penetration", elements=4)
    tip = scene.bodies[0].at(1.0)
    soft = vf.Contact(tip, gap=0.001, stiffness=5.0, damping=0.1, side="above", acts_on="penetration",
                      switch=vf.Resolved(200.0), name="soft")  # fmt: skip
    return vf.Scene(scene.bodies, [*scene.effects, soft])


def printed():
    mass = vf.Mass(1.0, damping=1.0, name="m")
    spring = vf.HystereticSpring(mass, stiffness=1.0, linear_limit=5.0, memory="printed", name="s")
    return alone(mass, spring, load=vf.Sine(7.0, 0.2))[1]


def remembering():
    """Springs that remember on a beam, and springpots of a constant order and of one that varies on a mass."""
    beam, mass = cantilever(2, name="deck"), vf.Mass(1.0, damping=0.1, name="m")
    law = {"stiffness": 3.0, "linear_limit": 0.2}
    aging = vf.fractional.TabulatedOrder([0.0, 2.0], [0.2, 0.9])
    effects = [
        vf.HystereticSpring(beam.at(0.5), **law, memory="cyclic", softening=vf.LinearSoftening(0.5), name="cyclic"),
        vf.IwanSpring(beam.at(1.0), elongation=[0.1, 0.2, 0.5, 1.0], force=[0.5, 0.8, 1.2, 1.4], name="iwan"),
        vf.CrushingStop(beam.at(0.8), gap=0.1, side="below", stiffness=10.0, linear_limit=0.02, name="crushes"),
        vf.BilinearSpring(mass, beam.at(1.0), **law, hardening=0.1, name="yields"),
        vf.Springpot(mass, coefficient=0.7, order=0.5, name="pot"),
        vf.Springpot(mass, coefficient=0.7, order=aging, name="aging"),
        vf.PointLoad(beam.at(1.0), vf.Sine(3.0, 2.0)),
    ]
    return vf.Scene([beam, mass], effects, initial={mass: (0.0, 2.0)})


def sliding():
    """Dry friction, rigid and behind a spring, beside a damped stop and a rigid one; a bushing that turns."""
    block, shaft = vf.Mass(1.0, stiffness=5.0, name="block"), vf.Beam(1.0, 3.0, 1.0, 2, {"left": "clamped"}, name="b")
    effects = [
        vf.Friction(block, coefficient=0.2, normal=2.0, name="plane"),
        vf.Friction(block, coefficient=0.1, static=0.15, normal=2.0, stiffness=300.0, name="spring"),
        vf.Friction(shaft.at(1.0), coefficient=0.1, normal=2.0, belt=vf.Sine(0.1, 2.0), of="rotation", name="bushing"),
        vf.Contact(block, gap=0.1, stiffness=500.0, damping=1.0, side="above", acts_on="penetration", name="soft"),
        vf.RigidStop(block, gap=0.15, restitution=0.7, side="below", name="hard"),
        vf.PointLoad(block, vf.Sine(4.0, 3.0)),
        vf.PointLoad(shaft.at(1.0), vf.Sine(4.0, 3.0)),
    ]
    return vf.Scene([block, shaft], effects)


def pressed():
    """A mass that slides where a contact presses it, and a beam with a rigid slider and one behind a spring."""
    x, y, beam = (
        vf.Mass(1.0, name="x"),
        vf.Mass(1.0, name="y"),
        vf.Beam(1.0, 10.0, 0.5, 2, {"left": "clamped"}, name="b"),
    )
    floor = vf.Contact(y, gap=0.0, stiffness=2e3, side="below", acts_on="penetration", name="floor")
    effects = [
        floor,
        vf.Friction(x, coefficient=0.3, contact=floor, name="pad"),
        vf.Friction(beam.at(0.5), coefficient=0.5, normal=4.0, name="one"),
        vf.Friction(beam.at(1.0), coefficient=0.2, normal=1.0, stiffness=300.0, name="two"),
        vf.PointLoad(y, -9.81),
        vf.PointLoad(beam.at(0.75), vf.Sine(6.0, 9.0)),
    ]
    return vf.Scene([x, y, beam], effects, initial={x: (0.0, 1.0), y: (0.05, 0.0)})


def shaken():
    """Stops in space: a beam on a base that moves, and a mass on a base that does not."""
    beam, mass = cantilever(4, name="b"), vf.Mass(1.0, stiffness=20.0, name="m")
    base = vf.BaseMotion(beam, vf.Sine(0.5, 6.0), displacement=0.0, velocity=-0.05)
    stops = [
        vf.Contact(point, gap=0.01, stiffness=200.0, side="above", acts_on="penetration", frame=frame, name=name)
        for point, frame, name in ((beam.at(1.0), "space", "in space"), (mass, "base", "on the base"))
    ]
    return vf.Scene([beam, mass], [vf.RayleighDamping(0.1, 1e-4), base, *stops], initial={mass: (0.0, 0.2)})


def driving(load=True):
    """A force, or a wheel, that travels along a bridge."""
    bridge = vf.Beam(2.0, 50.0, 1.0, 4, {"left": "pinned", "right": "pinned"}, name="bridge")
    if load:
        path = vf.Path(1.5, start=-0.2, begin=0.1, ends="rigid")
        return vf.Scene([bridge], [vf.PointLoad(bridge.along(path), -4.0)])
    wheel, path = vf.Mass(0.1, name="wheel"), vf.Path(1.0, profile=vf.Polynomial([0.0, 0.01]))
    rail = vf.Contact(bridge.along(path), wheel, gap=0.0, stiffness=1e3, acts_on="penetration", name="rail")
    return vf.Scene([bridge, wheel], [rail, vf.PointLoad(wheel, -1.0)])


def joined():
    """Two beams that cross, joined between their nodes, with a spring and a contact against rotation."""
    a = vf.Beam(1.0, 3.0, 1.5, 3, {"left": "clamped"}, name="a")
    b = vf.Beam(1.4, 1.5, 1.5, 4, {"right": "pinned"}, name="b")
    tip, turned = a.at(1.0), (b.at("left"), a.at("right"))
    effects = [
        vf.Joint(a.at(0.45), b.at(0.8), kind="rigid", name="cross"),
        vf.Spring(*turned, stiffness=2.0, of="rotation"),
        vf.Contact(*turned, gap=0.001, stiffness=80.0, acts_on="penetration", of="rotation", name="turned"),
        vf.Contact(tip, gap=0.05, stiffness=300.0, side="above", acts_on="penetration", name="stop"),
        vf.PointLoad(tip, vf.Sine(1.0, 3.0)),
    ]
    return vf.Scene([a, b], effects)


EVENTS = {"method": "event_driven"}
#: By name: what builds the scene, the end of the run, its options. All but `everything` can be written to scene files.
CASES = {
    "printed": (printed, 40.0, {"method": "force_driven"}),
    **{f"beam-{law}": (lambda law=law: paper_beam(law, elements=6)[1], 12.0, EVENTS) for law in LAWS},
    "beam-steps": (lambda: paper_beam("displacement", elements=5, gap=0.001)[1], 0.5, STEPS["differences"]),
    "masses": (lambda: two_masses("b", "displacement", damping=0.1)[2], 30.0, EVENTS),
    "masses-steps": (lambda: two_masses("c", "penetration")[2], 10.0, STEPS["differences"] | {"times": None}),
    "chatter": (chatter, 50.0, EVENTS),
    "everything": (everything, 4.0, EVENTS),
    "masses-conserving": (lambda: two_masses("b", "penetration")[2], 10.0, STEPS["conserving"]),
    "masses-alpha": (lambda: two_masses("b", "penetration")[2], 10.0, STEPS["alpha"]),
    "masses-tolerance": (lambda: two_masses("b", "penetration")[2], 15.0, STEPS["conserving"] | {"tol": 1e-3}),
    "later": (lambda: paper_beam("penetration", elements=6)[1], 4.0, EVENTS | {"t_start": 1.0}),
    "later-steps": (lambda: paper_beam("penetration", elements=5)[1], 1.0, STEPS["conserving"] | {"t_start": 1.0}),
    "resolved": (resolved, 0.3, STEPS["differences"]),
    "truncated": (lambda: paper_beam("penetration", elements=60)[1], 6.0, EVENTS | {"truncation": 1e-4}),
    "rigid": (lambda: vf.Scene([vf.Beam(1.0, 1.0, 1.0, 3, name="free")], [vf.Gravity()]), 1.0, EVENTS),
    **{f"remembering-{name}": (remembering, 0.8, {**how, "dt": 4e-3}) for name, how in STEPS.items()},
    "remembering-tolerance": (remembering, 0.5, STEPS["conserving"] | {"tol": 3e-3}),
    "sliding": (sliding, 3.0, EVENTS),
    "pressed": (pressed, 0.3, STEPS["conserving"] | {"dt": 2e-3, "nearby": False}),
    "shaken": (shaken, 2.0, EVENTS),
    "shaken-steps": (shaken, 1.0, STEPS["conserving"] | {"dt": 5e-3}),
    "driving": (driving, 1.0, EVENTS),
    "wheel": (lambda: driving(load=False), 0.5, STEPS["conserving"] | {"dt": 5e-3}),
    "joined": (joined, 1.0, EVENTS),
}  # fmt: skip


def ran(name, **more):
    """Run a case, with probes where its method takes steps."""
    build, t_end, options = CASES[name]
    scene = build()
    times = {"times": np.linspace(0.0, t_end, 101)}
    return vf.simulate(scene, t_end, **(times | options | probed(scene, options) | more))


def probed(scene, options):
    """The option that records the first body, in runs that take steps."""
    steps = options["method"] in {how["method"] for how in STEPS.values()}
    return {"probes": points_of_interest(scene)[:1]} if steps and "tol" not in options else {}


def same(a, b):
    return np.array_equal(a, b, equal_nan=True) and np.asarray(a).dtype == np.asarray(b).dtype


HISTORIES = {
    "contacts": ("closings", "openings", "pinned", "closed", "stiffness", "force", "gap_function", "order"),
    "springs": ("elongation", "force", "stored", "dissipated"),
    "frictions": ("force", "slip_speed", "status", "dissipated", "wear_power", "stops", "breaks"),
    "probes": ("times", "displacement", "velocity", "acceleration"),
}


def assert_whole(other, result):
    """Every public quantity is the same to the last bit."""
    assert (other.method, other.notes, other.truncation, other.t_start) == (
        result.method, result.notes, result.truncation, result.t_start
    )  # fmt: skip
    for what in ("steps", "rejected", "events", "contact_solves", "history_terms", "history_updates"):
        assert getattr(other.counters, what) == getattr(result.counters, what)
    assert same(other.times, result.times)
    between = np.unique(np.append(np.linspace(0.0, result.solution.t_end, 137), result.times[::7]))
    exact = result.method == "event_driven"
    for t in (None, between if exact else result.times[3:9]):
        for point in points_of_interest(result.scene):
            for what in ("displacement", "velocity", "acceleration"):
                assert same(getattr(other, what)(point, t), getattr(result, what)(point, t)), (what, point)
        for beam in [body for body in result.scene.bodies if isinstance(body, vf.Beam)]:
            x = np.linspace(beam.nodes[0], beam.nodes[-1], 23)
            for what in ("deflection", "slope", "bending_moment", "shear_force"):
                assert same(getattr(other, what)(x, t, beam), getattr(result, what)(x, t, beam)), what
            for node in beam.supports if t is None or not len(result.springs) else ():
                pair = [run.reaction(beam, float(beam.nodes[node]), t) for run in (other, result)]
                assert same(pair[0].force, pair[1].force)
                assert same(pair[0].moment, pair[1].moment)
    for kind, parts in HISTORIES.items():
        mine, its = getattr(other, kind), getattr(result, kind)
        assert list(mine) == list(its)
        for name, what in ((name, what) for name in its for what in parts):
            assert same(getattr(mine[name], what), getattr(its[name], what)), (kind, name, what)
    assert str(other.impacts()) == str(result.impacts())
    for joint in [effect for effect in result.scene.effects if isinstance(effect, vf.Joint)]:
        assert same(other.joint_force(joint.name).moment, result.joint_force(joint.name).moment)
    for field in dataclasses.fields(result.energy):
        assert same(getattr(other.energy, field.name), getattr(result.energy, field.name)), field.name
    assert other.energy.balance_error == result.energy.balance_error
    if exact:
        late = between[between > 0.6 * between[-1]]
        for one, two in zip(
            *(dataclasses.astuple(run.solution.energies(late)) for run in (other, result)), strict=True
        ):
            assert same(one, two)
        assert other.solution.start_energy == result.solution.start_energy
        if not len(result.frictions):
            assert same(other.sensitivity.growth, result.sensitivity.growth)
    for body in result.scene.bodies:
        for one, two in zip(other.state_of(body.name), result.state_of(body.name), strict=True):
            assert same(one, two)
