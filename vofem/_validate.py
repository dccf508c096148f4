"""Checks of arguments, all of one form: name the thing, say what was found and what was expected."""

from __future__ import annotations

import functools
import inspect
import reprlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vofem.errors import ArgumentError

#: Largest magnitude taken for a physical quantity. Cubes and ratios of such numbers stay finite.
HUGE = 1e60

#: Largest number of things, such as elements or times, of which a number says how many there are.
MANY = 10_000_000

#: Smallest magnitude taken for a positive one.
TINY = 1e-60


T = TypeVar("T")


def name_of(thing: Any) -> str:
    """Return the name of a thing that has one, or the name itself; of anything else how it is shown, no name of any."""
    name = getattr(thing, "name", thing)
    return name if isinstance(name, str) else repr(thing)


def listed(given: Any) -> list[Any]:
    """Return one thing, such as a name, or several of them, as a list."""
    given = given.tolist() if isinstance(given, np.ndarray) else given
    return list(given) if isinstance(given, Iterable) and not isinstance(given, str) else [given]


class Named(Mapping[str, T]):
    """Contacts, or springs, by name or by the object itself, in the order of the scene; a wrong name raises."""

    def __init__(self, things: dict[str, T], kind: str = "contact") -> None:
        self._things = things
        self._kind = kind

    def __getitem__(self, name: Any) -> T:
        key = name_of(name)
        if key not in self._things:
            raise unknown(self._kind, key, self._things)
        return self._things[key]

    def __contains__(self, name: object) -> bool:
        return name_of(name) in self._things

    def __iter__(self) -> Iterator[str]:
        return iter(self._things)

    def __len__(self) -> int:
        return len(self._things)

    def __repr__(self) -> str:
        return repr(self._things)


def wrong(what: str, found: str, expected: str, hint: str = "") -> ArgumentError:
    """Return the error that names a thing, what was found, what was expected, and the cure."""
    error = ArgumentError(f"{what} is {found}, expected {expected}{hint}")
    error.parts = (found, expected, hint)
    return error


def missing(what: str, expected: str) -> ArgumentError:
    """Return the error for a thing that is not given."""
    error = ArgumentError(f"{what} is missing, expected {expected}")
    error.parts = ("", expected, "")
    return error


def unknown(kind: str, name: Any, known: Iterable[str], cure: str = "", what: str = "") -> ArgumentError:
    """Return the error for a name that no thing of a kind has: it lists the names that there are."""
    names = tuple(known)
    listed = f", expected {one_of(names)}" if names else "; there are none"
    return ArgumentError(f"{what and what + ': '}no {kind} is named {name!r}{listed}{nearest(name, names)}{cure}")


def number(
    what: str,
    value: Any,
    *,
    minimum: float | None = None,
    positive: bool = False,
    finite: bool = True,
) -> float:
    """Return `value` as a float, or raise `ArgumentError` naming `what`.

    `what`: the name shown to the user, such as ``"Beam 'b1': length"``.
    `value`: what was given. Booleans, strings and arrays are refused.
    `minimum`: the smallest value allowed.
    `positive`: whether zero and less are refused.
    `finite`: whether infinity is refused. NaN always is.
    """
    expected = "a positive number" if positive else "a number"
    if minimum is not None:
        expected = "a number that is not negative" if minimum == 0 else f"a number not below {minimum:g}"
    if type(value) is not float and type(value) is not int:
        text_or_list = isinstance(value, (bool, str, list, tuple))
        if text_or_list or not np.isscalar(value):
            array = None if text_or_list else np.asarray(value)
            if array is None or array.ndim != 0 or array.dtype.kind not in "iuf":
                raise wrong(what, repr(value), expected)
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise wrong(what, repr(value), expected) from None
    if result != result:
        raise wrong(what, "NaN", expected, "; look where the value was computed")
    if finite and not abs(result) <= HUGE:
        raise wrong(what, repr(result), f"a finite number (magnitude at most {HUGE:g})")
    if (positive and not result > 0) or (minimum is not None and not result >= minimum):
        raise wrong(what, repr(result), expected)
    if positive and result < TINY:
        raise wrong(what, repr(result), f"{expected} of at least {TINY:g}")
    return result


def whole(what: str, value: Any, least: int = 1, most: int | None = None) -> int:
    """Return `value` as an int of at least `least` and at most `most`, or raise `ArgumentError` naming `what`."""
    sound = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not sound or value < least or (most is not None and value > most):
        limits = f", {least} or more" if most is None else f" from {least} to {most}"
        raise wrong(what, repr(value), f"a whole number{limits}")
    return int(value)


def flag(what: str, value: Any, hint: str = "") -> bool:
    """Return `value` as a bool if it is one, of numpy too, or raise `ArgumentError` naming `what`."""
    if not isinstance(value, (bool, np.bool_)):
        raise wrong(what, repr(value), "True or False", hint)
    return bool(value)


def flag_or_none(what: str, value: Any, meaning: str) -> bool | None:
    """Return `value` as `flag` does, or None where it is None, whose `meaning` the message gives: ``"to ..."``."""
    return None if value is None else flag(what, value, f", or None {meaning}")


def array(what: str, values: Any, *, shape: tuple[int, ...] | None = None) -> NDArray[np.float64]:
    """Return `values` as a new float array of finite numbers, or raise `ArgumentError` naming `what`.

    Booleans, texts, complex numbers, times and masked values are refused. The array is a copy: what its owner writes
    into `values` later changes nothing.
    """
    try:
        given = np.asarray(values)
        sound = given.dtype.kind in "iufO" and not np.ma.is_masked(values)
        result = given.astype(float) if sound else None
    except (TypeError, ValueError, OverflowError):
        result = None
    if result is None:
        raise ArgumentError(f"{what} is {reprlib.repr(values)}, expected an array of numbers")
    if shape is not None and result.shape != shape:
        raise ArgumentError(f"{what} has shape {result.shape}, expected {shape}")
    bad = ~(np.abs(result) <= HUGE)
    if np.any(bad):
        place = np.argwhere(bad)[0].tolist()
        found = result[tuple(place)]
        raise ArgumentError(f"{what} holds {found} at index {place}, expected finite numbers (at most {HUGE:g})")
    return result


def series(what: str, values: Any) -> NDArray[np.float64]:
    """Return one or more finite numbers as an array of shape (n,), or raise `ArgumentError` naming `what`."""
    result = np.atleast_1d(array(what, values))
    if result.ndim != 1 or not result.size:
        raise ArgumentError(f"{what} has shape {result.shape}, expected one or more numbers, shape (n,)")
    return result


def choice(what: str, value: Any, allowed: tuple[str, ...]) -> str:
    """Return `value` as a plain string if it is one of `allowed`, or raise `ArgumentError` with the nearest name."""
    if isinstance(value, str) and value in allowed:
        return str(value)  # texts of numpy, such as an entry of an array, are strings too
    raise wrong(what, repr(value), one_of(allowed), nearest(value, allowed))


def public(*classes: type) -> None:
    """Make what users construct answer mistakes: for classes that are part of the public interface.

    A misspelt or missing argument of the constructor raises `ArgumentError`
    with the nearest name in place of Python's TypeError, and an object that
    can describe itself is shown by its description in place of its address.
    """
    for made in classes:
        _explain_arguments(made)
        if made.__repr__ is object.__repr__ and hasattr(made, "describe"):
            made.__repr__ = _described  # type: ignore[assignment]


def _described(self: Any) -> str:
    try:
        return f"<{self.describe()}>"
    except AttributeError:  # in a debugger, before it is complete
        return object.__repr__(self)


def _explain_arguments(made: type) -> None:
    original = made.__init__  # type: ignore[misc]
    signature = inspect.signature(original)

    @functools.wraps(original)
    def construct(self: Any, *args: Any, **named: Any) -> None:
        try:
            original(self, *args, **named)
        except TypeError:
            try:
                signature.bind(self, *args, **named)
            except TypeError as error:
                raise ArgumentError(_wrong_arguments(type(self).__name__, signature, named, str(error))) from None
            raise

    made.__init__ = construct  # type: ignore[misc]


def _wrong_arguments(name: str, signature: inspect.Signature, named: dict[str, Any], complaint: str) -> str:
    """Return a message on arguments that a constructor does not take."""
    known = tuple(signature.parameters)[1:]
    takes = f"{name} takes {', '.join(known) or 'no arguments'}"
    unknown = [word for word in named if word not in known]
    if unknown:
        return f"{name}: there is no argument {unknown[0]!r}{nearest(unknown[0], known)}; {takes}"
    return f"{name}: {complaint}; {takes}"


def one_of(allowed: tuple[str, ...]) -> str:
    """Spell a list of names for a message."""
    return "one of " * (len(allowed) > 1) + ", ".join(repr(name) for name in allowed)


def nearest(value: Any, allowed: tuple[str, ...]) -> str:
    """Return ``"; did you mean 'x'?"`` where a name is close, else an empty string."""
    from difflib import get_close_matches

    text = str(value)
    close = get_close_matches(text, allowed, n=1)
    if not close and len(text) > 2:
        close = [name for name in allowed if len(name) > 2 and (name.startswith(text) or text.startswith(name))]
    return f"; did you mean {close[0]!r}?" if close else ""
