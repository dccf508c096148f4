"""Code of functions that only compiled functions call: neither optimised nor translated to that of the machine."""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary

# The parts of numba that are replaced here; without them numba compiles as usual.
for _name in ("_optimize_functions", "_optimize_final_module", "_finalize_final_module", "get_pointer_to_function"):
    getattr(JITCodeLibrary, _name)


class Code(JITCodeLibrary):
    """Code as it was generated. It is optimised and translated as a part of the code that calls it."""

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return no address, because there is no machine code."""
        return 0

    @property
    def codegen(self) -> Any:
        """The code generator of kernels."""
        return _CodeGenerator(self._codegen)


class _CodeGenerator:
    """A code generator of numba that fills a `Code`.

    It takes no environment, because code without Python objects needs none.
    """

    def __init__(self, generator: Any) -> None:
        self._generator = generator

    def create_library(self, name: str, **options: Any) -> Code:
        """Return an empty library of a name."""
        return Code(self._generator, name, **options)

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: the symbol is not known before the code is linked."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._generator, name)


_GENERATORS: dict[Any, _CodeGenerator] = {}

#: Parts of functions that were compiled, for functions that count references and for those that do not.
_PARTS: dict[bool, dict[Any, Any]] = {True: {}, False: {}}


def context_of_kernels(context: Any, counts: bool) -> Any:
    """Return numba's description of the processor for the compilation of kernels.

    What numba compiles as a part of a kernel, such as the power of a number, becomes a `Code` too.

    Parameters
    ----------
    context : numba.core.cpu.CPUContext
        numba's own description.
    counts : bool
        Whether references to arrays are counted.
    """
    generator = context.codegen()
    of_kernels = _GENERATORS.setdefault(generator, _CodeGenerator(generator))
    other = context.subtarget(enable_nrt=counts, codegen=lambda: of_kernels)
    other.cached_internal_func = _PARTS[counts]
    return other
