"""Compiles kernels with less work than numba does by default, for calls from Python and for calls from other kernels.

numba prepares every function that it compiles for calls from Python: it optimises the function, generates machine
code and two wrappers, and keeps all of it on disk. A kernel that is called by other kernels needs none of this,
because its code is linked into that of its callers and optimised there (`code`). The same holds for what numba itself
compiles for a kernel, such as `numpy.empty` (`overloads`). The results are the same, because all arithmetic is IEEE.

What kernels do most, such as loops over ranges and reading elements of arrays, is written in few instructions
(`direct`), and passes of numba that would find nothing to do are left out (`pipelines`).

Kernels take bundles of many arrays. numba copies a bundle whole wherever one of its arrays is read, and it counts the
references to every array whenever a function is entered or left. An argument stays with the caller until the call
ends, so neither is necessary for what belongs to arguments (`lowering`, `builder`).

The modules of this package import numba. They are therefore imported when the first kernel is compiled.
"""

from __future__ import annotations

from typing import Any


def callee(function: Any) -> Any:
    """Return the form of a function that compiled functions call; it cannot be called from Python.

    Raises
    ------
    ImportError, AttributeError
        If the compiler of this version of numba is built differently.
    """
    import numba

    from vofem.kernels.compiler.pipelines import Callee

    made = numba.njit(pipeline_class=Callee, no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)
    resolve = made.get_call_template

    def resolve_once(arguments: Any, named: Any) -> Any:
        # numba would compile the function again for every constant that it is called with.
        plain = numba.types.unliteral
        return resolve([plain(one) for one in arguments], {name: plain(one) for name, one in named.items()})

    made.get_call_template = resolve_once
    return made


def entry_compiler() -> Any:
    """Return the compiler (`pipeline_class` of numba) of functions that are called from Python.

    Raises
    ------
    ImportError, AttributeError
        If the compiler of this version of numba is built differently.
    """
    from vofem.kernels.compiler.pipelines import Entry

    return Entry
