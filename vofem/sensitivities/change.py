"""A scene with one number changed: the mechanism behind every derivative of a system by a parameter."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

from vofem._validate import nearest
from vofem.bodies.base import Body, Point, touching
from vofem.bodies.beam import Beam
from vofem.bodies.path import TravellingPoint
from vofem.errors import ArgumentError
from vofem.parameters import changed
from vofem.scene import Scene
from vofem.time_functions import Constant, Pulse, Ramp, Sine, TimeFunction, as_time_function
from vofem.time_functions.base import Scaled

#: Fields in which matrices, rows, gaps and load vectors are linear.
LINEAR = (
    "gap", "stiffness", "damping", "mass", "inertia", "EI", "rhoA", "tension", "alpha", "beta", "ratio", "g", "p",
    "restitution",
)  # fmt: skip
INITIAL = ("initial.displacement", "initial.velocity")
#: The place of an effect on a beam.
PLACES = ("x", "a.x", "b.x", "point.x", "other.x")
#: Attributes of effects that are functions of time.
FUNCTIONS = ("f", "acceleration")
#: Numbers of functions of time by which their closed form is differentiated.
_OF_FUNCTIONS = {
    Sine: ("amplitude", "omega", "phase"), Constant: ("value",), Ramp: ("slope",), Pulse: ("amplitude",),
    Scaled: ("factor",),
}  # fmt: skip


def check_field(scene: Scene, thing: Any, field: str, elements: tuple[int, ...] | None) -> None:
    """Raise an error if an object of a scene has no such number."""
    label = thing.describe()
    if field in INITIAL:
        initial_pair(scene, thing)
        return
    if field in PLACES:
        point_of(thing, field)
        return
    if field == "length":
        if not isinstance(thing, Beam) or not thing.nodes[0] == thing.origin:
            raise _unknown(thing, field)
        _check_length(thing)
        return
    if function_at(thing, field) is not None:
        return
    value = _given(thing, field)
    if field not in LINEAR or value is None:
        raise _unknown(thing, field)
    if callable(value):
        raise ArgumentError(
            f"{label}: {field} is a Python function, by which nothing can be differentiated; give one number for each "
            "element, or a number"
        )
    if elements is not None:
        count = thing.element_lengths.size if isinstance(thing, Beam) else 0
        wrong = [k for k in elements if k >= count]
        if wrong:
            raise ArgumentError(f"{label}: there is no element {wrong[0]}; elements count from 0 to {count - 1}")


def _given(thing: Any, name: str) -> Any:
    """Return a number of an object; None where it has none, such as the gap of a two-sided foundation."""
    return None if name == "gap" and not getattr(thing, "one_sided", True) else getattr(thing, name, None)


def _unknown(thing: Any, field: str) -> ArgumentError:
    known = [name for name in LINEAR if _given(thing, name) is not None]
    if isinstance(thing, Beam):
        known.append("length")
    elif isinstance(thing, Body):
        known += INITIAL
    for name in FUNCTIONS:
        if (value := _function(thing, name)) is not None:
            known += [f"{name}.{part}" for kind, parts in _OF_FUNCTIONS.items() if isinstance(value, kind)
                      for part in parts]  # fmt: skip
    points = _points(thing)
    known += ["x"] if len(points) == 1 else [f"{name}.x" for name in points]
    return ArgumentError(
        f"{thing.describe()}: there is no number {field!r} by which to differentiate{nearest(field, tuple(known))}; "
        f"there are {known or 'none'}"
    )


def _check_length(beam: Beam) -> None:
    why = ""
    if beam.mesh is not None:
        why = "its nodes come from a mesh file; give their x as elements="
    elif callable(beam.EI) or callable(beam.rhoA):
        why = "EI or rhoA is a Python function of x; give one number for each element"
    if why:
        raise ArgumentError(f"{beam.label}: its length is no parameter, because {why}")


# -- functions of time --------------------------------------------------------------------------------


def function_at(thing: Any, field: str) -> tuple[str, Any, str, tuple[str, ...]] | None:
    """Return where a field lies in a function of time: attribute of the object, innermost function, its field, path.

    None if the field is not in a function of time.
    """
    first, _, rest = field.partition(".")
    function = _function(thing, first)
    if function is None:
        return None
    path = tuple(rest.split(".")) if rest else (("value",) if isinstance(function, Constant) else ())
    inner: Any = function
    for step in path[:-1]:
        parts = {str(k): one for k, one in enumerate(inner)} if isinstance(inner, tuple) else {}
        inner = parts.get(step) if parts else getattr(inner, step, None)
    known = next((names for kind, names in _OF_FUNCTIONS.items() if isinstance(inner, kind)), ())
    if not path or path[-1] not in known:
        if not function.closed_form:
            raise ArgumentError(
                f"{thing.describe()}: {first} is a Python function, by which nothing can be differentiated; write it "
                "with Sine, Constant, Ramp, Pulse and their sums"
            )
        raise ArgumentError(
            f"{thing.describe()}: {field!r} is no number by which to differentiate; of {inner or function!r} there are "
            f"{list(known) or 'none'}"
        )
    return first, inner, path[-1], path


def _function(thing: Any, name: str) -> TimeFunction | None:
    """Return the function of time that an attribute of an effect is; numbers are constants."""
    value = getattr(thing, name, None)
    if isinstance(value, TimeFunction):
        return value
    return as_time_function(value) if value is not None and name in FUNCTIONS else None


def with_function(function: Any, path: tuple[str, ...], change: Any) -> Any:
    """Return a function of time whose innermost function is replaced by ``change(innermost)``."""
    if len(path) == 1:
        return change(function)
    step, rest = path[0], path[1:]
    if isinstance(function, tuple):
        k = int(step)
        return (*function[:k], with_function(function[k], rest, change), *function[k + 1 :])
    return changed(function, **{step: with_function(getattr(function, step), rest, change)})


# -- places and initial states ------------------------------------------------------------------------


def _points(thing: Any) -> list[str]:
    """Return the attributes that are points at rest on a beam; a mass, which is its own point, is none."""
    return [name for name, value in vars(thing).items()
            if isinstance(value, Point) and not isinstance(value, (Body, TravellingPoint))]  # fmt: skip


def point_of(thing: Any, field: str) -> str:
    """Return the attribute that holds the point on a beam that a field such as "x" means."""
    points = _points(thing)
    first = field.partition(".")[0]
    if first != "x" and first in points:
        return first
    if first != "x" or len(points) != 1:
        why = "there is " + (" and ".join(f"{name}.x" for name in points) or "no point on a beam")
        if any(isinstance(value, TravellingPoint) for value in vars(thing).values()):
            why = "the point travels along the beam; give its path another start in the scene"
        raise ArgumentError(f"{thing.describe()}: {field!r} is not the place of one point, because {why}")
    return points[0]


def path_of(thing: Any, field: str) -> tuple[str, ...]:
    """Return the path of the number that a field means, the same for all names of it, such as "x" and "point.x"."""
    if field in PLACES:
        return point_of(thing, field), "x"
    known = function_at(thing, field)
    return (field,) if known is None else (known[0], *known[3])


def initial_pair(scene: Scene, body: Any) -> tuple[float, float]:
    """Return displacement and velocity of a body with one degree of freedom at t = 0."""
    if not isinstance(body, Body) or body.size != 1:
        raise ArgumentError(
            f"{body.describe()}: an initial state is a parameter only for a Mass, whose state is one pair of numbers"
        )
    state = scene.initial
    if isinstance(state, Mapping):
        state = state.get(body, (0.0, 0.0))
    if state is None:
        return 0.0, 0.0
    if hasattr(state, "state_of"):
        q, v = state.state_of(body.name)
        return float(q[0]), float(v[0])
    return float(state[0]), float(state[1])


# -- the change ---------------------------------------------------------------------------------------


def after(scene: Scene, thing: Any, field: str, elements: tuple[int, ...] | None, amount: float) -> Scene:
    """Return a scene in which a number of one of its objects has grown by an amount."""
    if field in INITIAL:
        return _with_initial(scene, thing, field, amount)
    if isinstance(thing, Body):
        return _with_body(scene, thing, field, elements, amount)
    if field in PLACES:
        name = point_of(thing, field)
        point = getattr(thing, name)
        new = copy.copy(thing)
        setattr(new, name, point.body.at(point.x + amount))
    elif (known := function_at(thing, field)) is not None:
        first, _, last, path = known
        function = with_function(
            _function(thing, first), path, lambda f: changed(f, **{last: getattr(f, last) + amount})
        )
        new = copy.copy(thing)
        setattr(new, first, function)
    else:
        new = changed(thing, **{field: getattr(thing, field) + amount})
    effects = [new if effect is thing else effect for effect in scene.effects]
    return Scene(scene.bodies, effects, scene.initial)


def _with_body(scene: Scene, body: Any, field: str, elements: tuple[int, ...] | None, amount: float) -> Scene:
    stretch = (body.length + amount) / body.length if field == "length" else 1.0
    new = _stretched(body, stretch) if field == "length" else _numbered(body, field, elements, amount)
    bodies = [new if one is body else one for one in scene.bodies]
    effects = [
        touching(effect, {body: new}, lambda point, to: moved_point(point, to, stretch)) for effect in scene.effects
    ]
    initial = scene.initial
    if isinstance(initial, Mapping):
        initial = {new if one is body else one: state for one, state in initial.items()}
    return Scene(bodies, effects, initial)


def _stretched(beam: Beam, stretch: float) -> Any:
    """Return a beam whose elements are longer by a factor."""
    if np.ndim(beam.elements) == 0:
        return changed(beam, length=beam.length * stretch)
    nodes = beam.origin + (beam.nodes - beam.origin) * stretch
    return changed(beam, elements=nodes, length=nodes[-1] - nodes[0])


def _numbered(body: Any, field: str, elements: tuple[int, ...] | None, amount: float) -> Any:
    """Return a body with a number changed, or with those of some elements."""
    value = getattr(body, field)
    if elements is None:
        return changed(body, **{field: value + amount})
    each = np.array(np.broadcast_to(value, body.element_lengths.shape), dtype=float)
    np.add.at(each, list(elements), amount)
    return changed(body, **{field: each})


def moved_point(point: Any, new: Any, stretch: float) -> Any:
    """Return a point on a changed body, at the same fraction of its length."""
    origin = getattr(new, "origin", 0.0)
    return new.at(min(origin + (point.x - origin) * stretch, origin + new.length) if stretch != 1.0 else point.x)


def _with_initial(scene: Scene, body: Any, field: str, amount: float) -> Scene:
    states = list(initial_pair(scene, body))
    states[INITIAL.index(field)] += amount
    given = scene.initial
    initial: dict[Any, Any] = dict(given) if isinstance(given, Mapping) else {}
    if given is not None and not isinstance(given, Mapping):
        initial = {one: given for one in scene.bodies}
    initial[body] = tuple(states)
    return Scene(scene.bodies, scene.effects, initial)
