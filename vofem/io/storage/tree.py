"""Nested data in an HDF5 group, and back bit for bit.

What may be nested: dicts, lists, tuples, dataclasses and named tuples of this
package, sparse matrices, arrays of numbers, numbers, strings, None. The nest
is one text (JSON) in the dataset ``tree``; every array is a dataset beside it,
named by its path. An object that occurs twice is written once, and is one
object again when read; arrays are not looked at for that.
"""

from __future__ import annotations

import dataclasses
import json
import re
import zlib
from collections.abc import Callable
from importlib import import_module
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from vofem.errors import ArgumentError, StorageError
from vofem.files.hdf5 import FILTERS

#: Says how an object that is not plain is written: a tag and plain data, or None where it does not know the object.
Encode = Callable[[Any], tuple[str, Any] | None]
#: Returns the object that a tag and its data stand for.
Decode = Callable[[str, Any], Any]

_PARTS = ("data", "indices", "indptr")
_SPARSE = ("csr_matrix", "csc_matrix", "csr_array", "csc_array")


def write_tree(group: h5py.Group, value: Any, encode: Encode = lambda value: None) -> None:
    """Write nested data into an empty group.

    Parameters
    ----------
    group : h5py.Group
    value : object
    encode : callable
        Asked first about everything but numbers, strings, arrays and None.

    Raises
    ------
    ArgumentError
        If a file cannot hold something; the message names its path.
    """
    write_text(group, "tree", json.dumps(_Writer(group, encode).node(value, "")))


def read_tree(group: h5py.Group, decode: Decode | None = None) -> Any:
    """Return what `write_tree` has written.

    Arrays come back with the same type, values and order in memory.

    Raises
    ------
    StorageError
        If the text of the group is damaged.
    """
    return _Reader(group, decode or _no_tags).value(json.loads(read_text(group, "tree")))


def write_text(group: h5py.Group, name: str, text: str) -> None:
    """Write a text as a dataset with a checksum."""
    group.create_dataset(name, data=text, dtype=h5py.string_dtype()).attrs["crc32"] = zlib.crc32(text.encode())


def read_text(group: h5py.Group, name: str) -> str:
    """Return a text, checked."""
    raw = group[name][()]
    if zlib.crc32(raw) != int(group[name].attrs["crc32"]):
        raise StorageError(f"{group.file.filename} is damaged: {group.name}/{name} has a wrong checksum; take a copy")
    return str(raw.decode())


def write_array(group: h5py.Group, name: str, array: NDArray) -> h5py.Dataset:
    """Write an array, compressed and with checksums where it has elements."""
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
        if found is not None or is_data(type(value)):
            number = len(self._known)
            self._known[id(value)] = number, value
            if found is not None:
                return {"tag": found[0], "number": number, "of": self.node(found[1], path)}
            fields = {name: self.node(getattr(value, name), f"{path}.{name}") for name in _field_names(type(value))}
            name = f"{type(value).__module__}:{type(value).__qualname__}"
            return {"data": name, "number": number, "fields": fields}
        if type(value) is complex:
            return {"complex": [value.real, value.imag]}
        if type(value) is dict:
            pairs = [
                [self.node(key, f"{path}.key-{k}"), self.node(part, f"{path}.{key}" if isinstance(key, str) else path)]
                for k, (key, part) in enumerate(value.items())
            ]
            return {"dict": pairs}
        if type(value) in (list, tuple):
            return {type(value).__name__: [self.node(part, f"{path}.{k}") for k, part in enumerate(value)]}
        if type(value).__name__ in _SPARSE:
            parts = {
                name: self._array(getattr(value, name), f"{path}.{name}") for name in ("data", "indices", "indptr")
            }
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
            made = _rebuilt(content, {name: self.value(part) for name, part in node["fields"].items()})
            return self._known.setdefault(node["number"], made)
        if kind == "sparse" and content in _SPARSE:
            import scipy.sparse

            data, indices, indptr = (read_array(self._group[node["parts"][name]]) for name in _PARTS)
            return getattr(scipy.sparse, content)((data, indices, indptr), shape=tuple(node["shape"]), copy=False)
        raise StorageError(f"{self._group.file.filename} holds {kind!r}, which this version of vofem does not know")


def _no_tags(tag: str, value: Any) -> Any:
    raise StorageError(f"{tag!r} is no kind of data that is known here; it was written by another vofem")


def is_data(kind: type) -> bool:
    """Return whether a class of this package is plain data: a dataclass or a named tuple."""
    named = issubclass(kind, tuple) and hasattr(kind, "_fields")
    return kind.__module__.startswith("vofem.") and (dataclasses.is_dataclass(kind) or named)


def _field_names(kind: Any) -> tuple[str, ...]:
    return kind._fields if issubclass(kind, tuple) else tuple(field.name for field in dataclasses.fields(kind))


#: Former and present names of classes that have moved and cannot be imported from their former module.
_MOVED = {
    "vofem.memory.laws:MemoryLaw": "vofem.laws.hysteretic:HystereticLaw",
    "vofem.memory.laws:PrintedLaw": "vofem.laws.paper:PrintedLaw",
    "vofem.memory.laws:LinearLevel": "vofem.laws.paper:LinearLevel",
    "vofem.memory.springpot:SpringpotLaw": "vofem.laws.springpot:SpringpotLaw",
    "vofem.system:NonlinearLaws": "vofem.laws.smooth:SmoothLaws",
    "vofem.system:MemoryLaws": "vofem.laws.hysteretic:HystereticLaws",
    "vofem.system:SpringpotLaws": "vofem.laws.springpot:SpringpotLaws",
    "vofem.integrators.stepping.record:Trail": "vofem.integrators.stepping.record:LastStep",
    "vofem.laws.springpot:History": "vofem.laws.springpot_steps:SpringpotState",
    "vofem.integrators.generalized_alpha:_State": "vofem.integrators.generalized_alpha.step:State",
    "vofem.integrators.central_difference:_State": "vofem.integrators.central_difference.step:State",
}


#: Former and present names of fields of states.
_RENAMED = {"memory": "internal", "told": "totals"}


#: Former module, or package of modules, of the functions of time.
_FUNCTIONS = "vofem.effects.time_functions"


def class_named(name: str) -> type:
    """Return the data class of this package that a file names as ``module:class``; a file can name nothing else.

    The module is the one that held the class when the file was written. It
    hands the class on if that has moved since, or `_MOVED` says where it is.

    Raises
    ------
    StorageError
        For any other name.
    """
    module, _, qualified = _MOVED.get(name, name).partition(":")
    if module.startswith(_FUNCTIONS) or module == "vofem.effects.approximated":
        module = "vofem.time_functions"
    if re.fullmatch(r"vofem(\.[a-z]\w*)+", module) and qualified.isidentifier():
        try:
            kind = getattr(import_module(module), qualified, None)
        except ModuleNotFoundError:
            kind = None
        if isinstance(kind, type) and kind.__name__ == qualified and is_data(kind):
            return kind
    raise StorageError(f"{name!r} is no class that a file may name")


def _defaults(kind: Any) -> dict[str, Any]:
    if issubclass(kind, tuple):
        return dict(kind._field_defaults)
    return {field.name: field.default for field in dataclasses.fields(kind) if field.default is not dataclasses.MISSING}


def _rebuilt(name: str, fields: dict[str, Any]) -> Any:
    """Return an object of a data class of this package; fields that came later have their defaults."""
    kind = class_named(name)
    if hasattr(kind, "from_earlier"):
        fields = kind.from_earlier(fields)
    wanted = _field_names(kind)
    fields = {field if field in wanted else _RENAMED.get(field, field): value for field, value in fields.items()}
    fields = {field: value for field, value in _defaults(kind).items() if field not in fields} | fields
    if set(wanted) != set(fields):
        raise StorageError(
            f"{name} has the fields {', '.join(fields)} in this file and {', '.join(wanted)} in this "
            "version of vofem; read it with the version that wrote it"
        )
    if issubclass(kind, tuple):
        return kind(*(fields[field] for field in _field_names(kind)))
    made = object.__new__(kind)
    for field, value in fields.items():
        object.__setattr__(made, field, value)
    return made
