"""Code of functions that only compiled functions call: neither optimised nor translated to that of the machine."""

from __future__ import annotations

from collections import ChainMap
from typing import Any

from llvmlite.binding import Linkage, create_pass_builder, create_pipeline_tuning_options
from numba.core import config
from numba.core.codegen import JITCodeLibrary

# The parts of numba that are replaced here; without them numba compiles as usual.
for _name in ("_optimize_functions", "_optimize_final_module", "_get_module_for_linking", "get_pointer_to_function"):
    getattr(JITCodeLibrary, _name)


class Code(JITCodeLibrary):
    """Code as it was generated. It is optimised and translated as a part of the code that calls it.

    It is not linked with what it calls either, because that would copy every function into each of its callers.
    """

    _shared_module: Any

    #: Whether references to arrays are counted.
    counts = False

    def finalize(self) -> None:
        """End the code, without linking it."""
        self._raise_if_finalized()
        self._finalize_dynamic_globals()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == Linkage.external:
                function.linkage = "linkonce_odr"
        self._finalized = True

    def parts(self) -> dict[Any, None]:
        """Return this code and all other that it calls, directly or not, in the order of a search."""
        found, waiting = {self: None}, [self]
        while waiting:
            for one in waiting.pop()._linking_libraries:
                if one not in found:
                    found[one] = None
                    if isinstance(one, Code):
                        waiting.append(one)
        return found

    def _get_module_for_linking(self) -> Any:
        """Return all that functions need which numba itself compiles, such as those of users."""
        if self._shared_module is None:
            self._ensure_finalized()
            self._shared_module = self._final_module.clone()
            for one in list(self.parts())[1:]:
                self._shared_module.link_in(bare_module(one), preserve=True)
        return self._shared_module

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def get_pointer_to_function(self, name: str) -> int:
        """Return no address, because there is no machine code."""
        return 0

    @property
    def codegen(self) -> Any:
        """The code generator of kernels."""
        return _CodeGenerator(self._codegen)


class Whole(JITCodeLibrary):
    """The code of a function that is called from Python, into which all that it calls is linked once."""

    _linking_libraries: list[Any]

    #: Whether references to arrays are counted, apart from those that Python holds.
    counts = False

    def finalize(self) -> None:
        """Link the code, optimise it and translate it."""
        parts: dict[Any, None] = {}
        for library in self._linking_libraries:
            parts.update(library.parts() if isinstance(library, Code) else {library: None})
        self._parts = list(parts)
        for one in parts:
            # Versions of numba before 0.62 have no such set.
            self.__dict__.setdefault("_reload_init", set()).update(one.__dict__.get("_reload_init", ()))
            self._final_module.link_in(bare_module(one), preserve=True)
        self._linking_libraries = []
        super().finalize()

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        """Optimise all functions together. Loops are not unrolled, which would take a third of the time for no gain."""
        options = create_pipeline_tuning_options(3)
        options.loop_vectorization, options.loop_unrolling = bool(config.LOOP_VECTORIZE), False
        counted = self.counts or any(isinstance(one, Code) and one.counts for one in self._parts)
        # The first time combines functions, so that references which are counted up and down again are found.
        for _ in range(2 if counted else 1):
            builder = create_pass_builder(self._codegen._tm, options)
            manager = builder.getModulePassManager()
            manager.add_refprune_pass()
            manager.run(self._final_module, builder)


def bare_module(library: Any) -> Any:
    """Return the module of a library, without what it calls in the case of a `Code`."""
    library._ensure_finalized()
    return library._final_module if isinstance(library, Code) else library._get_module_for_linking()


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

#: Parts of functions that were compiled, for functions that do not count references and for those that do. The latter
#: use the former too.
_WITHOUT: dict[Any, Any] = {}
_PARTS: dict[bool, Any] = {False: _WITHOUT, True: ChainMap({}, _WITHOUT)}


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
