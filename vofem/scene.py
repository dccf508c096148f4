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
        an array x for a beam. Zero where silent. Or the outcome of
        `vofem.equilibrium` or of an earlier run, of bodies with the same names.

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
        self.bodies: tuple[Body, ...] = tuple(bodies)
        self.effects: tuple[Effect, ...] = tuple(effects)
        self.initial = initial
        self._check()

    def _check(self) -> None:
        if not self.bodies:
            raise ArgumentError("Scene: bodies is empty, expected at least one Beam or Mass")
        for body in self.bodies:
            if not isinstance(body, Body):
                raise ArgumentError(f"Scene: bodies holds {body!r}, expected a Beam or a Mass")
        for effect in self.effects:
            if not hasattr(effect, "compile") or not hasattr(effect, "points"):
                raise ArgumentError(f"Scene: effects holds {effect!r}, expected a Contact, a load, a spring, ...")
        self._check_names("bodies", [body.name for body in self.bodies])
        self._check_names("contacts", [contact.name for contact in self.contacts])
        self._check_bases()
        for effect in self.effects:
            for point in effect.points():
                if point.body not in self.bodies:
                    known = ", ".join(body.label for body in self.bodies)
                    raise ArgumentError(
                        f"{effect.describe()}: its body is not in the scene, which holds {known}; add it to bodies"
                    )

    def _check_bases(self) -> None:
        """Raise where something joins bodies whose bases move differently: their gap would depend on time."""
        bases = {
            id(body): [e for e in self.effects if isinstance(e, BaseMotion) and e.body is body] for body in self.bodies
        }
        for effect in self.effects:
            on = [[motion.acceleration for motion in bases.get(id(point.body), [])] for point in effect.points()]
            if len(on) == 2 and on[0] != on[1]:
                raise ArgumentError(
                    f"{effect.describe()}: it joins bodies of which only one has this BaseMotion; displacements are "
                    "counted from the base, so give both bodies the same acceleration"
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
        return State(q[model.free], v[model.free])

    def _starting(self) -> tuple[Body, ...]:
        if self.initial is None:
            return ()
        if not isinstance(self.initial, Mapping):
            return self.bodies
        for body in self.initial:
            if body not in self.bodies:
                raise ArgumentError(f"Scene: initial names {body!r}, which is not among the bodies")
        return tuple(body for body in self.bodies if body in self.initial)

    def _start_of(self, body: Body) -> tuple[Any, Any]:
        if not isinstance(self.initial, Mapping):
            assert self.initial is not None
            q, v = self.initial.state_of(body.name)
            if np.shape(q) != (body.size,):
                raise ArgumentError(
                    f"Scene: initial has {np.shape(q)[0]} degrees of freedom for {body.label}, "
                    f"expected {body.size}; start from a scene with the same mesh"
                )
            return q, v
        value = self.initial[body]
        if not isinstance(value, (tuple, list)) or len(value) != 2:
            raise ArgumentError(
                f"Scene: initial of {body.label} is {value!r}, expected a pair (displacement, velocity)"
            )
        return (
            body.interpolate(value[0], "initial displacement"),
            body.interpolate(value[1], "initial velocity"),
        )
