"""A scene: bodies, effects and an initial state. It compiles to a System with nothing that was not declared."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from vofem.assembly import Effect, Model, SystemBuilder
from vofem.bodies.base import Body
from vofem.effects.base_motion import BaseMotion
from vofem.effects.contact import Contact
from vofem.errors import ArgumentError
from vofem.laws import SpringpotLaws, gathered_past
from vofem.system import State


def as_scene(what: str, value: Any) -> Scene:
    """Return `value` if it is a Scene, else raise `ArgumentError` naming `what`."""
    if isinstance(value, Scene):
        return value
    raise ArgumentError(f"{what}: scene is {value!r}, expected a vofem.Scene; put bodies and effects into one")


class StateSource(Protocol):
    """An earlier outcome that a scene can start from: an `Equilibrium` or a `Result`."""

    def state_of(self, body_name: str) -> tuple[Any, Any]:
        """Return a body's degrees of freedom and their rates, each of shape (size,)."""


class Scene:
    """What is simulated.

    Parameters
    ----------
    bodies : iterable of Beam and Mass
    effects : iterable of effects
        Contacts, attachments, loads, damping. All their points must lie on
        bodies of the scene.
    initial : dict or outcome, optional
        ``{body: (displacement, velocity)}``: numbers for a mass, callables of
        an array x (of any shape) for a beam. Zero where silent. The outcome of
        `vofem.equilibrium` or of an earlier run, of bodies with the same names,
        serves for all bodies, or for one: ``{beam: outcome}``; springs with
        memory of the same names go on with their past, springpots begin anew.

    Raises
    ------
    ArgumentError
        For an unknown thing, a name used twice, a point on a body that is not
        in the scene.
    """

    def __init__(
        self,
        bodies: Iterable[Any],
        effects: Iterable[Any] = (),
        initial: Mapping[Any, tuple[Any, Any]] | StateSource | None = None,
    ) -> None:
        self.bodies: tuple[Body, ...] = _as_tuple("bodies", bodies)
        self.effects: tuple[Effect, ...] = _as_tuple("effects", effects)
        self.initial = initial
        self._check()

    def _check(self) -> None:
        if not self.bodies:
            raise ArgumentError("Scene: bodies is empty, expected at least one Beam or Mass")
        for body in self.bodies:
            if not isinstance(body, Body) or isinstance(body, type):
                cure = "; put it into effects" if hasattr(body, "compile") else ""
                raise ArgumentError(f"Scene: bodies holds {_shown(body)}, expected a Beam or a Mass{cure}")
        for effect in self.effects:
            if isinstance(effect, type) or not hasattr(effect, "compile") or not hasattr(effect, "points"):
                cure = "; put it into bodies" if isinstance(effect, Body) else ""
                cure = f"; write {effect.__name__}(...)" if isinstance(effect, type) else cure
                raise ArgumentError(
                    f"Scene: effects holds {_shown(effect)}, expected a Contact, a load, a spring, ...{cure}"
                )
        self._check_names("bodies", [body.name for body in self.bodies])
        self._check_names("contacts", [contact.name for contact in self.contacts])
        self._check_bases()
        self._check_initial()
        present = set(self.bodies)
        for effect in self.effects:
            for point in effect.points():
                if point.body not in present:
                    known = ", ".join(body.label for body in self.bodies)
                    raise ArgumentError(
                        f"{effect.describe()}: its body is not in the scene, which holds {known}; add it to bodies"
                    )

    def _check_bases(self) -> None:
        """Raise where something joins bodies whose bases move differently: their gap would depend on time."""
        motions = [effect for effect in self.effects if isinstance(effect, BaseMotion)]
        if not motions:
            return
        for effect in self.effects:
            on = [[m.acceleration for m in motions if m.body is point.body] for point in effect.points()]
            if len(on) == 2 and on[0] != on[1]:
                raise ArgumentError(
                    f"{effect.describe()}: it joins bodies of which only one has this BaseMotion; displacements are "
                    "counted from the base, so give both bodies the same acceleration"
                )

    def _check_initial(self) -> None:
        if self.initial is None or hasattr(self.initial, "state_of"):
            return
        if not isinstance(self.initial, Mapping):
            raise ArgumentError(
                f"Scene: initial is {self.initial!r}, expected a dict {{body: (displacement, velocity)}}, "
                "an Equilibrium or a Result"
            )
        present = {id(body) for body in self.bodies}
        for body, value in self.initial.items():
            if id(body) not in present:
                cure = "; use the Beam or Mass object itself, not its name" if isinstance(body, str) else ""
                raise ArgumentError(f"Scene: initial names {body!r}, which is not among the bodies{cure}")
            if not hasattr(value, "state_of") and not (isinstance(value, (tuple, list)) and len(value) == 2):
                raise ArgumentError(
                    f"Scene: initial of {body.label} is {value!r}, expected a pair (displacement, velocity), "
                    "an Equilibrium or a Result"
                )

    @staticmethod
    def _check_names(what: str, names: list[str]) -> None:
        twice = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
        if twice:
            raise ArgumentError(f"Scene: {what} named {twice[0]!r} occur more than once; give each its own name")

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts among the effects, in order."""
        return tuple(effect for effect in self.effects if isinstance(effect, Contact))

    @cached_property
    def model(self) -> Model:
        """The scene compiled: assembled once, when first needed."""
        builder = SystemBuilder(self.bodies)
        for effect in self.effects:
            effect.compile(builder)
        return builder.build()

    def initial_state(self) -> State:
        """Return the state at t = 0 over the free degrees of freedom."""
        model = self.model
        q, v = np.zeros(model.size), np.zeros(model.size)
        for body in self._starting():
            start = model.offsets[body]
            part = slice(start, start + body.size)
            q[part], v[part] = self._start_of(body)
        return State(q[model.free], v[model.free], self._past())

    def _past(self) -> Any:
        """Return the state of springs with memory in the outcome that the scene starts from, or None."""
        if self.initial is None:
            return None

        def known(name: str) -> Any:
            source = self._source_of(name)
            return source.spring_state(name) if hasattr(source, "spring_state") else None

        return gathered_past(self.model.system.laws, known)

    def forgotten(self) -> tuple[str, ...]:
        """Return the names of springpots whose past in the run that the scene starts from is not carried on."""
        springpots = self.model.system.group(SpringpotLaws)
        if springpots is None or self.initial is None:
            return ()
        return tuple(name for name in springpots.names if name in getattr(self._source_of(name), "springs", ()))

    def _source_of(self, spring: str) -> Any:
        if not isinstance(self.initial, Mapping):
            return self.initial
        bodies = [effect.points()[0].body for effect in self.effects if getattr(effect, "name", None) == spring]
        return self.initial.get(bodies[0]) if bodies else None

    def _starting(self) -> tuple[Body, ...]:
        if self.initial is None:
            return ()
        if not isinstance(self.initial, Mapping):
            return self.bodies
        return tuple(body for body in self.bodies if body in self.initial)

    def _start_of(self, body: Body) -> tuple[Any, Any]:
        source: Any = self.initial[body] if isinstance(self.initial, Mapping) else self.initial
        if not hasattr(source, "state_of"):
            return (
                body.interpolate(source[0], "initial displacement"),
                body.interpolate(source[1], "initial velocity"),
            )
        q, v = source.state_of(body.name)
        if np.shape(q) != (body.size,):
            raise ArgumentError(
                f"Scene: initial has {np.shape(q)[0]} degrees of freedom for {body.label}, expected {body.size}; "
                "start from a scene with the same mesh"
            )
        return q, v


def _as_tuple(what: str, things: Any) -> tuple[Any, ...]:
    if isinstance(things, (str, bytes)) or not isinstance(things, Iterable):
        raise ArgumentError(f"Scene: {what} is {_shown(things)}, expected a list of {what}; write [...] around it")
    return tuple(things)


def _shown(thing: Any) -> str:
    """Return a thing as a message shows it: as `vofem.explain` does where it can."""
    if not isinstance(thing, type) and hasattr(thing, "describe"):
        return str(thing.describe())
    return repr(thing)
