"""Initial states of bodies: numbers, fields along beams, or the state at the end of an earlier outcome."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from vofem._validate import unknown
from vofem.arrays import Array
from vofem.errors import ArgumentError
from vofem.laws import gathered_past
from vofem.system import State

if TYPE_CHECKING:
    from vofem.assembly import Effect, Model
    from vofem.bodies.base import Body


class StateSource(Protocol):
    """An earlier outcome that a run can start from: an `Equilibrium`, a `Result`."""

    def state_of(self, body_name: str) -> tuple[Any, Any]:
        """Return a body's degrees of freedom and their rates, each of shape (size,)."""


@dataclass(frozen=True, eq=False)
class StoredState:
    """The state at the end of an earlier outcome: the degrees of freedom of every body, by name."""

    states: dict[str, tuple[Array, Array]]  #: Degrees of freedom and rates by the name of the body, each (size,).
    springs: dict[str, Array]  #: States of hysteretic springs by name.
    springpots: tuple[str, ...] = ()  #: Names of springpots, whose past is not kept.
    source: str = "state of an earlier run"  #: Class of the outcome, for messages.

    def state_of(self, body_name: str) -> tuple[Array, Array]:
        """Return a body's degrees of freedom and their rates, each (size,)."""
        if body_name not in self.states:
            cure = "; as the start of a scene give the outcome for the bodies that it holds: {body: outcome}"
            raise unknown("body", body_name, self.states, cure)
        return self.states[body_name]

    def spring_state(self, name: str) -> Array | None:
        """Return the state of a hysteretic spring, or None."""
        return self.springs.get(name)


def state_alone(source: Any) -> Any:
    """Return the state at the end of an outcome; return anything else unchanged."""
    return source.as_start() if hasattr(source, "as_start") else source


class Initial:
    """The initial state of the bodies of a scene, checked.

    `what`: function and argument, for messages.
    `bodies`: the bodies of the scene.
    `by_name`: whether a body among the keys stands for the scene's body of the same name.
    `given`: the initial state as the user gave it. Of an earlier outcome, only the state is kept.
    """

    def __init__(self, what: str, bodies: Iterable[Body], given: Any, *, by_name: bool = False) -> None:
        self._what = what
        self._bodies = tuple(bodies)
        if given is not None and not hasattr(given, "state_of") and not isinstance(given, Mapping):
            raise ArgumentError(
                f"{what} is {given!r}, expected a dict {{body: (displacement, velocity)}}, an "
                "Equilibrium, a Result or a PeriodicOrbit"
            )
        self.given: Any = state_alone(given)
        if isinstance(given, Mapping):
            self.given = {self._own(body, by_name): state_alone(value) for body, value in given.items()}
            for body, value in self.given.items():
                if not hasattr(value, "state_of") and not (isinstance(value, (tuple, list)) and len(value) == 2):
                    raise ArgumentError(
                        f"{what} of {body.label} is {value!r}, expected a pair (displacement, velocity), "
                        "an Equilibrium, a Result or a PeriodicOrbit"
                    )

    def _own(self, body: Any, by_name: bool) -> Body:
        """Return the scene's body that a key names."""
        for own in self._bodies:
            if own is body or (by_name and not isinstance(body, str) and own.name == getattr(body, "name", None)):
                return own
        cure = "; use the Beam or Mass object itself, not its name" if isinstance(body, str) else ""
        raise ArgumentError(f"{self._what} names {body!r}, which is not among the bodies{cure}")

    def state(self, model: Model, effects: Iterable[Effect]) -> State:
        """Return the state over the free degrees of freedom of a model of the scene."""
        q, v = np.zeros(model.size), np.zeros(model.size)
        for body in self._starting():
            start = model.offsets[body]
            part = slice(start, start + body.size)
            q[part], v[part] = self._start_of(body)
        return State(
            model.reduced(q, "initial displacement"), model.reduced(v, "initial velocity"), self._past(model, effects)
        )

    def _past(self, model: Model, effects: Iterable[Effect]) -> Any:
        """Return the state of hysteretic springs in the outcome that the run starts from, or None."""
        if self.given is None:
            return None

        def known(name: str) -> Array | None:
            source = self._source_of(name, effects)
            return source.spring_state(name) if hasattr(source, "spring_state") else None

        return gathered_past(model.system.laws, known)

    def forgotten(self, model: Model, effects: Iterable[Effect]) -> tuple[str, ...]:
        """Return the names of springpots whose past in an earlier run is not carried on."""
        if self.given is None:
            return ()
        sources = [(name, self._source_of(name, effects)) for name in model.system.without_past]
        return tuple(name for name, source in sources if isinstance(source, StoredState) and name in source.springpots)

    def _source_of(self, spring: str, effects: Iterable[Effect]) -> Any:
        if not isinstance(self.given, Mapping):
            return self.given
        bodies = [effect.points()[0].body for effect in effects if getattr(effect, "name", None) == spring]
        return self.given.get(bodies[0]) if bodies else None

    def _starting(self) -> tuple[Body, ...]:
        if self.given is None:
            return ()
        if not isinstance(self.given, Mapping):
            return self._bodies
        return tuple(body for body in self._bodies if body in self.given)

    def _start_of(self, body: Body) -> tuple[Any, Any]:
        source: Any = self.given[body] if isinstance(self.given, Mapping) else self.given
        if not hasattr(source, "state_of"):
            return (
                body.interpolate(source[0], "initial displacement"),
                body.interpolate(source[1], "initial velocity"),
            )
        try:
            q, v = source.state_of(body.name)
        except ArgumentError as error:
            raise ArgumentError(f"{self._what}: {error}") from error
        if np.shape(q) != (body.size,):
            raise ArgumentError(
                f"{self._what} has {np.shape(q)[0]} degrees of freedom for {body.label}, expected "
                f"{body.size}; start from a scene with the same mesh"
            )
        return q, v
