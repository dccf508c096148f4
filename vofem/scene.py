"""A scene: bodies, effects and an initial state. Only what is declared becomes part of the system of equations."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Iterable, Mapping
from typing import Any

from vofem._validate import nearest, public
from vofem.assembly import Effect, Model, SystemBuilder
from vofem.assembly.bases import Base, offsets
from vofem.bodies.base import Body
from vofem.cards import Shown
from vofem.effects.contact import Contact, RigidStop
from vofem.effects.friction import Friction
from vofem.errors import ArgumentError, VofemError
from vofem.initial import Initial, StateSource
from vofem.locks import Lock
from vofem.parameters import changed
from vofem.sharing import share_with_recent
from vofem.system import State, System

#: Threads that run one scene compile it once. A scene holds no lock of its own, so that it can be copied and pickled.
_COMPILING = Lock()


def as_scene(what: str, value: Any) -> Scene:
    """Return `value` if it is a Scene, else raise `ArgumentError` naming `what`."""
    if isinstance(value, Scene):
        return value
    raise ArgumentError(f"{what}: scene is {value!r}, expected a vofem.Scene; put bodies and effects into one")


class Scene(Shown):
    """Bodies, the effects that act on them, and their initial state.

    Parameters
    ----------
    bodies : iterable of Beam and Mass
        The bodies.
    effects : iterable of effects
        Contacts, springs, dashpots, joints, loads, damping. All their points must lie on bodies of the scene.
    initial : dict or outcome, optional
        A dict ``{body: (displacement, velocity)}`` with numbers for a mass, and with callables of an array x, or
        numbers, for a beam. Bodies that are not named start from zero. The outcome of `vofem.equilibrium` or of an
        earlier run gives the state of all bodies with the same names, or of one body: ``{beam: outcome}``. Hysteretic
        springs of the same names keep their internal variables. Springpots start without a past.

    Raises
    ------
    ArgumentError
        For something that is neither body nor effect, a name that is used twice,
        or a point on a body that is not in the scene.
    """

    def __init__(
        self,
        bodies: Iterable[Any],
        effects: Iterable[Any] = (),
        initial: Mapping[Any, tuple[Any, Any]] | StateSource | None = None,
    ) -> None:
        self.bodies: tuple[Body, ...] = _as_tuple("bodies", bodies)
        self.effects: tuple[Effect, ...] = _as_tuple("effects", effects)
        self._model: Model | None = None
        #: A scene with which this one shares what is equal.
        self._like: Scene | None = None
        self._check(initial)

    def __repr__(self) -> str:
        kinds: dict[str, int] = {}
        for thing in (*self.bodies, *self.effects):
            kinds[type(thing).__name__] = kinds.get(type(thing).__name__, 0) + 1
        return f"Scene({', '.join(f'{count} {kind}' for kind, count in kinds.items())})"

    def _check(self, initial: Any) -> None:
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
        #: The motions of bases, which effects of other packages may have too.
        bases = (getattr(effect, "base", None) for effect in self.effects)
        self._bases = tuple(base for base in bases if isinstance(base, Base))
        self._check_bases()
        self._check_pressing()
        self._initial = Initial("Scene: initial", self.bodies, initial)
        present = set(self.bodies)
        touched: list[tuple[Any, Body]] = [(effect, point.body) for effect in self.effects for point in effect.points()]
        for thing, body in (*touched, *((base, base.body) for base in self._bases)):
            if body not in present:
                known = ", ".join(one.label for one in self.bodies)
                label = thing.label if isinstance(thing, Base) else thing.describe()
                raise ArgumentError(f"{label}: its body is not in the scene, which holds {known}; add it to bodies")

    def _check_bases(self) -> None:
        """Raise where something joins bodies whose bases move differently: their gap would depend on time."""
        if not self._bases:
            return
        on_base = {base.body: base for base in self._bases}
        twice = next((base for base in self._bases if on_base[base.body] is not base), None)
        if twice is not None:
            raise ArgumentError(
                f"Scene: {twice.label}, and {on_base[twice.body].label}: supports cannot follow two motions. "
                "Remove one; a motion that is the sum of two is one BaseMotion, whose acceleration is f + g"
            )
        for effect in self.effects:
            if isinstance(effect, Contact):
                offsets(f"Contact {effect.name!r}", effect.bases, self._bases)
                continue
            on = [[base.acceleration for base in self._bases if base.body is point.body] for point in effect.points()]
            if len(on) == 2 and on[0] != on[1]:
                raise ArgumentError(
                    f"{effect.describe()}: it joins bodies of which only one has this BaseMotion; displacements are "
                    "counted from the base, so give both bodies the same acceleration"
                )

    def _check_pressing(self) -> None:
        """Raise where friction is pressed by a contact that the scene does not hold."""
        for effect in self.effects:
            if not isinstance(effect, Friction) or effect.pressing is None:
                continue
            pressing = effect.pressing
            known = tuple(contact.name for contact in self.contacts if isinstance(contact, Contact))
            held = any(effect.contact is contact for contact in self.contacts)
            if pressing not in known or not (held or isinstance(effect.contact, str)):
                raise ArgumentError(
                    f"Friction {effect.name!r}: contact is {pressing!r}, expected a contact of the scene, which has "
                    f"{', '.join(map(repr, known)) or 'none'}{nearest(pressing, known)}; add the contact to effects"
                )

    @staticmethod
    def _check_names(what: str, names: list[str]) -> None:
        twice = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
        if twice:
            raise ArgumentError(f"Scene: {what} named {twice[0]!r} occur more than once; give each its own name")

    @property
    def contacts(self) -> tuple[Contact | RigidStop, ...]:
        """The contacts and rigid stops among the effects, in order."""
        return tuple(effect for effect in self.effects if isinstance(effect, (Contact, RigidStop)))

    @property
    def model(self) -> Model:
        """The assembled scene. It is assembled once, when it is first needed."""
        if self._model is None:
            # Another thread may assemble this scene meanwhile, and then forgets the other one.
            like, earlier = self._like, None
            # Where the other scene cannot be assembled, for example because of what was replaced, it shares nothing.
            with contextlib.suppress(VofemError):
                earlier = None if like is None else like.model.system
            with _COMPILING:
                self._model = self._model or self._compiled(earlier)
            self._like = None
        return self._model

    @property
    def assembled(self) -> bool:
        """Whether the scene has been assembled already."""
        return self._model is not None

    def _compiled(self, earlier: System | None) -> Model:
        builder = SystemBuilder(self.bodies, self._bases)
        for effect in self.effects:
            effect.compile(builder)
        model = builder.build()
        share_with_recent(model.system)
        if earlier is not None:
            model.system.share_what_is_equal(earlier)
        return model

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_like": None}

    def compiled_as(self, model: Model) -> Scene:
        """Return the same scene with a given model in place of its own."""
        same = copy.copy(self)
        same._model, same._like = model, None
        return same

    def replace(self, effect: Any, other: Any = None, /, **changes: Any) -> Scene:
        """Return the same scene with one effect replaced. What does not depend on it is not computed again.

        If the new scene differs only in numbers, such as a gap, the stiffness of a contact or the function of a load,
        runs of both scenes share vibration modes. They also share eigensystems of contact statuses that are equal::

            for gap in np.linspace(0.01, 0.03, 100):
                result = vf.simulate(scene.replace(stop, gap=gap), 20.0)

        Parameters
        ----------
        effect : effect or str
            An effect of the scene, or its name.
        other : effect, optional
            The effect that takes its place. Without it a copy with changed arguments does.
        **changes
            Arguments of the effect's constructor that change, or paths to numbers: ``**{"f.amplitude": 2.0}``.

        Raises
        ------
        ArgumentError
            If the effect is not in the scene, or an argument is unknown or out of range.
        """
        found = [k for k, known in enumerate(self.effects) if known is effect]
        if isinstance(effect, str):
            found = [k for k, known in enumerate(self.effects) if getattr(known, "name", None) == effect]
        if len(found) != 1:
            known_names = (getattr(known, "name", None) for known in self.effects)
            names = tuple(name for name in known_names if isinstance(name, str))
            count = "no effect of the scene" if not found else "there more than once"
            body = any(effect is body or (isinstance(effect, str) and effect == body.name) for body in self.bodies)
            cure = "build the scene anew with another body" if body else "give one of its effects, or its name"
            raise ArgumentError(
                f"Scene.replace: {_shown(effect)} is {count}"
                f"{nearest(effect, names) if isinstance(effect, str) else ''}; {cure}"
            )
        if (other is None) is not bool(changes):
            raise ArgumentError(
                "Scene.replace: give either another effect or the arguments that change, such as gap=0.02"
            )
        effects = list(self.effects)
        effects[found[0]] = changed(effects[found[0]], **changes) if other is None else other
        scene = copy.copy(self)
        scene.__init__(self.bodies, effects)  # type: ignore[misc]
        scene._initial = self._initial
        # A chain of scenes that were never assembled would not end.
        scene._like = self if self.assembled or self._like is None else self._like
        return scene

    @property
    def initial(self) -> Any:
        """The initial state as it was given; for an earlier run or an equilibrium, the state at its end."""
        return self._initial.given

    def initial_state(self, initial: Initial | None = None) -> State:
        """Return the state at t = 0 over the free degrees of freedom.

        Parameters
        ----------
        initial : Initial, optional
            Another initial state.
        """
        return (initial or self._initial).state(self.model, self.effects)

    def forgotten(self, initial: Initial | None = None) -> tuple[str, ...]:
        """Return the names of springpots whose past in an earlier run is not carried on into this one."""
        return (initial or self._initial).forgotten(self.model, self.effects)


public(Scene)


def _as_tuple(what: str, things: Any) -> tuple[Any, ...]:
    # Arrays without dimensions, such as np.ma.masked, are iterable by their class only.
    if isinstance(things, (str, bytes)) or not isinstance(things, Iterable) or getattr(things, "shape", None) == ():
        raise ArgumentError(f"Scene: {what} is {_shown(things)}, expected a list of {what}; write [...] around it")
    return tuple(things)


def _shown(thing: Any) -> str:
    """Return a thing as a message shows it: as `vofem.explain` does where it can."""
    if not isinstance(thing, type) and hasattr(thing, "describe"):
        return str(thing.describe())
    return repr(thing)
