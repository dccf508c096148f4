"""The identity of a function: a digest of all that it reaches. Rows of a store belong to one identity."""

from __future__ import annotations

import copyreg
import dataclasses
import dis
import functools
import importlib
import importlib.util
import inspect
import sys
import sysconfig
import types
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import Any

from vofem._version import __version__
from vofem.errors import ArgumentError
from vofem.parameters import values_of
from vofem.parameters.declared import was_chosen
from vofem.studies.sweep.points import NoContentError, digest, node_of


def identity(function: Callable[..., Any], compiled: bool = True) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the identity of a function, by which stored rows are recognised as its own, and what it cannot cover.

    It covers what the function reaches: the source of functions and classes of the user's own files, and the content
    of data, scenes and other objects, by the names that the function uses, in closures, defaults and decorators. Of
    installed packages it covers the names, and of vofem the version.

    Returns ``name``, ``source`` (64 hexadecimal digits), ``vofem`` (its version) and ``kernels`` (how they run).
    Returns names whose content is not known, with their types.
    """
    reached = _Reached()
    node = reached.node(function)
    parts = {
        "name": name_of(function).rpartition(".")[2],
        "source": digest(node),
        "vofem": __version__,
        "kernels": "compiled" if compiled else "plain Python",
    }
    return parts, tuple(dict.fromkeys(reached.unknown))


def name_of(function: Any) -> str:
    """Return the module and the name of a function, for messages."""
    while isinstance(function, functools.partial):
        function = function.func
    module = getattr(function, "__module__", None)
    name = getattr(function, "__qualname__", None) or type(function).__qualname__
    return f"{module}.{name}" if module not in (None, "__main__", "__mp_main__") else name


class _Reached:
    """Plain data that stand for objects: equal for equal objects in every process.

    An object is taken apart as `pickle` does it, only that functions and classes of the user's own files are taken
    apart too: into their source and what they use.
    """

    def __init__(self) -> None:
        self.unknown: list[str] = []
        # Objects are compared by identity, and kept, so that no other object gets the same identity.
        self._known: dict[int, tuple[int, Any]] = {}
        self._name = "the function"

    def node(self, value: Any) -> Any:
        """Return the node of anything."""
        return node_of(value, self._object)

    def _object(self, value: Any) -> Any:
        """Return the node of what is no plain data; of an object that was met before, its number."""
        if id(value) in self._known:
            return {"$same": self._known[id(value)][0]}
        self._known[id(value)] = len(self._known), value
        try:
            return {f"${type(value).__name__}": self._parts(value)}
        except (NoContentError, RecursionError):
            self.unknown.append(f"{self._name} ({type(value).__qualname__})")
            return {"$unknown": type(value).__qualname__}

    def _parts(self, value: Any) -> Any:
        """Return what stands for an object, or raise `NoContentError`."""
        if (name := _installed_name(value)) is not None:
            return name
        if isinstance(value, types.FunctionType):
            return self._function(value)
        if isinstance(value, type):
            return self._class(value)
        if type(value).__module__.startswith("vofem."):
            return self._of_vofem(value)
        if hasattr(value, "__wrapped__") and _installed_name(type(value)) is not None:
            # Such as what `functools.lru_cache` and `numba.njit` make.
            return [self.node(type(value)), self.node(value.__wrapped__)]
        return self._pickled(value)

    def _named(self, name: str, value: Any) -> Any:
        """Return the node of a value that a note would call by a name."""
        before, self._name = self._name, name
        try:
            return self.node(value)
        finally:
            self._name = before

    def _function(self, function: types.FunctionType) -> Any:
        code = function.__code__
        uses = _uses(function) if _own(code.co_filename) else ()
        return {
            "source": _source(code),
            "defaults": self.node([function.__defaults__, function.__kwdefaults__, vars(function)]),
            "closure": [
                self._named(name, cell.cell_contents)
                for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True)
                if cell != types.CellType()  # a name that is bound later
            ],
            "uses": [[name, self._named(name, value)] for name, value in uses],
        }

    def _class(self, kind: type) -> Any:
        """Return source, bases and attributes of a class; its methods with what they use."""
        parts: list[Any] = [_source(kind), [self.node(base) for base in kind.__bases__]]
        for name, part in sorted(vars(kind).items()):
            functions = [getattr(part, of, None) for of in ("__func__", "fget", "fset", "fdel", "func")]
            methods = [f for f in (part, *functions) if isinstance(f, types.FunctionType)]
            if methods:
                # What a decorator such as `dataclass` has generated is known by the source of the class.
                written = [method for method in methods if method.__code__.co_filename != "<string>"]
                parts.append([name, [self.node(method) for method in written]])
            elif not name.startswith(("__", "_abc_")):
                parts.append([name, self._named(f"{kind.__qualname__}.{name}", part)])
        if dataclasses.is_dataclass(kind):
            factories = [field.default_factory for field in dataclasses.fields(kind)]
            parts.append([self.node(made) for made in factories if made is not dataclasses.MISSING])
        return parts

    def _of_vofem(self, value: Any) -> Any:
        """Return what an object of vofem was made from: its parameters, or attributes of the names of its arguments."""
        if isinstance(value, dict):
            return self.node(dict(value))
        if hasattr(value, "as_start"):
            # The outcome of a run follows from its scene; its last state stands for how it was run.
            return [self.node(getattr(value, "scene", None)), self.node(value.as_start())]
        try:
            told = values_of(value)
        except ArgumentError:
            raise NoContentError from None
        if was_chosen(told.get("name")):
            del told["name"]
        return [type(value).__qualname__, self.node(told)]

    def _pickled(self, value: Any) -> Any:
        """Return what `pickle` would write of an object."""
        try:
            reduce = copyreg.dispatch_table.get(type(value))
            made = value.__reduce_ex__(4) if reduce is None else reduce(value)
        except Exception as error:  # whatever an object raises that cannot be pickled
            raise NoContentError from error
        if isinstance(made, str):
            return [type(value).__qualname__, made]
        call, arguments, state, items, pairs = (*made, *(None,) * 3)[:5]
        if isinstance(state, dict):
            parts = (pair for kind in type(value).__mro__ for pair in vars(kind).items())
            cached = {name for name, part in parts if isinstance(part, functools.cached_property)}
            state = {name: part for name, part in state.items() if name not in cached}
        return [self.node(part) for part in (call, arguments, state, list(items or ()), list(pairs or ()))]


def _source(thing: Any) -> Any:
    """Return the source of a class or of the code of a function; of code whose source is not there, its parts.

    The source of a lambda is its line, which may hold several of them: its parts too.
    """
    try:
        source = inspect.getsource(thing)
    except (OSError, TypeError):
        source = ""
    if not isinstance(thing, types.CodeType):
        return source or thing.__qualname__
    return source if source and thing.co_name != "<lambda>" else [source, *_code(thing)]


def _code(code: types.CodeType) -> list[Any]:
    """Return what the code of a function consists of, as plain data."""
    constants: list[Any] = []
    for one in code.co_consts:
        if isinstance(one, types.CodeType):
            constants.append(_code(one))
        else:
            # Of a set the order is another one in each process.
            constants.append(sorted(map(repr, one)) if isinstance(one, frozenset) else repr(one))
    return [code.co_code.hex(), code.co_names, constants]


def _own(file: str | None) -> bool:
    """Return whether code of this file is the user's own: part of no installed package, nor of Python or vofem."""
    if file is None or file.startswith("<frozen"):
        return False
    path = Path(file)
    if {"site-packages", "dist-packages"} & set(path.parts):
        return False
    return not any(path.is_relative_to(folder) for folder in _NOT_OWN)


_NOT_OWN = (Path(__file__).parents[2], *(Path(sysconfig.get_path(name)) for name in ("stdlib", "platstdlib")))


def _own_module(module: types.ModuleType | None) -> bool:
    # A module of a notebook or of the standard input has no file.
    return module is not None and (
        module.__name__ in ("__main__", "__mp_main__") or _own(getattr(module, "__file__", None))
    )


def _installed_name(value: Any) -> str | None:
    """Return the name by which an object is imported from an installed package, or None if it is not."""
    if isinstance(value, types.ModuleType):
        return None if _own_module(value) else value.__name__
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
    name = name or getattr(value, "__name__", None)
    if module is None and name is not None and type(value).__module__ in sys.modules:
        module = type(value).__module__  # such as functions of numpy that are written in C
    if not isinstance(module, str) or not isinstance(name, str) or _own_module(sys.modules.get(module)):
        return None
    found: Any = sys.modules.get(module)
    for part in name.split("."):
        found = getattr(found, part, None)
    return f"{module}.{name}" if found is value else None


def _uses(function: types.FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the modules that the code of a function can use."""
    names = sorted(_names(function.__code__))
    package = function.__globals__.get("__package__") or ""
    modules = [found for name in _imported(function.__code__) if (found := _module(name, package)) is not None]
    yield from _among(names, function.__globals__, set())
    for module in modules:
        yield from _among(names, vars(module), {module.__name__})


def _among(names: list[str], values: dict[str, Any], seen: set[str]) -> Iterator[tuple[str, Any]]:
    """Yield the values of these names; of the user's own modules among them, the values of these names in them."""
    for name in names:
        value = values.get(name)
        if isinstance(value, types.ModuleType):
            if _own_module(value) and value.__name__ not in seen:
                yield from _among(names, vars(value), seen | {value.__name__})
        elif name in values:
            yield name, value


def _names(code: types.CodeType) -> set[str]:
    """Return the names that the code of a function uses, with those of functions inside it."""
    inner = (_names(constant) for constant in code.co_consts if isinstance(constant, types.CodeType))
    return set(code.co_names).union(*inner)


def _imported(code: types.CodeType) -> Iterator[str]:
    """Yield the names of modules that the code of a function imports."""
    inner = chain.from_iterable(_imported(one) for one in code.co_consts if isinstance(one, types.CodeType))
    yield from (step.argval for step in dis.get_instructions(code) if step.opname == "IMPORT_NAME")
    yield from inner


def _module(name: str, package: str) -> types.ModuleType | None:
    """Return a module of the user's own files by its name, or by its name in a package; None for any other."""
    for full in (f"{package}.{name}" if package and name else package, name):
        try:
            found = importlib.util.find_spec(full) if full else None
            if found is not None and _own(found.origin):
                return importlib.import_module(full)
        except Exception:  # whatever the module raises when it is imported, the function will raise as well
            continue
    return None
