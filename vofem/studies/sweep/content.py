"""Plain data as JSON: the keys of points, their texts in a store, and the record of what a function uses."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

#: Kinds of arrays that are plain data.
_KINDS = "biufcUS"

#: What subclasses of plain types are written as, where nothing else knows them.
_BASES: tuple[tuple[Any, Callable[[Any], Any]], ...] = (
    *((kind, kind) for kind in (int, float, complex, str, bytes, list, tuple)),
    ((set, frozenset), set),
    (Mapping, dict),
)


class NoContentError(TypeError):
    """The object is not plain data, so two of its kind cannot be compared by content."""


def _as_base(value: Any) -> Any:
    """Return the node of an object of a class that derives from a plain one."""
    for known, base in _BASES:
        if isinstance(value, known):
            return node_of(base(value))
    raise NoContentError(type(value).__name__)


def node_of(value: Any, other: Callable[[Any], Any] = _as_base) -> Any:
    """Return plain data as what JSON can hold; `value_of` returns the data, types and bits included.

    Plain data are None, booleans, numbers, texts, bytes, arrays of these, and lists, tuples, sets and mappings of
    plain data.

    `other`: returns the node of an object of any other class.
    Raises `NoContentError` for anything else, unless `other` is given.
    """
    kind = type(value)
    if isinstance(value, np.generic) and type(value.item()) is not kind:
        return node_of(value.item(), other)
    if value is None or kind in (bool, int, float, str):
        return value
    if kind is complex:
        return {"$complex": [value.real, value.imag]}
    if kind is bytes:
        return {"$bytes": _text(value)}
    if kind is np.ndarray and value.dtype.kind in _KINDS:
        return {"$array": [value.dtype.str, list(value.shape), _text(np.ascontiguousarray(value).tobytes())]}
    if kind is list:
        return [node_of(item, other) for item in value]
    if kind is tuple:
        return {"$tuple": [node_of(item, other) for item in value]}
    if kind in (set, frozenset):
        return {"$set": sorted((node_of(item, other) for item in value), key=_sorted_text)}
    if kind is dict:
        pairs = [[node_of(key, other), node_of(item, other)] for key, item in value.items()]
        if all(type(key) is str and not key.startswith("$") for key in value):
            return dict(pairs)
        return {"$dict": sorted(pairs, key=_sorted_text)}
    return other(value)


def value_of(node: Any) -> Any:
    """Return the plain data that `node_of` has written. Sets come back as sets, mappings as dicts."""
    if isinstance(node, list):
        return [value_of(item) for item in node]
    if not isinstance(node, dict):
        return node
    kind: str
    content: Any
    kind, content = next(iter(node.items()), ("", None))
    if kind == "$complex":
        return complex(*content)
    if kind == "$bytes":
        return base64.b64decode(content)
    if kind == "$array":
        dtype, shape, data = content
        return np.frombuffer(base64.b64decode(data), np.dtype(dtype)).reshape(shape).copy()
    if kind in ("$tuple", "$set"):
        return (tuple if kind == "$tuple" else set)(value_of(item) for item in content)
    if kind == "$dict":
        return {value_of(key): value_of(item) for key, item in content}
    return {key: value_of(item) for key, item in node.items()}


def digest(node: Any) -> str:
    """Return the SHA-256 digest of a node, 64 hexadecimal digits: the same for equal data on every machine."""
    return hashlib.sha256(_sorted_text(node).encode()).hexdigest()


def _sorted_text(node: Any) -> str:
    return json.dumps(node, sort_keys=True)


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode("ascii")
