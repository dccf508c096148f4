"""Nested data in an HDF5 group, and back bit for bit.

What may be nested: dicts, lists, tuples, sparse matrices, arrays of numbers, numbers, strings, None, and data classes
of this package that have a name in `NAMES`. A named tuple is written as a tuple. The nest is one text (JSON) in the
dataset ``tree``; every array is a dataset beside it, named by its path. If two fields hold the same object, both hold
one object after reading. Arrays are stored once for each field.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable
from functools import cache
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from vofem.cards import imported
from vofem.errors import ArgumentError, StorageError
from vofem.files.hdf5 import FILTERS

#: Says how an object that is not plain is written: a tag and plain data, or None where it does not know the object.
Encode = Callable[[Any], tuple[str, Any] | None]
#: Returns the object that a tag and its data stand for.
Decode = Callable[[str, Any], Any]

_PARTS = ("data", "indices", "indptr")
_SPARSE = ("csr_matrix", "csc_matrix", "csr_array", "csc_array")

#: Name of every data class that a file may hold. Files know classes by these names only, so a class may be moved or
#: renamed; then its place here changes.
NAMES = {
    "approximated": "vofem.time_functions.approximated:Approximated",
    "contacts": "vofem.laws.contact:ContactLaws",
    "counters": "vofem.system:Counters",
    "exponential_order": "vofem.fractional.laws:ExponentialOrder",
    "load": "vofem.system:Load",
    "mesh": "vofem.bodies.mesh:LineMesh",
    "modes": "vofem.integrators.event_driven.modal_space:ModalSpace",
    "piece": "vofem.time_functions.piece:Piece",
    "plan": "vofem.simulate.plan:Plan",
    "probe_rows": "vofem.integrators.base:ProbeRows",
    "recorded": "vofem.io.storage.recorded:Recorded",
    "recorded_load": "vofem.io.storage.recorded:RecordedLoad",
    "samples": "vofem.integrators.base:Samples",
    "sensitivity": "vofem.integrators.base:Sensitivity",
    "shifted": "vofem.time_functions.shifted:Shifted",
    "spring_samples": "vofem.integrators.base:SpringSamples",
    "slider_history": "vofem.integrators.slider_history:SliderHistory",
    "state": "vofem.system:State",
    "stored_state": "vofem.initial:StoredState",
    "system": "vofem.system:System",
    "truncation": "vofem.integrators.base:Truncation",
}

_NAMES_OF = {place: name for name, place in NAMES.items()}


def name_of_class(kind: type) -> str | None:
    """Return the name of a class in files, or None if a file cannot hold its objects."""
    return _NAMES_OF.get(f"{kind.__module__}:{kind.__qualname__}")


@cache
def class_named(name: str) -> Any:
    """Return the class that a name in `NAMES` stands for, imported when it is first needed."""
    return imported(NAMES[name])


def write_tree(group: h5py.Group, value: Any, encode: Encode = lambda value: None) -> None:
    """Write nested data into an empty group.

    `encode`: asked first about everything but numbers, strings, arrays and None.
    Raises `ArgumentError` if a file cannot hold something; the message names its path.
    """
    write_text(group, "tree", json.dumps(_Writer(group, encode).node(value, "")))


def read_tree(group: h5py.Group, decode: Decode | None = None) -> Any:
    """Return what `write_tree` has written.

    Arrays come back with the same type, values and order in memory.

    Raises `StorageError` if the group names a class that is not in `NAMES`, or other fields than the class has.
    """
    return _Reader(group, decode or _no_tags).value(json.loads(read_text(group, "tree")))


def write_text(group: h5py.Group, name: str, text: str) -> None:
    """Write a text as a dataset."""
    group.create_dataset(name, data=text, dtype=h5py.string_dtype())


def read_text(group: h5py.Group, name: str) -> str:
    """Return a text."""
    return str(group[name][()].decode())


def write_array(group: h5py.Group, name: str, array: NDArray) -> h5py.Dataset:
    """Write an array, compressed where it has elements."""
    flipped = array.ndim > 1 and array.flags.f_contiguous and not array.flags.c_contiguous
    data = array.T if flipped else array
    dataset = group.create_dataset(name, data=data, **(FILTERS if data.ndim and data.size else {}))
    if flipped:
        dataset.attrs["order"] = "F"
    return dataset


def read_array(dataset: h5py.Dataset) -> NDArray:
    """Return an array in the order in memory that it was written with."""
    array = np.asarray(dataset[()])
    return array.T if "order" in dataset.attrs else array


class _Writer:
    def __init__(self, group: h5py.Group, encode: Encode) -> None:
        self._group = group
        self._encode = encode
        # Objects are compared by identity. They are kept alive, so that no other object gets the same identity.
        self._known: dict[int, tuple[int, Any]] = {}

    def node(self, value: Any, path: str) -> Any:
        """Return the JSON of a value; write its arrays."""
        if value is None or type(value) in (bool, int, float, str):
            return value
        if isinstance(value, np.ndarray):
            return {"array": self._array(value, path)}
        if isinstance(value, np.generic):
            return {"scalar": self._array(np.asarray(value), path)}
        if id(value) in self._known:
            return {"same": self._known[id(value)][0]}
        found = self._encode(value)
        named = name_of_class(type(value))
        if found is not None or named is not None:
            number = len(self._known)
            self._known[id(value)] = number, value
            if found is not None:
                return {"tag": found[0], "number": number, "of": self.node(found[1], path)}
            names = [field.name for field in dataclasses.fields(value)]
            fields = {name: self.node(getattr(value, name), f"{path}.{name}") for name in names}
            return {"data": named, "number": number, "fields": fields}
        if type(value) is complex:
            return {"complex": [value.real, value.imag]}
        if type(value) is dict:
            pairs = [
                [self.node(key, f"{path}.key-{k}"), self.node(part, f"{path}.{key}" if isinstance(key, str) else path)]
                for k, (key, part) in enumerate(value.items())
            ]
            return {"dict": pairs}
        if isinstance(value, tuple) or type(value) is list:
            kind = "tuple" if isinstance(value, tuple) else "list"
            return {kind: [self.node(part, f"{path}.{k}") for k, part in enumerate(value)]}
        if type(value).__name__ in _SPARSE:
            parts = {name: self._array(getattr(value, name), f"{path}.{name}") for name in _PARTS}
            return {"sparse": type(value).__name__, "shape": [int(n) for n in value.shape], "parts": parts}
        raise ArgumentError(f"{path.removeprefix('.') or 'this'} is {value!r}, which a file cannot hold")

    def _array(self, array: NDArray, path: str) -> str:
        if array.dtype.kind not in "biufc":
            raise ArgumentError(f"{path.removeprefix('.')} is an array of {array.dtype}, expected one of numbers")
        name = stem = re.sub(r"[^A-Za-z0-9_.-]", "_", path.removeprefix(".")) or "array"
        k = 1
        while name in self._group or name in ("tree", ".", ".."):
            k += 1
            name = f"{stem}-{k}"
        write_array(self._group, name, array)
        return name


class _Reader:
    def __init__(self, group: h5py.Group, decode: Decode) -> None:
        self._group = group
        self._decode = decode
        self._known: dict[int, Any] = {}

    def value(self, node: Any) -> Any:
        """Return the value of a JSON node."""
        if not isinstance(node, dict):
            return node
        kind, content = next(iter(node.items()))
        if kind == "array":
            return read_array(self._group[content])
        if kind == "scalar":
            return self._group[content][()]
        if kind == "same":
            return self._known[content]
        if kind == "tag":
            made = self._decode(content, self.value(node["of"]))
            return self._known.setdefault(node["number"], made)
        if kind == "complex":
            return complex(*content)
        if kind == "dict":
            return {self.value(key): self.value(part) for key, part in content}
        if kind in ("list", "tuple"):
            parts = [self.value(part) for part in content]
            return parts if kind == "list" else tuple(parts)
        if kind == "data":
            made = self._made(content, {name: self.value(part) for name, part in node["fields"].items()})
            return self._known.setdefault(node["number"], made)
        if kind == "sparse" and content in _SPARSE:
            import scipy.sparse

            data, indices, indptr = (read_array(self._group[node["parts"][name]]) for name in _PARTS)
            return getattr(scipy.sparse, content)((data, indices, indptr), shape=tuple(node["shape"]), copy=False)
        raise StorageError(f"{self._group.file.filename} holds {kind!r}, which this version of vofem does not know")

    def _made(self, name: str, values: dict[str, Any]) -> Any:
        """Return an object of a class in `NAMES` with the given fields."""
        file = self._group.file.filename
        if name not in NAMES:
            raise StorageError(f"{file} holds {name!r}, which is no kind of data that this version of vofem knows")
        kind = class_named(name)
        wanted = [field.name for field in dataclasses.fields(kind)]
        if set(wanted) != set(values):
            raise StorageError(
                f"{file} holds {name!r} with the fields {', '.join(values)}, expected {', '.join(wanted)}; it is "
                "damaged, or was written by another version of vofem: read it with the version that wrote it"
            )
        made = object.__new__(kind)
        for field, value in values.items():
            object.__setattr__(made, field, value)
        return made


def _no_tags(tag: str, value: Any) -> Any:
    raise StorageError(f"{tag!r} is no kind of data that is known here; it was written by another vofem")
