"""Parameters: the numbers of a scene by which something is differentiated, or which are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vofem._validate import nearest, number, public, whole
from vofem.bodies.base import Body, Point
from vofem.errors import ArgumentError
from vofem.parameters import Kind, Real, declarations, is_declared
from vofem.parameters.kinds import Either
from vofem.scene import Scene
from vofem.sensitivities.change import INITIAL, LINEAR, PLACES, after, check_field, function_at, initial_pair, point_of


class Parameter:
    """A number that a scene is made of.

    Parameters
    ----------
    target : object, str or list
        A body or an effect of the scene, or its name. The objects of a list are linked: their fields change by the
        same amount.
    field : str
        The attribute that changes: ``"gap"``, ``"stiffness"``, ``"damping"``, ``"mass"``, ``"EI"``, ``"rhoA"``,
        ``"tension"``, ``"alpha"``, ``"beta"``, ``"ratio"``; ``"length"`` of a beam, with which all its nodes and the
        points on it move in proportion; ``"x"``, the place of an effect on a beam, whose mesh stays (``"a.x"`` and
        ``"b.x"``, or ``"point.x"`` and ``"other.x"``, where there are two places); ``"f.amplitude"``, ``"f.omega"``,
        ``"f.phase"`` or ``"f.value"`` of the function of time of a load; ``"initial.displacement"`` and
        ``"initial.velocity"`` of a mass.
    element : int or list of int, optional
        Elements of a beam, counted from 0, whose EI or rhoA changes. Without it all elements change by the same
        amount.
    bounds : (float, float), optional
        Smallest and largest value in a fit; None on one side is no bound.

    Raises
    ------
    ArgumentError
        If the field is not a name, or bounds are not two increasing numbers.

    Notes
    -----
    A parameter at its limit, such as a damper of 0, has a derivative to one side.
    So has the place of what acts on rotations, or has inertia, where it lies at a node: there the curvature of the
    cubics jumps.
    """

    def __init__(
        self,
        target: Any,
        field: str,
        *,
        element: int | Sequence[int] | None = None,
        bounds: tuple[float | None, float | None] | None = None,
    ) -> None:
        if not isinstance(field, str) or not field:
            raise ArgumentError(f"Parameter: field is {field!r}, expected the name of an attribute such as 'gap'")
        targets = tuple(target) if isinstance(target, (list, tuple)) else (target,)
        if not targets:
            raise ArgumentError("Parameter: target is an empty list, expected objects of the scene or their names")
        self.targets: tuple[Any, ...] = targets
        self.field = field
        self.elements: tuple[int, ...] | None = None
        if element is not None:
            if field not in ("EI", "rhoA"):
                raise ArgumentError(f"Parameter: element= is given for {field!r}, expected only with 'EI' or 'rhoA'")
            several = element if isinstance(element, (list, tuple, range, np.ndarray)) else [element]
            self.elements = tuple(whole("Parameter: element", one, 0) for one in several)
            if len(set(self.elements)) != max(len(self.elements), 1):
                raise ArgumentError(f"Parameter: element is {element!r}, expected one or more elements, each once")
        self.bounds = _bounds(bounds)

    @property
    def name(self) -> str:
        """Names of the targets, the elements and the field, such as ``"stop.gap"``."""
        targets = " and ".join(map(_label, self.targets))
        place = "" if self.elements is None else f"[{', '.join(str(k) for k in self.elements)}]"
        return f"{targets}.{self.field}{place}"

    def describe(self) -> str:
        """Return name and bounds."""
        limits = "" if self.bounds == (-np.inf, np.inf) else f" in [{self.bounds[0]:g}, {self.bounds[1]:g}]"
        return f"Parameter {self.name}{limits}"

    # -- in a scene -------------------------------------------------------------------------------

    def found(self, scene: Scene) -> tuple[Any, ...]:
        """Return the bodies and effects of a scene that are the targets.

        Raises
        ------
        ArgumentError
            If a target is not in the scene or named twice, or a name fits none or several of its objects.
        """
        things = (*scene.bodies, *scene.effects)
        found = tuple(_lookup(self, things, target) for target in self.targets)
        if len(set(map(id, found))) < len(found):
            raise ArgumentError(f"Parameter {self.name}: an object is named twice; name each of them once")
        return found

    def carried(self, scene: Scene, other: Scene) -> Parameter:
        """Return the parameter of a scene as that of another scene, whose objects are in the same order."""
        things, same = (*scene.bodies, *scene.effects), (*other.bodies, *other.effects)
        places = [next(k for k, thing in enumerate(things) if thing is target) for target in self.found(scene)]
        return Parameter([same[k] for k in places], self.field, element=self.elements, bounds=self.bounds)

    def check(self, scene: Scene) -> None:
        """Raise an error if the scene has no number at this place.

        Raises
        ------
        ArgumentError
            If a target is not in the scene, or its field is unknown or a Python function.
        """
        for thing in self.found(scene):
            check_field(scene, thing, self.field, self.elements)

    def value(self, scene: Scene) -> float:
        """Return the number in a scene; of several, that of the first target or element.

        Raises
        ------
        ArgumentError
            As `check`.
        """
        self.check(scene)
        return float(self._numbers(scene, self.found(scene)[0])[0])

    def limits(self, scene: Scene) -> tuple[float, float]:
        """Return the least and the largest value at which no linked number leaves its own range."""
        first, low, high = self.value(scene), -np.inf, np.inf
        for thing in self.found(scene):
            kind = Parameter(thing, self.field).kind(scene)
            kind = kind.forms()[0] if isinstance(kind, Either) else kind
            least, most = kind.ends if isinstance(kind, Real) else (-np.inf, np.inf)
            least = getattr(thing, f"least_{self.field}", least)
            if self.field in PLACES:
                least, most = getattr(thing, point_of(thing, self.field)).body.shape.x[[0, -1]].tolist()
            numbers = self._numbers(scene, thing)
            low = max(low, least + (first - np.min(numbers)))
            high = min(high, most + (first - np.max(numbers)))
        return low, high

    def _numbers(self, scene: Scene, thing: Any) -> Any:
        """Return the numbers of a target, shape (k,): those of the chosen elements."""
        if self.field in INITIAL:
            found: Any = initial_pair(scene, thing)[INITIAL.index(self.field)]
        elif self.field in PLACES:
            found = getattr(thing, point_of(thing, self.field)).x
        elif (known := function_at(thing, self.field)) is not None:
            found = getattr(known[1], known[2])
        else:
            found = getattr(thing, self.field)
        numbers = np.atleast_1d(np.asarray(found, dtype=float))
        return numbers if self.elements is None or numbers.size == 1 else numbers[list(self.elements)]

    def unit(self, scene: Scene) -> str:
        """Return the unit of the number."""
        thing = self.found(scene)[0]
        units = getattr(thing, "units", None)
        if units is not None and self.field in ("gap", "stiffness", "damping"):
            return str(getattr(units, "coordinate" if self.field == "gap" else self.field))
        if self.field in PLACES:
            return "m"
        if self.field in INITIAL:
            return ("m", "m/s")[INITIAL.index(self.field)]
        known = function_at(thing, self.field)
        if known is not None and known[2] in ("amplitude", "value", "slope"):
            load = getattr(_kind(thing, known[0]), "unit", "")
            return f"{load or '1'}/s" if known[2] == "slope" else str(load)
        return str(getattr(self.kind(scene), "unit", ""))

    def kind(self, scene: Scene) -> Kind | None:
        """Return the declared kind of the number; None where it has none."""
        thing = self.found(scene)[0]
        known = function_at(thing, self.field)
        return _kind(thing, self.field) if known is None else _kind(*known[1:3])

    def changed(self, scene: Scene, amount: float) -> Scene:
        """Return the scene with the number of every target changed by an amount."""
        for thing in self.found(scene):
            scene = after(scene, thing, self.field, self.elements, amount)
        return scene

    def at(self, scene: Scene, value: float) -> Scene:
        """Return the scene with the number at a value; linked ones keep their differences.

        Raises
        ------
        ArgumentError
            As `check`, or if the value is out of the range of the field.
        """
        return self.changed(scene, value - self.value(scene))

    @property
    def linear(self) -> bool:
        """Whether the equations of motion are linear in the number."""
        return self.field in INITIAL or self.field.rsplit(".", 1)[-1] in LINEAR


public(Parameter)


def names_of(parameters: Sequence[Parameter]) -> list[str]:
    """Return the names of parameters, numbered where several have one, as those of unnamed loads at a point."""
    names = [parameter.name for parameter in parameters]
    numbers = [f" ({names[: k + 1].count(name)})" if names.count(name) > 1 else "" for k, name in enumerate(names)]
    return [name + number for name, number in zip(names, numbers, strict=True)]


def _label(target: Any) -> str:
    """Return the name of a target; of an effect that has none, its class and what it acts on."""
    name = target if isinstance(target, str) else getattr(target, "name", None)
    on = ", ".join(one.name if isinstance(one, Body) else f"{one.body.name}@{one.x:g}"
                   for one in getattr(target, "__dict__", {}).values() if isinstance(one, (Point, Body)))  # fmt: skip
    return str(name or f"{type(target).__name__}({on})".removesuffix("()"))


def _kind(thing: Any, name: str) -> Kind | None:
    """Return the declared kind of an attribute; None where it has none."""
    declared = declarations(type(thing)).get(name) if is_declared(type(thing)) else None
    return None if declared is None else declared.kind


def parameters_of(what: str, parameters: Any, scene: Scene) -> tuple[Parameter, ...]:
    """Return parameters as a tuple, checked against a scene.

    Raises
    ------
    ArgumentError
        For something else than parameters, none at all, or a field that the scene does not have.
    """
    several = (parameters,) if isinstance(parameters, Parameter) else parameters
    if not isinstance(several, (list, tuple)) or not several or any(not isinstance(p, Parameter) for p in several):
        raise ArgumentError(f"{what}: parameters is {parameters!r}, expected a list of vofem.Parameter")
    for parameter in several:
        parameter.check(scene)
    return tuple(several)


def _lookup(parameter: Parameter, things: tuple[Any, ...], target: Any) -> Any:
    """Return the object of a scene that a target is or names."""
    if not isinstance(target, str):
        if any(thing is target for thing in things):
            return target
        # The scenes of a branch are built anew, so an object stands for the one of its class and name.
        target_name = getattr(target, "name", None)
        same = [t for t in things if type(t) is type(target) and getattr(t, "name", None) == target_name]
        if len(same) == 1:
            return same[0]
        raise ArgumentError(
            f"{parameter.describe()}: {target!r} is not in the scene; give one of its bodies or effects"
        )
    named = [thing for thing in things if getattr(thing, "name", None) == target]
    if len(named) != 1:
        names = tuple(str(thing.name) for thing in things if isinstance(getattr(thing, "name", None), str))
        count = "no object of the scene has" if not named else f"{len(named)} objects of the scene have"
        cure = nearest(target, names) if not named else "; give the object itself"
        listed = ", ".join(map(repr, names)) or "none"
        raise ArgumentError(f"{parameter.describe()}: {count} the name {target!r}; there are {listed}{cure}")
    return named[0]


def _bounds(bounds: Any) -> tuple[float, float]:
    """Return both bounds as numbers, infinite where there is none."""
    if bounds is None:
        return -np.inf, np.inf
    if not isinstance(bounds, (list, tuple)) or len(bounds) != 2:
        raise ArgumentError(f"Parameter: bounds is {bounds!r}, expected (smallest, largest)")
    low = -np.inf if bounds[0] is None else number("Parameter: bounds[0]", bounds[0], finite=False)
    high = np.inf if bounds[1] is None else number("Parameter: bounds[1]", bounds[1], finite=False)
    if not low < high:
        raise ArgumentError(f"Parameter: bounds is {bounds!r}, expected two increasing numbers")
    return low, high
