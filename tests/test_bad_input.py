"""Bad input gives a typed error that names the thing and the cure, and gives it at once."""

import time

import numpy as np
import pytest
from scenes import on_stop, paper_beam

import vofem as vf

pytestmark = pytest.mark.kernels("plain")

NAN, INF = float("nan"), float("inf")


def beam(**changes):
    arguments = {"length": 1.0, "EI": 1.0, "rhoA": 1.0, "elements": 4, "supports": {"left": "clamped"}, "name": "deck"}
    return vf.Beam(**{**arguments, **changes})


def contact(**changes):
    arguments = {
        "gap": 0.1, "stiffness": 1.0, "side": "below", "acts_on": "penetration", "name": "stop",
    }  # fmt: skip
    return vf.Contact(beam().at(1.0), **{**arguments, **changes})


def scene(*effects_of, initial=None, **changes):
    b = beam(**changes)
    return b, vf.Scene([b], [effect(b) for effect in effects_of], initial=initial)


BAD_NUMBERS = [-1.0, 0.0, NAN, INF, -INF, 1e300, "1", None, True, [1.0, 2.0], [[], 1.0], 1 + 2j]

NO_NUMBERS = [["1", "2"], [True, False], [1.0, 2j], np.ma.array([1.0, 9e9], mask=[False, True]),
              np.array([1, 2], "m8[s]"), [1.0, 10**400]]  # fmt: skip

CASES = [
    *((lambda v=v: beam(length=v), "Beam 'deck': length") for v in BAD_NUMBERS),
    *((lambda v=v: beam(rhoA=v), "Beam 'deck': rhoA") for v in (-1.0, 0.0, NAN, INF, "x")),
    *((lambda v=v: beam(EI=v), "Beam 'deck': EI") for v in (-1.0, 0.0, NAN, [1.0, 2.0], [1.0, 1.0, NAN, 1.0])),
    (lambda: beam(EI=lambda x: x - 0.5), r"EI is .* at x = .* expected a positive number"),
    (lambda: beam(EI=lambda x: "thick"), "EI must be a callable that takes an array of x"),
    (lambda: beam(tension=NAN), "tension is NaN"),
    *((lambda v=v: beam(elements=v), "elements|node x") for v in (0, -3, 2.5, "x", 10**9, [0.0], [0.0, 0.5, 0.4, 1])),
    (lambda: beam(elements=[0.0, 0.5, 2.0]), "the nodes span 2 m, expected the length 1 m"),
    (lambda: beam(elements=[0.0, NAN, 1.0]), "elements holds nan"),
    (lambda: beam(supports={"left": "welded"}), "expected one of 'clamped', 'pinned', 'guided'"),
    (lambda: beam(supports={"left": "clampd"}), "did you mean 'clamped'"),
    (lambda: beam(supports={"lift": "clamped"}), "did you mean 'left'"),
    (lambda: beam(supports={0.3: "pinned"}), "not a node; the nearest are 0.25 and 0.5 m"),
    (lambda: beam(supports={1.7: "pinned"}), "from 0 to 1 m"),
    (lambda: beam(supports=["left"]), "expected a dict"),
    (lambda: beam(name=""), "expected a non-empty string"),
    (lambda: beam(name="a\ud800"), "not valid Unicode; rename it"),
    (lambda: vf.Spring(beam().at(1.0), stiffness=1.0, name="a\ud800"), "not valid Unicode; rename it"),
    (lambda: vf.simulate(scene()[1], 1.0, probes={"a\ud800": beam().at(1.0)}), "not valid Unicode; rename it"),
    (lambda: beam().at(1.2), r"1.2 m, expected a point on Beam 'deck', from 0 to 1 m"),
    (lambda: beam().at(NAN), "NaN"),
    (lambda: beam().at("tip"), "expected an x or one of 'left', 'right'"),
    *((lambda v=v: vf.Mass(v, name="m"), "Mass 'm': mass") for v in (-1.0, 0.0, NAN, INF)),
    (lambda: vf.Mass(1.0, stiffness=-1.0), "stiffness is -1.0, expected a number that is not negative"),
    (lambda: vf.Mass(1.0, damping=NAN), "damping is NaN"),
    *((lambda v=v: contact(gap=v), "Contact 'stop': gap") for v in (NAN, INF, "wide")),
    (lambda: contact(gap=-0.1, acts_on="displacement"), "a preloaded contact needs acts_on='penetration'"),
    *((lambda v=v: contact(stiffness=v), "Contact 'stop': stiffness") for v in (-1.0, 0.0, NAN, INF)),
    (lambda: contact(damping=-1.0), "damping is -1.0"),
    (lambda: contact(acts_on=None), "acts_on is missing, expected 'displacement'"),
    (lambda: contact(acts_on="penetraton"), "did you mean 'penetration'"),
    (lambda: contact(side=None), "side is missing"),
    (lambda: contact(side="left"), "expected one of 'below', 'above'"),
    (lambda: contact(b=vf.Mass(1.0)), "a contact between two points has none"),
    (lambda: contact(switch="soft"), "expected 'ideal' or vofem.Resolved"),
    (lambda: vf.Resolved(0.0), "s0 is 0.0, expected a positive number"),
    (lambda: vf.Contact(beam(), gap=0.1, stiffness=1.0, side="below", acts_on="penetration"), r"\.at\(x\)"),
    (lambda: vf.PointLoad(3.0, 1.0), "expected a point"),
    (lambda: vf.PointLoad(beam().at(1.0), NAN), "NaN"),
    (lambda: vf.PointLoad(beam().at(1.0), "sine"), "PointLoad: f is .sine., expected a number, a callable"),
    (lambda: vf.PointMoment(vf.Mass(1.0), 1.0), "has no slope"),
    (lambda: vf.RotationalSpring(vf.Mass(1.0), stiffness=1.0), "has no slope"),
    (lambda: vf.DistributedLoad(vf.Mass(1.0), 1.0), "expected a Beam"),
    (lambda: scene(lambda b: vf.DistributedLoad(b, lambda x: x / 0.0 * 0.0))[1].model, "distributed load"),
    (lambda: vf.Spring(beam().at(1.0), stiffness=-1.0), "Spring: stiffness"),
    (lambda: vf.Dashpot(beam().at(1.0), damping=NAN), "Dashpot: damping"),
    (lambda: vf.PointMass(beam().at(1.0), mass=-1.0), "PointMass: mass"),
    (lambda: vf.RayleighDamping(-0.1, 0.0), "alpha"),
    (lambda: vf.ModalDamping(NAN), "ratio"),
    (lambda: vf.Gravity(INF), "Gravity: g"),
    (lambda: vf.Sine(NAN, 1.0), "Sine: amplitude"),
    (lambda: vf.Ramp(1.0, 2.0, 1.0), "expected a time after start"),
    (lambda: vf.Pulse(1.0, 0.0, 0.0), "Pulse: duration"),
    (lambda: vf.Tabulated([0.0, 1.0], [1.0]), "expected two equal"),
    (lambda: vf.Tabulated([0.0, 0.0], [1.0, 2.0]), "must increase strictly"),
    (lambda: vf.Tabulated([0.0, 1e-300, 1.0], [0.0, 1e50, 0.0]), "a slope beyond the range of double precision"),
    (lambda: vf.Tabulated([0.0, 1.0], [1.0, NAN]), "Tabulated: values holds nan"),
    (lambda: vf.Tabulated([], []), "Tabulated: t is empty, expected an array of numbers"),
    *((lambda v=v: vf.Tabulated([0.0, 1.0], v), "(?s)values is .* expected an array of numbers") for v in NO_NUMBERS),
    (lambda: vf.Tabulated([0.0, 1.0], [0.0, 1e61]), "values holds 1e.61 at index .1., expected finite numbers"),
    (lambda: vf.IwanSpring(vf.Mass(1.0), elongation=[], force=[]), "elongation is empty"),
    *((lambda v=v: vf.MeasuredFrequencies(v), "frequencies") for v in ([], [[1.0, 2.0]], ["1"])),
    *((lambda v=v: vf.MeasuredCurve(vf.Mass(1.0), v, v), "frequencies has shape") for v in ([], [[1.0, 2.0]])),
    *((lambda v=v: vf.MeasuredStatics(vf.Mass(1.0), v, v), "times has shape") for v in ([], [[1.0, 2.0]])),
    (lambda: vf.MeasuredEvents("stop", [[1.0, 2.0]]), "closings has shape"),
    (lambda: vf.MeasuredEvents("stop", openings=[-1.0, 2.0]), "none negative"),
    (lambda: vf.Measured(vf.Mass(1.0), [0.0, 1.0], [0.0, 1.0], offset="no"), "offset is 'no', expected True or False"),
    (lambda: vf.Scene([]), "bodies is empty"),
    (lambda: vf.Scene([1.0]), "expected a Beam or a Mass"),
    (lambda: vf.Scene([beam()], ["load"]), "expected a Contact, a load"),
    (lambda: vf.Scene([beam(), beam()]), "named 'deck' occur more than once"),
    (lambda: vf.Scene([beam()], [vf.PointLoad(beam(name="other").at(1.0), 1.0)]), "add it to bodies"),
    (lambda: vf.Scene([beam()], initial={beam(): (0.0, 0.0)}).initial_state(), "not among the bodies"),
    (lambda: scene(lambda b: vf.Gravity(), initial=None, supports={"left": "clamped", "right": "clamped"},
                   elements=1)[1].model, "hold every degree of freedom"),
    (lambda: vf.simulate(scene()[0], 1.0), "expected a vofem.Scene"),
    *((lambda v=v: vf.simulate(scene()[1], v), "t_end") for v in (-1.0, 0.0, NAN, INF, "10 s")),
    (lambda: vf.simulate(scene()[1], 1.0, method="event_drive"), "did you mean 'event_driven'"),
    (lambda: vf.simulate(scene()[1], 1.0, method="event_driven", dt=0.1), "event_driven has no step"),
    (lambda: vf.simulate(scene()[1], 1.0, rho_infinty=0.8), "does not know the option 'rho_infinty'"),
    (lambda: vf.simulate(scene()[1], 1.0, times=[0.0, 2.0]), "within 0 to t_end = 1 s"),
    (lambda: vf.simulate(scene()[1], 1.0, times=[0.5, 0.2]), "does not decrease"),
    (lambda: vf.simulate(scene()[1], 1.0, times=[0.0, NAN]), "times holds nan"),
    *((lambda v=v: vf.simulate(scene()[1], 1.0, method="central_difference", dt=v), "dt")
      for v in (-1e-3, 0.0, NAN, INF)),
    (lambda: vf.modes(scene()[1], 0), "expected a whole number, 1 or more"),
    (lambda: vf.modes(scene()[1], 2, closed=["stop"]), "no contact is named 'stop'"),
    (lambda: vf.equilibrium(scene()[1], t=NAN), "NaN"),
    (lambda: vf.dump_scene(scene()[1], "scene.json"), "expected a name that ends in '.toml'"),
    (lambda: vf.simulate(vf.Scene([m := vf.Mass(1.0)], [vf.RigidStop(m, gap=1.0, restitution=0.5, side="above")]), 1.0,
                         dt=0.1), "leave dt out: no method with steps treats the scene"),
]  # fmt: skip


def run():
    b, short = scene(lambda b: vf.Contact(b.at(1.0), gap=0.1, stiffness=1.0, side="below", acts_on="penetration"),
                     lambda b: vf.PointLoad(b.at(1.0), -1.0))  # fmt: skip
    return b, vf.simulate(short, 1.0)


def in_this_process(study, *arguments, **more):
    return study(*arguments, executor="serial", **more)


# What is no list, no name and no series where one is expected.
CASES += [
    *((lambda v=v: run()[1].along_shape(v), "expected a body or its name")
      for v in (3, [], {}, ["deck"], np.ones((1, 2)))),
    *((lambda v=v: run()[1].contacts[v], "no contact is named") for v in (3, [], {"a": 1}, np.ones(2))),
    (lambda: run()[1].displacement(run()[0].at(1.0), np.ones((2, 2))),
     r"t is an array of shape \(2, 2\), expected a time"),
    *((lambda v=v: next(iter(run()[1].contacts.values())).first_impacts(v), "first_impacts: count is")
      for v in (0, -1.5, "x", [], None)),
    *((lambda v=v: next(iter(run()[1].contacts.values())).first_impacts(3, v), "first_impacts: tolerance is")
      for v in (-1.0, "x", [], None)),
    *((lambda v=v: vf.modes(scene()[1], 2, closed=v), "no contact is named") for v in (3, None, contact())),
    *((lambda v=v: run()[1].to_xarray(v), "to_xarray: a point is") for v in (3, NAN, object())),
    *((lambda v=v: run()[1].save("x.vtkhdf", overwrite=v), "overwrite is .*, expected True or False")
      for v in (None, "no", 0, NAN, np.ones(2))),
    *((lambda k=k, v=v: vf.dump_scene(scene()[1], "x.toml", **{k: v}), f"dump_scene: {k} is .*vf.load_scene returns")
      for k in ("run", "output", "respond") for v in (3, vf.Mass(1.0), run()[1])),
    (lambda: vf.dump_scene(beam(), "x.toml"), "dump_scene: scene is"),
    (lambda: vf.dump_scene(scene()[1], "x.toml", overwrite="no"), "overwrite is 'no', expected True or False"),
    *((lambda v=v: vf.quasi_static(scene()[1], v), "load_factors") for v in ([], "x", [[1.0, 2.0]])),
    *((lambda v=v: in_this_process(vf.bifurcation_diagram, lambda w: scene()[1], v), "bifurcation_diagram: values")
      for v in ("x", {}, [], [[1.0]], [NAN], object())),
    *((lambda v=v: in_this_process(vf.stability_map, lambda x, y: scene()[1], [1.0], v), "stability_map: y")
      for v in ("x", {}, [], [[1.0]], [NAN])),
    *((lambda v=v: in_this_process(vf.basins, scene()[1], v), "basins: grid is .* expected a dict")
      for v in (3, [1.0])),
    *((lambda v=v: vf.accuracy.work_precision(scene()[1], 0.1, **v), words) for v, words in (
        ({"dt": -1.0}, "work_precision: dt"), ({"tol": "x"}, "work_precision: tol"), ({"methods": 3}, "methods is 3"),
        ({"elements": 2.5}, "work_precision: elements"), ({"point": np.ones(2)}, "work_precision: point"))),
]  # fmt: skip


# What a first user got wrong.
CASES += [
    (lambda: vf.Scene(beam()), r"bodies is Beam 'deck': .* write \[\.\.\.\] around it"),
    (lambda: vf.Scene([beam()], contact()), "effects is Contact 'stop'"),
    (lambda: vf.Scene([beam()], [vf.Gravity]), r"write Gravity\(\.\.\.\)"),
    (lambda: vf.Scene([contact()]), "put it into effects"),
    (lambda: vf.Scene([beam()], [vf.Mass(1.0)]), "put it into bodies"),
    (lambda: vf.Scene([beam()], initial=[(0.0, 1.0)]), "expected a dict"),
    (lambda: vf.Scene([beam()], initial={"deck": (0.0, 0.0)}), "use the Beam or Mass object itself"),
    (lambda: vf.DistributedLoad(beam(), vf.Sine(1000.0, 60.0)), "a function of time; give it as f="),
    (lambda: beam(EI=vf.Ramp(1.0)), "a function of time, where a function of x is meant"),
    (lambda: beam(EI=lambda x: 1.0 if x < 0.5 else 2.0), r"use np\.where"),
    (lambda: vf.Contact(beam().at(0.5), beam().at(0.5), gap=0.0, stiffness=1.0), "acts_on is missing"),
    (lambda: vf.Contact(*(2 * [beam().at(0.5)]), gap=0.0, stiffness=1.0, acts_on="penetration"), "are the same point"),
    (lambda: vf.Spring(*(2 * [vf.Mass(1.0)]), stiffness=1.0), "Spring: a and b are the same point"),
    (lambda: vf.Dashpot(*(2 * [beam().at(0.5)]), damping=1.0), "or one alone for an effect between it and ground"),
    (lambda: vf.RotationalSpring(*(2 * [beam().at(0.5)]), stiffness=1.0), "point and other are the same point"),
    (lambda: vf.simulate(scene()[1], 1.0, max_events=-3), "max_events is -3"),
    (lambda: vf.simulate(scene()[1], 1.0, pin_fraction="a"), "pin_fraction is 'a'"),
    (lambda: vf.simulate(scene()[1], 1.0, times=[]), r"times has shape \(0,\)"),
    (lambda: vf.simulate(scene()[1], 1.0, times=1001), "uniform times are np.linspace"),
    (lambda: vf.simulate(scene()[1], 1.0).deflection(beam().at(0.5)), "expected an array of numbers"),
    (lambda: vf.equilibrium(scene()[1]).contacts["x"], "no contact is named 'x'"),
    (lambda: vf.Sine(1.0, 2.0) / 0, "the divisor of a time function is 0"),
    (lambda: vf.simulate(scene()[1], 1.0, method="Newmark"), "HHT are settings of 'generalized_alpha'"),
    (lambda: vf.simulate(scene()[1], 1.0, tolerance=1e-3), "did you mean 'tol'"),
    (lambda: vf.simulate(scene()[1], 1.0, method="energy_conserving", order=2), "it takes nearby"),
    (lambda: vf.simulate(scene()[1], 1.0, probes="tip"), r"probes: a point is 'tip', expected a point: beam.at\(x\)"),
    (lambda: vf.resume("nowhere.checkpoint"), "does not exist, expected a checkpoint of vofem.simulate"),
    (lambda: vf.simulate(scene()[1], 1.0, method=np.array(["event_driven"])), "method is array.* expected one of"),
    (lambda: vf.Scene(np.ma.masked), "bodies is masked, expected a list"),
    (lambda: vf.Scene([beam()], np.array("a")), "effects is array.*, expected a list"),
    (lambda: scene()[1].replace(np.zeros(3), gap=1.0), "is no effect of the scene"),
    (lambda: vf.PointLoad(vf.Mass(1.0), int), "PointLoad: f is <class 'int'>, expected a number, a callable of t"),
    (lambda: vf.PointLoad(vf.Mass(1.0), vf.Sine), r"write Sine\(\.\.\.\)"),
    (lambda: vf.simulate(scene()[1], 1.0, progress=lambda: None),
     "simulate: progress is .* a function of the time reached and t_end; a call says: .*takes 0 positional"),
    (lambda: run()[1].bending_moment(0.5, run()[0], 0.5), "body is 0.5, expected a body or its name, 'deck'; "),
    (lambda: vf.equilibrium(scene()[1]).deflection(run()[0], [0.5]), "body is .0.5., expected a body or its name"),
    (lambda: vf.modes(scene()[1], 2).shape(0, "deck", np.zeros(3)), "body is array.*, expected a body or its name"),
]  # fmt: skip


def test_errors_within_a_function_of_progress_stay_what_they_are():
    def faulty(t, t_end):
        return t + "s"

    with pytest.raises(TypeError, match="unsupported operand"):
        vf.simulate(scene()[1], 1.0, progress=faulty)


def test_load_functions_that_raise():
    for function, message in (
        (lambda t: 1.0 / (0.0 * t), r"raised ZeroDivisionError: .* at t = 5e-05 s"),
        (lambda: 1.0, "must take one time in s"),
        (lambda t, x: 1.0, "must take one time in s"),
    ):
        _, s = paper_beam("penetration", elements=2, load=function)
        with pytest.raises(vf.LoadError, match=message):
            vf.simulate(s, 0.1)


def test_start_from_outcomes_for_some_bodies():
    """A mass dropped on a beam that already sags: the beam starts in its equilibrium, the mass by numbers."""
    deck = vf.Beam(4.0, 2e6, 60.0, 8, {"left": "pinned", "right": "pinned"})
    sag = vf.equilibrium(vf.Scene([deck], [vf.Gravity()]))
    ball = vf.Mass(50.0)
    for start in (sag, (lambda x: sag.deflection(x), 0.0)):
        s = vf.Scene([deck, ball], [vf.Gravity()], initial={deck: start, ball: (0.1, 0.0)})
        result = vf.simulate(s, 0.05)
        middle = result.displacement(deck.at(2.0))
        assert middle == pytest.approx(np.full(middle.shape, sag.displacement(deck.at(2.0))), rel=1e-9)
    with pytest.raises(vf.ArgumentError, match=r"\{body: outcome\}"):
        vf.Scene([deck, ball], initial=sag).initial_state()


@pytest.mark.parametrize(("call", "message"), CASES)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_bad_argument(call, message):
    start = time.process_time()
    with pytest.raises(vf.VofemError, match=message) as caught:
        call()
    assert isinstance(caught.value, ValueError)
    assert time.process_time() - start < 20.0


RAGGED = [[1.0, 2.0], [3.0]]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: beam(EI=RAGGED), "EI is .* expected an array of numbers"),
        (lambda: vf.Measured(vf.Mass(1.0), [0.0], [0.0], RAGGED), "noise is .* expected an array of numbers"),
        (lambda: vf.MeasuredEvents("stop", RAGGED), "closings is .* expected an array of numbers"),
        (lambda: vf.equilibrium(scene()[1]).deflection(RAGGED), "a point of Beam 'deck' is .* an array of numbers"),
        (lambda: vf.simulate(scene()[1], 1.0).bending_moment([[0.0], [1.0]]), "have shape .2, 1., expected one dim"),
        (lambda: vf.modes(scene()[1], 2).shape(None, [0.5]), "k is None, expected a whole number from 0 to 1"),
        (lambda: vf.modes(scene()[1], 2).shape(2, [0.5]), "k is 2, expected a whole number from 0 to 1"),
        (lambda: vf.modes(scene()[1], 2, np.array("stop")), "no contact is named 'stop'"),
        (lambda: vf.fractional.rl_derivative(1.0, [0.0, 1.0], 10**400), "order is 1000.* expected a number"),
    ],
)
def test_what_is_no_array_or_no_number_is_told(call, message):
    with pytest.raises(vf.ArgumentError, match=message):
        call()


def test_no_places_give_no_values():
    outcome = vf.equilibrium(scene()[1])
    assert outcome.deflection([]).shape == outcome.bending_moment([]).shape == outcome.shear_force([]).shape == (0,)


def test_bad_initial_states():
    b = beam()
    for field, message in (
        (3.0, "expected 0"),
        (NAN, "NaN"),
        (lambda x: np.full(x.shape, NAN), "expected a finite number"),
        ("still", "initial displacement"),
    ):
        with pytest.raises(vf.ArgumentError, match=message):
            vf.simulate(vf.Scene([b], initial={b: (field, 0.0)}), 1.0)
    m = vf.Mass(1.0)
    for value, message in ((0.0, "expected a pair"), ((NAN, 0.0), "NaN"), ((lambda x: x, 0.0), "expected a number")):
        with pytest.raises(vf.ArgumentError, match=message):
            vf.simulate(vf.Scene([m], initial={m: value}), 1.0)


def test_an_unsupported_body_has_no_equilibrium():
    free = vf.Beam(1.0, 1.0, 1.0, 4, name="raft")
    with pytest.raises(vf.SingularSystemError, match=r"Beam 'raft' can move freely: its supports do not hold it"):
        vf.equilibrium(vf.Scene([free], [vf.Gravity()]))
    one = vf.Contact(free.at(0.5), gap=0.0, stiffness=1.0, side="below", acts_on="penetration")
    with pytest.raises(vf.SingularSystemError, match="the contacts that carry load do not hold it"):
        vf.equilibrium(vf.Scene([free], [vf.Gravity(), one]))
    # Held by two contacts that gravity closes, it has one; lifted off them it has none.
    two = [vf.Contact(free.at(x), gap=0.0, stiffness=1.0, side="below", acts_on="penetration") for x in (0.2, 0.8)]
    assert vf.equilibrium(vf.Scene([free], [vf.Gravity(2.0), *two])).displacement(free.at(0.2)) < 0
    with pytest.raises(vf.SingularSystemError, match="can move freely"):
        vf.equilibrium(vf.Scene([free], [vf.Gravity(-2.0), *two]))


def test_load_function_that_returns_nan():
    """It is found in the values that the steps need, without many more calls."""
    calls = []

    def fine(t):
        calls.append(t)
        return 0.1

    def bad_at_three(t):
        calls.append(t)
        return NAN if t >= 3.0 else 0.1

    vf.simulate(paper_beam("penetration", load=fine)[1], 5.0, dt=5e-3)
    known = len(calls)
    with pytest.raises(vf.LoadError, match=r"'bad_at_three' returned nan at t = 3") as caught:
        vf.simulate(paper_beam("penetration", load=bad_at_three)[1], 5.0, dt=5e-3)
    assert "division by zero" in str(caught.value)
    assert len(calls) - known < 1.1 * known
    _, s = paper_beam("penetration", load=lambda t: "much")
    with pytest.raises(vf.LoadError, match="expected a number"):
        vf.simulate(s, 1e-2, dt=1e-5)


def test_step_beyond_the_critical_one():
    """The paper's dt = 1e-3 on its beam, which blows up at step 6."""
    _, s = paper_beam("displacement")
    with pytest.raises(vf.StepSizeError, match=r"critical step 5\.344e-05 s") as caught:
        vf.simulate(s, 20.0, method="central_difference", dt=1e-3)
    assert "method='event_driven'" in str(caught.value)


def test_the_critical_step_counts_closed_contacts():
    _, s = on_stop(vf.Mass(1.0, stiffness=1.0), gap=1.0, stiffness=1e4)
    with pytest.raises(vf.StepSizeError, match=r"0\.02 s"):
        vf.simulate(s, 1.0, method="central_difference", dt=0.0201)
    vf.simulate(s, 1.0, method="central_difference", dt=0.0199)


def test_callable_load_and_event_driven():
    _, s = paper_beam("displacement", load=lambda t: 0.1 * np.sin(t))
    with pytest.raises(vf.MethodError, match="Ways out: write it with Sine, Ramp, Pulse, Tabulated") as caught:
        vf.simulate(s, 1.0, method="event_driven")
    assert "vf.Approximated" in str(caught.value)
    assert "energy_conserving" in str(caught.value)


def test_resolved_switch_and_event_driven():
    m = vf.Mass(1.0)
    stop = vf.Contact(
        m, gap=1.0, stiffness=1.0, side="above", acts_on="penetration", switch=vf.Resolved(100.0), name="soft"
    )
    scene = vf.Scene([m], [stop])
    with pytest.raises(vf.MethodError, match="Contact 'soft' has a resolved switch"):
        vf.simulate(scene, 1.0, method="event_driven")
    for name, study in (
        ("backbone", lambda: vf.backbone(scene, 1, [1.0])),
        ("lyapunov", lambda: vf.lyapunov(scene, 1.0)),
    ):
        with pytest.raises(vf.MethodError, match=f"^{name} needs what .*: Contact 'soft' .* needs switch='ideal'$"):
            study()


def test_names_in_results():
    b, s = paper_beam("displacement", elements=5)
    result = vf.simulate(s, 1.0)
    with pytest.raises(vf.ArgumentError, match="did you mean 'stop'"):
        result.contacts["stopp"]
    assert ("stop" in result.contacts, "stopp" in result.contacts) == (True, False)
    with pytest.raises(vf.ArgumentError, match="no body is named 'other'"):
        result.displacement(beam(name="other").at(1.0))
    with pytest.raises(vf.ArgumentError, match="has no support at 'right'"):
        result.reaction(b, "right")
    with pytest.raises(vf.ArgumentError, match="t is 2 s, expected a time of the run, 0 to 1 s"):
        result.deflection([0.5], [2.0])
    with pytest.raises(vf.ArgumentError, match="from 0 to 1 m"):
        result.deflection([1.5], [0.5])
    coarse = vf.simulate(s, 1.0, method="central_difference", times=[0.0, 0.5, 1.0])
    with pytest.raises(vf.ArgumentError, match="name it in times="):
        coarse.deflection([0.5], [0.3])


def test_many_events_end_with_a_typed_error():
    _, s = on_stop(vf.Mass(1.0, stiffness=1.0), gap=0.0, stiffness=1e4, start=(-1.0, 0.0))
    with pytest.raises(vf.EventStormError, match=r"more than 5 contact events .* 'stop'"):
        vf.simulate(s, 100.0, max_events=5)


def test_arrays_that_are_overwritten_later_change_nothing():
    values = np.array([1.0, 2.0])
    table, bar, data = (
        vf.Tabulated([0.0, 1.0], values),
        beam(EI=values, elements=2),
        vf.Measured(vf.Mass(1.0), values, values),
    )
    values[:] = 7.0
    for kept in (table.values, bar.EI, data.times, data.values):
        assert kept.tolist() == [1.0, 2.0]


def test_contact_on_a_support_can_never_move():
    b = beam()
    stop = vf.Contact(b.at(0.0), gap=0.1, stiffness=1.0, side="below", acts_on="penetration")
    with pytest.raises(vf.ArgumentError, match="can never move"):
        vf.simulate(vf.Scene([b], [stop]), 1.0)


@pytest.mark.parametrize("method", ["auto", "energy_conserving"])
@pytest.mark.parametrize("stiffness", [None, 5.0])
def test_friction_on_a_support_can_never_move(method, stiffness):
    b = beam()
    slider = vf.Friction(b.at(0.0), coefficient=0.3, normal=1.0, stiffness=stiffness, name="s")
    with pytest.raises(vf.ArgumentError, match="Friction 's' can never move"):
        vf.simulate(vf.Scene([b], [slider]), 1.0, method=method)


def test_sliders_have_names_of_their_own():
    b = beam()
    sliders = [vf.Friction(b.at(x), coefficient=0.3, normal=1.0, name="s") for x in (0.3, 0.6)]
    with pytest.raises(vf.ArgumentError, match="sliders named 's' occur more than once"):
        vf.simulate(vf.Scene([b], sliders), 1.0)


def test_overflowing_units_are_named():
    with pytest.raises(vf.ArgumentError, match="stiffness matrix overflows"):
        vf.simulate(vf.Scene([beam(EI=lambda x: 1e305, elements=1000)]), 1.0)
    with pytest.raises(vf.ArgumentError, match="length is 1e-100, expected a positive number of at least 1e-60"):
        beam(length=1e-100)
