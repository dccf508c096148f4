"""Compiles kernels with less work than numba does by default, for calls from Python and for calls from other kernels.

numba prepares every function that it compiles for calls from Python: it optimises the function, generates machine
code and two wrappers, and keeps all of it on disk. A kernel that is called by other kernels needs none of this,
because its code is linked into that of its callers and optimised there. Leaving it out halves the time of
compilation. The results are the same, because all arithmetic is IEEE.

numba also counts the references to every array, whenever a function is entered or left and whenever an array is taken
out of a tuple. Kernels take bundles of many arrays, so this counting took two thirds of the time of a step of a small
system. A kernel that allocates nothing, and returns no array, only uses arrays that its caller keeps until it returns.
Its code therefore counts no references.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

#: Expressions of numba's intermediate language whose arrays, if any, are parts or views of others.
_PARTS = frozenset(
    ["getattr", "getitem", "static_getitem", "typed_getitem", "build_tuple", "exhaust_iter", "cast", "phi"]
)


class _Compilers(NamedTuple):
    """Classes of compilers: of functions that are called from Python, and of those that only kernels call."""

    entry: Any
    callee: Any


def callee(function: Any) -> Any:
    """Return the form of a function that compiled functions call; it cannot be called from Python.

    Raises
    ------
    ImportError, AttributeError
        If the compiler of this version of numba is built differently.
    """
    import numba

    return numba.njit(pipeline_class=_compilers().callee, no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)


def entry_compiler() -> Any:
    """Return the compiler (`pipeline_class` of numba) of functions that are called from Python.

    Raises
    ------
    ImportError, AttributeError
        If the compiler of this version of numba is built differently.
    """
    return _compilers().entry


@cache
def _compilers() -> _Compilers:
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler import CompilerBase, DefaultPassBuilder
    from numba.core.compiler_machinery import AnalysisPass, register_pass
    from numba.core.errors import NumbaError
    from numba.core.lowering import Lower
    from numba.core.typed_passes import NativeLowering

    # The parts of numba that are replaced here; without them numba compiles as usual.
    for name in ("_optimize_functions", "_optimize_final_module", "_finalize_final_module", "get_pointer_to_function"):
        getattr(JITCodeLibrary, name)

    class Code(JITCodeLibrary):
        """Code as it was generated: neither optimised nor translated to that of the machine."""

        def _optimize_functions(self, module: Any) -> None:
            module.data_layout = self._codegen._data_layout

        def _optimize_final_module(self) -> None:
            pass

        def _finalize_final_module(self) -> None:
            self._finalize_dynamic_globals()
            self._finalized = True

        def get_pointer_to_function(self, name: str) -> int:
            return 0

        @property
        def codegen(self) -> Any:
            return _WithoutEnvironment(self._codegen)

    @register_pass(mutates_CFG=False, analysis_only=True)
    class UseCode(AnalysisPass):
        """Lets the next pass, which generates code, fill a `Code`."""

        _name = "vofem_use_code"

        def __init__(self) -> None:
            super().__init__()

        def run_pass(self, state: Any) -> bool:
            state.library = Code(state.targetctx.codegen(), state.func_id.func_qualname)
            state.library.enable_object_caching()
            return True

    class Borrowing(Lower):
        """Generates code that counts no references. Wrappers for calls from Python count them."""

        context: Any

        def lower(self) -> None:
            counting = self.context
            self.context = counting.subtarget(enable_nrt=False)
            try:
                super().lower()
            finally:
                self.context = counting

    @register_pass(mutates_CFG=True, analysis_only=False)
    class Lowering(NativeLowering):
        """Generates code that counts references only where the function allocates or returns arrays."""

        _name = "vofem_lowering"

        def __init__(self) -> None:
            super().__init__()
            self._lower = Lower

        @property
        def lowering_class(self) -> Any:
            return self._lower

        def run_pass(self, state: Any) -> bool:
            if _only_borrows(state):
                given = state.library
                self._lower = Borrowing
                try:
                    return bool(super().run_pass(state))
                except NumbaError as error:
                    # This is how numba refuses to allocate without counting.
                    if "NRT required" not in str(error):
                        raise
                finally:
                    self._lower = Lower
                state.library = None
                if isinstance(given, Code):
                    UseCode().run_pass(state)
            return bool(super().run_pass(state))

    class Entry(CompilerBase):
        """numba's compiler, which generates code as `Lowering` does."""

        #: A pass that comes before the code is generated.
        prepare: Any = None

        def define_pipelines(self) -> list[Any]:
            passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
            if self.prepare is not None:
                order = [one for one, _ in passes.passes]
                passes.add_pass_after(self.prepare, order[order.index(NativeLowering) - 1])
            passes.passes = [(Lowering if one is NativeLowering else one, text) for one, text in passes.passes]
            passes.finalize()
            return [passes]

    class Callee(Entry):
        """As `Entry`, with code that is neither optimised nor translated."""

        prepare = UseCode

    return _Compilers(Entry, Callee)


def _only_borrows(state: Any) -> bool:
    """Return whether a function neither returns arrays nor is given new ones by what it calls."""
    from numba.core import ir, types

    bundles: Any = types.NamedTupleClass
    if _holds_arrays(state.return_type):
        return False
    for block in state.func_ir.blocks.values():
        for assignment in block.find_insts(ir.Assign):
            value = assignment.value
            if not isinstance(value, ir.Expr) or value.op in _PARTS:
                continue
            # The call of a bundle's class combines arrays that the caller keeps.
            bundle = value.op == "call" and isinstance(state.typemap[value.func.name], bundles)
            if not bundle and _holds_arrays(state.typemap[assignment.target.name]):
                return False
    return True


def _holds_arrays(kind: Any) -> bool:
    """Return whether values of a type may hold references that are counted."""
    from numba.core import types as names

    types: Any = names
    if isinstance(kind, types.BaseTuple):
        return any(_holds_arrays(one) for one in kind)
    if isinstance(kind, types.Pair):
        return _holds_arrays(kind.first_type) or _holds_arrays(kind.second_type)
    plain = (types.Number, types.Boolean, types.NoneType, types.Literal, types.Function, types.Dispatcher)
    ranges = (types.RangeType, types.RangeIteratorType, types.SliceType)
    return not isinstance(kind, (*plain, *ranges, types.Module, types.Record, types.Omitted))


class _WithoutEnvironment:
    """A code generator of numba that takes no environment: code without Python objects needs none."""

    def __init__(self, generator: Any) -> None:
        self._generator = generator

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: the symbol is not known before the code is linked."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._generator, name)
