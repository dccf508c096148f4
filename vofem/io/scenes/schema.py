"""The schema of scene files: an entry for each class, a kind of value for each key. New effects get an entry here."""

from __future__ import annotations

from vofem import effects
from vofem import time_functions as functions
from vofem.bodies import Beam, Mass
from vofem.bodies.beam import SUPPORTS
from vofem.effects.two_points import UNITS
from vofem.fractional import TabulatedOrder
from vofem.io.scenes.beam import Elements, build_beam, values_of_beam
from vofem.io.scenes.entry import Entry
from vofem.io.scenes.kinds import (
    NAME,
    NOT_NEGATIVE,
    NUMBER,
    POSITIVE,
    POSITIVE_BASIS,
    Choice,
    Kind,
    MeshPath,
    NumberOrNumbers,
    Numbers,
    Supports,
    YesOrNo,
)
from vofem.io.scenes.parts import (
    BodyByName,
    Coefficient,
    FunctionOfTime,
    OneOf,
    OrNumber,
    PointByName,
    TimeFunctions,
)
from vofem.io.scenes.switch import Switch
from vofem.polynomial import Polynomial


def _table(*entries: Entry) -> dict[str, Entry]:
    return {entry.name: entry for entry in entries}


# -- values that are tables -------------------------------------------------------------------------

_FUNCTIONS: dict[str, Entry] = {}
TIME_FUNCTION = FunctionOfTime(
    OneOf("a function of time such as { sine = { amplitude = 1.0, omega = 2.0 } }", _FUNCTIONS), functions.Constant
)
_FUNCTIONS |= _table(
    Entry(
        "sine",
        functions.Sine,
        {"amplitude": NUMBER, "omega": NUMBER, "phase": NUMBER, "frequency": NUMBER},
        values=lambda made: {
            "amplitude": made.amplitude,
            **({"omega": made.omega} if made.frequency is None else {"frequency": made.frequency}),
            "phase": made.phase,
        },
    ),
    Entry("constant", functions.Constant, {"value": NUMBER}, bare="value"),
    Entry("ramp", functions.Ramp, {"slope": NUMBER, "start": NUMBER, "stop": NUMBER}),
    Entry("pulse", functions.Pulse, {"amplitude": NUMBER, "start": NUMBER, "duration": POSITIVE}),
    Entry("tabulated", functions.Tabulated, {"t": Numbers(), "values": Numbers()}),
    Entry("sum", functions.Sum, {"terms": TimeFunctions(TIME_FUNCTION)}, bare="terms"),
    Entry("scaled", functions.Scaled, {"function": TIME_FUNCTION, "factor": NUMBER}),
)

_POLYNOMIAL = OneOf(
    "{ polynomial = [a0, a1, ...] }",
    _table(Entry("polynomial", Polynomial, {"coefficients": Numbers()}, bare="coefficients")),
)
#: A number or a polynomial in x.
FIELD = OrNumber(_POLYNOMIAL)
_COEFFICIENT = Coefficient(OrNumber(_POLYNOMIAL, POSITIVE))

_SOFTENING = OneOf("{ linear = { span = 4.0 } }", _table(Entry("linear", effects.LinearSoftening, {"span": POSITIVE})))
_ORDER = OrNumber(
    OneOf(
        "{ tabulated = { x = [t0, t1, ...], orders = [...] } }",
        _table(Entry("tabulated", TabulatedOrder, {"x": Numbers(), "orders": Numbers()})),
    ),
    POSITIVE,
)
_POINT = PointByName()
_OF = Choice(tuple(UNITS))
_BEAM = BodyByName(beam=True)
_SWITCH = Switch(Entry("resolved", effects.Resolved, {"s0": POSITIVE}))
_SIDE = Choice(("below", "above"))

#: The ends of an effect on two points, or on a point and ground, with and without a name.
_ENDS: dict[str, Kind] = {"a": _POINT, "b": _POINT}
_NAMED: dict[str, Kind] = {"name": NAME, **_ENDS}
#: A backbone that softens, see `vofem.HystereticSpring`.
_BACKBONE: dict[str, Kind] = {"stiffness": POSITIVE, "linear_limit": POSITIVE, "softening": _SOFTENING}

# -- bodies -----------------------------------------------------------------------------------------

BODIES = _table(
    Entry(
        "beam",
        Beam,
        {
            "name": NAME,
            "length": POSITIVE_BASIS,
            "elements": Elements(),
            "mesh": MeshPath(),
            "EI": _COEFFICIENT,
            "rhoA": _COEFFICIENT,
            "supports": Supports(tuple(SUPPORTS)),
            "tension": NUMBER,
        },
        build=build_beam,
        values=values_of_beam,
        essential=("mesh",),
    ),
    Entry(
        "mass",
        Mass,
        {"name": NAME, "mass": POSITIVE, "stiffness": NOT_NEGATIVE, "damping": NOT_NEGATIVE},
        needed=("name",),
    ),
)

# -- effects ----------------------------------------------------------------------------------------

EFFECTS = _table(
    Entry(
        "contact",
        effects.Contact,
        {
            **_NAMED,
            "gap": NUMBER,
            "stiffness": POSITIVE,
            "damping": NOT_NEGATIVE,
            "side": _SIDE,
            "acts_on": Choice(("displacement", "penetration")),
            "switch": _SWITCH,
            "of": _OF,
        },
        needed=("acts_on",),
    ),
    Entry("spring", effects.Spring, {**_ENDS, "stiffness": NOT_NEGATIVE, "of": _OF}),
    Entry(
        "hysteretic_spring",
        effects.HystereticSpring,
        {**_NAMED, **_BACKBONE, "memory": Choice(("printed", "cyclic")), "of": _OF},
        needed=("memory",),
    ),
    Entry("crushing_stop", effects.CrushingStop, {**_NAMED, "gap": NUMBER, "side": _SIDE, **_BACKBONE, "of": _OF}),
    Entry(
        "bilinear_spring",
        effects.BilinearSpring,
        {**_NAMED, "stiffness": POSITIVE, "linear_limit": POSITIVE, "hardening": NOT_NEGATIVE, "of": _OF},
    ),
    Entry("iwan_spring", effects.IwanSpring, {**_NAMED, "elongation": Numbers(), "force": Numbers(), "of": _OF}),
    Entry("springpot", effects.Springpot, {**_NAMED, "coefficient": NOT_NEGATIVE, "order": _ORDER, "of": _OF}),
    Entry("joint", effects.Joint, {**_NAMED, "kind": Choice(("rigid", "hinge"))}),
    Entry("dashpot", effects.Dashpot, {**_ENDS, "damping": NOT_NEGATIVE, "of": _OF}),
    Entry("rotational_spring", effects.RotationalSpring, {"point": _POINT, "other": _POINT, "stiffness": NOT_NEGATIVE}),
    Entry("point_mass", effects.PointMass, {"point": _POINT, "mass": NOT_NEGATIVE, "inertia": NOT_NEGATIVE}),
    Entry("point_load", effects.PointLoad, {"point": _POINT, "f": TIME_FUNCTION}),
    Entry("point_moment", effects.PointMoment, {"point": _POINT, "f": TIME_FUNCTION}),
    Entry("distributed_load", effects.DistributedLoad, {"beam": _BEAM, "p": FIELD, "f": TIME_FUNCTION}),
    Entry(
        "foundation",
        effects.Foundation,
        {
            "name": NAME,
            "beam": _BEAM,
            "stiffness": OrNumber(_POLYNOMIAL, NOT_NEGATIVE),
            "one_sided": YesOrNo(),
            "gap": NUMBER,
        },
    ),
    Entry("base_motion", effects.BaseMotion, {"body": BodyByName(), "acceleration": TIME_FUNCTION}),
    Entry("gravity", effects.Gravity, {"g": NUMBER}),
    Entry("rayleigh_damping", effects.RayleighDamping, {"alpha": NOT_NEGATIVE, "beta": NOT_NEGATIVE}),
    Entry("modal_damping", effects.ModalDamping, {"ratio": NumberOrNumbers(NOT_NEGATIVE)}),
)
