"""Classes whose parameters are declared once, as annotated fields of a dataclass."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import itertools
import re
import textwrap
import typing
from collections.abc import Callable, Collection, Hashable, Mapping
from dataclasses import MISSING, dataclass, field
from typing import Any, TypeVar, dataclass_transform, get_type_hints

import numpy as np

from vofem._validate import missing, nearest, public
from vofem.errors import ArgumentError, VofemError
from vofem.parameters.kinds import Kind, Name, Unwritable, checked_name
from vofem.parameters.place import INVALID, Book, Invalid, Place

C = TypeVar("C", bound=type)
F = TypeVar("F", bound=Callable[..., Any])

_counter = itertools.count(1)

#: The default of a name: the constructor chooses one.
CHOSEN: Any = None


@dataclass(frozen=True)
class Declaration:
    """One parameter of a class."""

    name: str
    kind: Kind  #: Its unit, its meaning, its limits, and how it is read and written.
    default: Any = MISSING  #: `dataclasses.MISSING` where it must be given.
    keyword: bool = False  #: Whether it is given by name only.

    @property
    def needed(self) -> bool:
        """Whether a scene file must give it."""
        return self.default is MISSING or self.kind.needed

    def text(self) -> str:
        """Return its lines of the docstring, after numpydoc."""
        optional = ", optional" if self.default is None and not self.kind.needed else ""
        meaning = textwrap.fill(self.kind.meaning, 100, initial_indent="    ", subsequent_indent="    ")
        return f"{self.name} : {self.kind.shown}{optional}\n{meaning}"


@dataclass_transform(eq_default=False, field_specifiers=(field,))
def declared(
    *, frozen: bool = False, eq: bool | None = None, bare: bool = False, either: tuple[str, ...] = ()
) -> Callable[[C], C]:
    """Make a dataclass whose fields are parameters, each annotated with its `Kind`.

    The constructor checks all of them and then runs the rules of the class, see `rule`.
    Its docstring gets a section on its parameters.

    `frozen`: whether objects compare by value and cannot be changed. Otherwise they compare and hash by identity.
    `eq`: False for frozen objects that compare by identity.
    `bare`: whether the value of its only field may stand for the whole table of a scene file, as in ``polynomial = [1,
    2]``.
    `either`: parameters of which one is given, and from which a rule finds the first one.
    """

    def make(cls: C) -> C:
        cls.__post_init__ = _check  # type: ignore[attr-defined]
        made: Any = dataclass(frozen=frozen, eq=frozen if eq is None else eq, repr=frozen)(cls)
        hints = get_type_hints(cls, include_extras=True)
        known = {
            f.name: Declaration(f.name, _kind_of(cls, f.name, hints[f.name]), f.default, bool(f.kw_only))
            for f in dataclasses.fields(cls)
            if f.init
        }
        # What a class names itself comes before what its base has, as in the order of its source.
        inherited = {name for base in made.__mro__[1:] for name in getattr(base, "_declarations", ())}
        order = sorted(known, key=lambda name: known[name].keyword * (1 + (name in inherited)))
        made._declarations = {name: known[name] for name in order}
        # What the constructor needs of them at each call. Without a check of its own, a kind takes any value.
        made._named = "name" in known and type(known["name"].kind) is Name
        made._checks = tuple(
            (name, one.kind.check, one.default is None, one.kind.choices if one.kind.needed else "")
            for name, one in made._declarations.items()
            if type(one.kind).check is not Kind.check
        )
        signature = inspect.signature(made.__init__)
        types = {f.name: _type_of(f.type, hints[f.name]) for f in dataclasses.fields(cls) if f.init}
        own = [signature.parameters[name].replace(annotation=types[name]) for name in order]
        made.__init__.__signature__ = signature.replace(parameters=[signature.parameters["self"], *own])
        made._rules = tuple(
            member
            for base in reversed(made.__mro__)
            for name, member in vars(base).items()
            if hasattr(member, "needs") and getattr(made, name) is member
        )
        made._either = either
        made._bare = next(iter(known)) if bare else ""
        made.__doc__ = _documented(made)
        public(made)
        return made

    return make


def rule(*needs: str) -> Callable[[F], F]:
    """Mark a method of a declared class that checks what no parameter shows alone, or sets what follows from them.

    Rules run after the checks of all parameters, in the order in which they stand in the class.

    `*needs`: the parameters that it looks at. The first one is at fault where the method raises `ArgumentError`, unless
    the message begins with another one. In a scene file a rule runs if all of them are sound.
    """

    def mark(method: F) -> F:
        method.needs = needs  # type: ignore[attr-defined]
        return method

    return mark


def is_declared(cls: type) -> bool:
    """Return whether the parameters of a class are declared."""
    return "_declarations" in vars(cls)


def declarations(cls: type) -> dict[str, Declaration]:
    """Return the parameters of a declared class by name, in the order of its constructor."""
    known: dict[str, Declaration] = cls._declarations  # type: ignore[attr-defined]
    return known


def label_of(thing: Any) -> str:
    """Return class and name of an object for messages, such as ``Contact 'stop'``."""
    name = getattr(thing, "name", None)
    return type(thing).__name__ + (f" {name!r}" if isinstance(name, str) and name else "")


def automatic_name(name: str | None, kind: str) -> str:
    """Return `name`, or a new unique one such as ``'beam-3'``."""
    if name is None:
        return f"{kind.lower()}-{next(_counter)}"
    return checked_name(f"{kind}: name", name)


def was_chosen(name: Any) -> bool:
    """Return whether `automatic_name` may have chosen a name, which is then another one each time."""
    return re.fullmatch(r"[a-z]+-\d+", str(name)) is not None


def _kind_of(cls: type, name: str, hint: Any) -> Kind:
    """Return the kind of which an annotation speaks."""
    kinds = [one for one in getattr(hint, "__metadata__", ()) if isinstance(one, Kind)]
    if typing.get_origin(hint) is not typing.Annotated or not kinds:
        raise TypeError(f"{cls.__name__}.{name} has no kind, expected Annotated[type, Real(...)] or the like")
    return kinds[-1]


def _type_of(text: Any, hint: Any) -> Any:
    """Return the type of a parameter without its kind: as it was written beside the kind, or else resolved."""
    node = ast.parse(text, mode="eval").body if isinstance(text, str) else None
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Tuple) and ast.unparse(node.value) == "Annotated":
        return ast.unparse(node.slice.elts[0])
    return typing.get_args(hint)[0]


def _check(self: Any) -> None:
    """Check all parameters of an object and run its rules: the end of its constructor."""
    if self._named:
        object.__setattr__(self, "name", automatic_name(self.name, type(self).__name__))
    label = label_of(self)
    for name, check, optional, choices in self._checks:
        value = getattr(self, name)
        if value is not None or not optional:
            checked = check(f"{label}: {name}", value)
            if checked is not value:
                object.__setattr__(self, name, checked)
        elif choices:
            raise missing(f"{label}: {name}", choices)
    for one in self._rules:
        one(self)


def _documented(cls: type) -> str:
    """Return the docstring of a class with the section on its parameters before what follows the text."""
    text = inspect.cleandoc(vars(cls).get("__doc__") or "")
    if not cls._declarations:  # type: ignore[attr-defined]
        return text
    shown = "\n".join(one.text() for one in declarations(cls).values())
    section = f"Parameters\n----------\n{shown}\n"
    places = [text.find(f"\n{head}\n---") for head in ("Raises", "Notes", "References", "Examples")]
    first = min((place for place in places if place >= 0), default=len(text) + 1)
    return f"{text[:first].rstrip()}\n\n{section}{text[first:]}".rstrip() + "\n"


# -- values -----------------------------------------------------------------------


def values_of(thing: Any, unless: Collection[str] = ()) -> dict[str, Any]:
    """Return the arguments with which an object would be made again, by name; `unless` need not be known."""
    if is_declared(type(thing)):
        values = {name: getattr(thing, name) for name in thing._declarations}
        return values | alone(thing, next((name for name in thing._either[1:] if values[name] is not None), None))
    parameters = list(inspect.signature(type(thing).__init__).parameters.values())[1:]
    for parameter in parameters:
        name = parameter.name
        if not hasattr(thing, name) and name not in unless and parameter.default is parameter.empty:
            raise ArgumentError(
                f"{label_of(thing)} does not tell its argument {name!r}; make another one and give it instead of what "
                "changes"
            )
    return {p.name: getattr(thing, p.name) for p in parameters if hasattr(thing, p.name)}


def content_of(value: Any) -> Hashable:
    """Return what an object or a value depends on, as a key of a cache: its parameters, but not its name.

    Raises `TypeError` for a Python function or another object whose content is not known.
    """
    if value is None or isinstance(value, (bool, int, float, complex, str, np.generic)):
        return type(value).__name__, value if isinstance(value, str) or value is None else repr(value)
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, Mapping):
        return tuple((content_of(key), content_of(one)) for key, one in value.items())
    if isinstance(value, (tuple, list)):
        return tuple(content_of(one) for one in value)
    if is_declared(type(value)):
        return (type(value), *(content_of(one) for name, one in values_of(value).items() if name != "name"))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return (type(value), *(content_of(getattr(value, one.name)) for one in dataclasses.fields(value)))
    raise TypeError(f"{value!r} has no content that is known")


def alone(thing: Any, given: str | None) -> dict[str, None]:
    """Return None for the parameters in whose place another one is given."""
    return {} if given is None else {name: None for name in thing._either if name != given}


# -- tables of scene files --------------------------------------------------------------------------


def table_name(cls: type) -> str:
    """Return the name of the table of a class, such as ``point_load``."""
    name = cls.__name__
    return "".join(f"_{c.lower()}" if c.isupper() and k else c.lower() for k, c in enumerate(name))


def keys_of(cls: type) -> tuple[str, ...]:
    """Return the keys of the table of a class, in the order in which they are written."""
    known = declarations(cls)
    return (*(name for name in known if name == "name"), *(name for name in known if name != "name"))


def read(cls: type, table: Any, place: Place, **given: Any) -> Any:
    """Return the object that a table describes; or report all of its faults and return `INVALID`.

    `cls`: a declared class.
    `table`: the TOML value.
    `**given`: values of parameters that are missing in the table.
    """
    if cls._bare and not isinstance(table, dict):  # type: ignore[attr-defined]
        table = {cls._bare: table}  # type: ignore[attr-defined]
    values, bad = read_values(cls, table, place, keys_of(cls), given)
    return INVALID if values is None else made_of(cls, values, bad, place)


def read_values(
    cls: type, table: Any, place: Place, keys: tuple[str, ...], given: Mapping[str, Any]
) -> tuple[dict[str, Any] | None, set[str]]:
    """Return the values of the keys of a table that are sound, and the keys that are not; None if it is no table."""
    known = declarations(cls)
    if not isinstance(table, dict):
        place.expected(f"a table with {', '.join(keys)}", table)
        return None, set()
    place.unknown_keys(table, keys)
    values, bad = dict(given), set(table) - set(keys)
    for name in keys:
        if name in table and name in known:
            here = place if name == cls._bare else place.key(name)  # type: ignore[attr-defined]
            value = known[name].kind.read(table[name], here)
            if isinstance(value, Invalid):
                bad.add(name)
            else:
                values[name] = value
        elif name in known and known[name].needed and name not in values and name not in bad:
            place.key(name).report(f"missing, expected {known[name].kind.expected}")
            bad.add(name)
    return values, bad


def made_of(cls: type, values: Mapping[str, Any], bad: set[str], place: Place) -> Any:
    """Return an object of sound values; or report what its rules find, as far as they can be run."""
    made: Any = object.__new__(cls)
    for name, one in declarations(cls).items():
        value = values.get(name, one.default)
        if name not in bad:
            object.__setattr__(made, name, value if value is None or name in values else one.kind.check(name, value))
    for one in cls._rules:  # type: ignore[attr-defined]
        if bad.isdisjoint(one.needs):
            try:
                one(made)
            except VofemError as error:
                key = report(error, place, tuple(declarations(cls)), one.needs[0], f"{label_of(made)}: ")
                bad.add(key)
    return INVALID if bad else made


def report(error: VofemError, place: Place, names: tuple[str, ...], name: str, label: str) -> str:
    """Report an error of a rule in the form of messages about files; return the key at fault."""
    text = str(error).removeprefix(label)
    first = text.replace("[", " ").split(" ", 1)[0]
    key = first if first in names else name
    place.key(key).report(error.in_a_file() if isinstance(error, ArgumentError) and error.parts else text)
    return key


def write(thing: Any, place: Place) -> dict[str, Any]:
    """Return the table of an object without default values; report values that a scene file cannot hold."""
    return write_values(type(thing), values_of(thing), place)


def write_values(cls: type, values: Mapping[str, Any], place: Place) -> dict[str, Any]:
    """Return the table of a class with given values, see `write`."""
    table: dict[str, Any] = {}
    for name in keys_of(cls):
        one, value = declarations(cls)[name], values.get(name)
        if value is None:
            continue
        try:
            written = one.kind.write(value, place.book)
            if one.default in (MISSING, None) or one.needed or written != one.kind.write(one.default, place.book):
                table[name] = written
        except Unwritable as error:
            place.key(name).report(str(error))
    return table


def write_inside(thing: Any, book: Book) -> Any:
    """Return the inline table of an object that is the value of a key; raise `Unwritable` if it has none."""
    inner = Book(book.folder, book.bodies)
    table = write(thing, Place(inner))
    if inner.problems:
        path, message = inner.problems[0]
        raise Unwritable(f"{table_name(type(thing))}.{path}: {message}")
    return table[thing._bare] if thing._bare else table


def schema_of(cls: type) -> dict[str, Any]:
    """Return the JSON schema of the table of a class."""
    known = declarations(cls)
    table = {
        "type": "object",
        "properties": {name: known[name].kind.described() for name in keys_of(cls)},
        "required": [name for name in keys_of(cls) if known[name].needed],
        "additionalProperties": False,
    }
    return {"anyOf": [known[cls._bare].kind.described(), table]} if cls._bare else table  # type: ignore[attr-defined]


def writable(cls: type) -> bool:
    """Return whether scene files can hold objects of a class: its parameters are declared, and none is a function."""
    return is_declared(cls) and all(one.kind.writable for one in declarations(cls).values())


@dataclass(frozen=True)
class OneOf(Kind):
    """An object of some class, in scene files a table with one key that names the class."""

    text: str = ""
    classes: Mapping[str, type] = field(default_factory=dict)  #: Declared classes by their names in scene files.
    expected: str = "a table with one key"  #: An example, for messages.

    def names(self) -> str:
        """Return the names, for messages."""
        return ", ".join(self.classes)

    def read(self, value: Any, place: Place) -> Any:
        """Return the object."""
        if not isinstance(value, dict) or len(value) != 1:
            return place.expected(self.expected, value)
        ((name, content),) = value.items()
        if name not in self.classes:
            hint = nearest(name, tuple(self.classes)) or f"; expected one of {self.names()}"
            return place.key(name).report(f"unknown key{hint}")
        return read(self.classes[name], content, place.key(name))

    def write(self, value: Any, book: Book) -> Any:
        """Return the table."""
        for name, cls in self.classes.items():
            if type(value) is cls:
                return {name: write_inside(value, book)}
        raise Unwritable(f"{value!r} cannot be written to a scene file; expected {self.expected}")

    def described(self) -> dict[str, Any]:
        """Return a table with one of the keys."""
        tables = {name: schema_of(cls) for name, cls in self.classes.items()}
        return {"type": "object", "properties": tables, "minProperties": 1, "maxProperties": 1,
                "additionalProperties": False, **super().described()}  # fmt: skip
