"""The methods that there are, by name, and how messages recommend one.

A method is added by one module, which describes it as a `Method` and gives it
to `register`. From then on `vofem.simulate`, `vofem.explain`, scene files, the
studies of accuracy, the catalogue of verification and the command line know it.
"""

from __future__ import annotations

from typing import Any

from vofem.errors import ArgumentError
from vofem.integrators.method import Method
from vofem.integrators.methods import BUILT_IN
from vofem.system import System

_METHODS: dict[str, Method] = {method.name: method for method in BUILT_IN}


def register(method: Method) -> Method:
    """Add a method, and return it.

    Raises
    ------
    ArgumentError
        If there is a method of that name, or the name is taken by "auto".
    """
    if method.name in (*_METHODS, "auto"):
        raise ArgumentError(f"register: there is a method named {method.name!r} already; give the new one another name")
    _METHODS[method.name] = method
    return method


def unregister(name: str) -> None:
    """Remove a method that `register` has added.

    Raises
    ------
    ArgumentError
        If there is no such method, or it is one of this package.
    """
    if name not in _METHODS or _METHODS[name] in BUILT_IN:
        raise ArgumentError(f"unregister: {name!r} is no method that was registered")
    del _METHODS[name]


def methods() -> tuple[Method, ...]:
    """Return all methods, those of this package first."""
    return tuple(_METHODS.values())


def method_names() -> tuple[str, ...]:
    """Return the names of all methods."""
    return tuple(_METHODS)


def method_named(name: str) -> Method:
    """Return the method of a name; `KeyError` where there is none."""
    return _METHODS[name]


def without_second_run(name: str) -> dict[str, Any]:
    """Return the options with which a method makes no second run for the sake of a note; studies time one run."""
    return {"nearby": False} if "nearby" in _METHODS[name].options else {}


def ranked() -> list[Method]:
    """Return the methods that "auto" chooses from, the one that it prefers first."""
    return sorted((m for m in _METHODS.values() if m.rank is not None), key=lambda m: -(m.rank or 0))


def advice(system: System | None = None, **flags: bool) -> str:
    """Return how a message names the methods with some flags: ``method='a', 'b' or 'c'``; empty where there is none.

    Methods that are made for one law are left out, unless ``special=True`` asks for them.

    Parameters
    ----------
    system : System, optional
        Methods that refuse it are left out.
    **flags
        Attributes of `Method` and the values that they must have.
    """
    flags = {"special": False, **flags}
    found = [name for name, method in _METHODS.items() if all(getattr(method, flag) == flags[flag] for flag in flags)]
    if system is not None:
        found = [name for name in found if _METHODS[name].refusal(system) is None]
    if not found:
        return ""
    quoted = [repr(name) for name in found]
    return f"method={' or '.join(filter(None, (', '.join(quoted[:-1]), quoted[-1])))}"
