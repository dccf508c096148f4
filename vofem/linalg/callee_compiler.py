"""Compiles kernels for other kernels to call, without machine code of their own.

numba prepares every function that it compiles for calls from Python: it optimises the function, generates machine
code and two wrappers, and keeps all of it on disk. A kernel that is called by other kernels needs none of this,
because its code is linked into that of its callers and optimised there. Leaving it out halves the time of
compilation. What is not optimised twice gives the same results, because all arithmetic is IEEE.
"""

from __future__ import annotations

from functools import cache
from typing import Any


def callee(function: Any) -> Any:
    """Return the form of a function that compiled functions call; it cannot be called from Python.

    Raises
    ------
    ImportError, AttributeError
        If the compiler of this version of numba is built differently.
    """
    import numba

    return numba.njit(pipeline_class=_compiler(), no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)


@cache
def _compiler() -> Any:
    """Return a compiler of numba whose results are linked into those of callers only."""
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler import CompilerBase, DefaultPassBuilder
    from numba.core.compiler_machinery import AnalysisPass, register_pass
    from numba.core.typed_passes import NativeLowering

    # The parts of numba that are replaced here; without them its own way is taken.
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

    class Compiler(CompilerBase):
        """numba's compiler, with this kind of code."""

        def define_pipelines(self) -> list[Any]:
            passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
            order = [entry[0] for entry in passes.passes]
            passes.add_pass_after(UseCode, order[order.index(NativeLowering) - 1])
            passes.finalize()
            return [passes]

    return Compiler


class _WithoutEnvironment:
    """A code generator of numba that takes no environment: code without Python objects needs none."""

    def __init__(self, generator: Any) -> None:
        self._generator = generator

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: the symbol is not known before the code is linked."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._generator, name)
