"""A text that identifies plain data: it is the same for equal data in every process and on every machine."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np


class NoContentError(TypeError):
    """The object is not plain data, so two of its kind cannot be compared by content."""


def content(value: Any) -> str:
    """Return a text that is the same for the same data, type and bits included.

    Plain data are None, booleans, numbers, texts, arrays of these, and lists,
    tuples, sets and mappings of plain data.

    Raises
    ------
    NoContentError
        For anything else.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, str, bytes)):
        return f"{type(value).__name__}:{value!r}"
    if isinstance(value, float):
        return f"float:{value.hex()}"
    if isinstance(value, complex):
        return f"complex:{value.real.hex()},{value.imag.hex()}"
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufcUS":
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
        return f"array:{value.dtype.str}{value.shape}:{digest}"
    if isinstance(value, (list, tuple)):
        return f"{type(value).__name__}:[{','.join(content(item) for item in value)}]"
    if isinstance(value, (set, frozenset)):
        return f"set:[{','.join(sorted(content(item) for item in value))}]"
    if isinstance(value, Mapping):
        items = sorted((content(key), content(item)) for key, item in value.items())
        return f"mapping:[{','.join(f'{key}={item}' for key, item in items)}]"
    raise NoContentError(type(value).__name__)


def digest(text: str) -> str:
    """Return the SHA-256 digest of a text, 64 hexadecimal digits."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
