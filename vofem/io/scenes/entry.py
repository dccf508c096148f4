"""Tables of a scene file: which keys a class has, how it is built from them, and how it is written."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from vofem.errors import MeshError, VofemError
from vofem.io.scenes.kinds import Kind, Unwritable
from vofem.io.scenes.place import INVALID, Book, Invalid, Place

#: Words of constructors' messages that stand for a key.
_SYNONYMS = {"support": "supports", "node": "elements", "nodes": "elements", "slope": "point"}


def _attributes(names: tuple[str, ...]) -> Callable[[Any], dict[str, Any]]:
    return lambda made: {name: getattr(made, name) for name in names}


def _turned(name: str, text: str) -> str:
    """Put a constructor's ``gap is 1, expected ...`` into the form of this file's messages."""
    text = text.removeprefix(f"{name} is missing") if text.startswith(f"{name} is missing") else text
    if text.startswith(", expected"):
        return f"missing{text}"
    parts = re.match(rf"{name} is (?P<found>.*?), expected (?P<wanted>[^;]*)(?P<hint>.*)", text, re.DOTALL)
    return f"expected {parts['wanted']}, found {parts['found']}{parts['hint']}" if parts else text


@dataclass(frozen=True)
class Entry:
    """The form of a class in a scene file.

    Attributes
    ----------
    name : str
        Name of the table, such as "point_load".
    made : type
        The class that the table describes. Objects of exactly this class are written in this form.
    keys : dict of str to Kind
        The keys in the order in which they are written. Which of them may be
        left out, and their defaults, follow from the signature of `build`.
    build : callable
        Makes an object from the values of the keys. The default is the class.
    values : callable
        Returns the values of an object by key. The default is its attributes.
    needed : tuple of str
        Keys that must be given although `build` has a default.
    essential : tuple of str
        Keys without which the rest of a table cannot be checked.
    optional : tuple of str
        Keys that `build` takes as ``**options``.
    bare : str
        The one key whose value may stand for the whole table, as in ``polynomial = [1, 2]``.
    """

    name: str
    made: type
    keys: Mapping[str, Kind]
    build: Callable[..., Any] = None  # type: ignore[assignment]
    values: Callable[[Any], dict[str, Any]] = None  # type: ignore[assignment]
    needed: tuple[str, ...] = ()
    essential: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    bare: str = ""
    _defaults: dict[str, Any] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.build is None:
            object.__setattr__(self, "build", self.made)
        if self.values is None:
            object.__setattr__(self, "values", _attributes(tuple(self.keys)))
        for name, parameter in inspect.signature(self.build).parameters.items():
            if parameter.default is not inspect.Parameter.empty and name not in self.needed:
                self._defaults[name] = parameter.default

    @property
    def required(self) -> tuple[str, ...]:
        """Keys that must be given."""
        return tuple(name for name in self.keys if name not in self._defaults and name not in self.optional)

    # -- reading ----------------------------------------------------------------------------------

    def read(self, table: Any, place: Place, **extra: Any) -> Any:
        """Return the object that a table describes; or report all of its faults and return `INVALID`.

        Parameters
        ----------
        table : object
            The TOML value.
        place : Place
        **extra
            Values for keys that are missing in the table.
        """
        if self.bare and not isinstance(table, dict):
            table = {self.bare: table}
        if not isinstance(table, dict):
            return place.expected(f"a table with {', '.join(self.keys)}", table)
        place.unknown_keys(table, tuple(self.keys))
        values, bad = dict(extra), set(table) - set(self.keys)
        for name, kind in self.keys.items():
            if name in table:
                here = place if name == self.bare and len(self.keys) == 1 else place.key(name)
                value = kind.read(table[name], here)
                if isinstance(value, Invalid):
                    bad.add(name)
                else:
                    values[name] = value
            elif name in self.required:
                place.key(name).report(f"missing, expected {kind.expected}")
                bad.add(name)
        return self._construct(values, bad, place)

    def _construct(self, values: dict[str, Any], bad: set[str], place: Place) -> Any:
        """Build, and report what the constructor finds; what is wrong is replaced to find what else is."""
        attempt, sound = dict(values), not bad
        for name in bad & set(self.keys):
            if self.keys[name].stand_ins:
                attempt[name] = self.keys[name].stand_ins[0]
            elif name in self.required or name in self.essential:
                return INVALID
        for _ in range(len(self.keys) + 1):
            made, name, message = self._try(attempt)
            if not message:
                return made if sound else INVALID
            if name not in bad:
                (place.key(name) if name else place).report(message)
            sound = False
            following = self._without(attempt, name)
            if following is None:
                return INVALID
            bad.add(name)
            attempt = following
        return INVALID

    def _try(self, values: dict[str, Any]) -> tuple[Any, str, str]:
        """Return what was built, or the key at fault, where the message tells, and the message."""
        try:
            return self.build(**values), "", ""
        except MeshError as error:
            return None, "mesh", str(error)
        except VofemError as error:
            text = str(error)
            # Drop "Contact 'stop': "; the key path says it already.
            for label in (f"{self.made.__name__} {values.get('name')!r}: ", f"{self.made.__name__}: "):
                text = text.removeprefix(label)
            for k, word in enumerate(re.findall(r"\w+", text)):
                name = word if word in self.keys else _SYNONYMS.get(word, "")
                # "a" and "of" are keys, and words of any sentence.
                if name in self.keys and (name not in ("a", "of") or k == 0):
                    return None, name, _turned(name, text)
            return None, "", text

    def _without(self, values: dict[str, Any], name: str) -> dict[str, Any] | None:
        """Return values in which a key is no longer at fault."""
        if name not in self.keys or name in self.essential:
            return None
        rest = {key: value for key, value in values.items() if key != name}
        trials = [{**rest, name: value} for value in self.keys[name].stand_ins]
        if name not in self.required and name in values:
            trials.insert(0, rest)
        return next((trial for trial in trials if self._try(trial)[1] != name), None)

    # -- writing ----------------------------------------------------------------------------------

    def write(self, made: Any, place: Place) -> dict[str, Any]:
        """Return the table of an object without default values; report values that a scene file cannot hold."""
        table: dict[str, Any] = {}
        try:
            values = self.values(made)
        except Unwritable as error:
            place.report(str(error))
            return table
        for name, value in values.items():
            kind, default = self.keys[name], self._defaults.get(name)
            if value is None:
                continue
            try:
                written = kind.write(value, place.book)
                if name in self._defaults and default is not None and written == kind.write(default, place.book):
                    continue
            except Unwritable as error:
                place.key(name).report(str(error))
                continue
            table[name] = written
        return table

    def write_inside(self, made: Any, book: Book) -> Any:
        """Return the inline table of an object that is the value of a key; raise `Unwritable` if it has none."""
        inner = Book(book.folder, book.bodies)
        table = self.write(made, Place(inner))
        if inner.problems:
            path, message = inner.problems[0]
            raise Unwritable(message if not path else f"{self.name}.{path}: {message}")
        return table[self.bare] if self.bare and len(self.keys) == 1 else table
