"""The compilers of kernels: of those that are called from Python, and of those that only kernels call."""

from __future__ import annotations

from typing import Any

from numba.core import ir
from numba.core import types as numba_types
from numba.core.codegen import CPUCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.errors import NumbaError
from numba.core.typed_passes import NativeLowering, NopythonRewrites
from numba.core.untyped_passes import InlineClosureLikes

from vofem.kernels.compiler.code import Code, Whole
from vofem.kernels.compiler.lowering import Borrowing, Lending
from vofem.kernels.compiler.overloads import own_overloads

types: Any = numba_types

#: Expressions of numba's intermediate language whose arrays, if any, are parts or views of others.
_PARTS = frozenset(
    ["getattr", "getitem", "static_getitem", "typed_getitem", "build_tuple", "exhaust_iter", "cast", "phi"]
)


@register_pass(mutates_CFG=False, analysis_only=True)
class UseWhole(AnalysisPass):
    """Lets the next pass, which generates code, fill a `Whole`."""

    _name = "vofem_use_whole"

    library: type[CPUCodeLibrary] = Whole

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> bool:
        """Make an empty library."""
        state.library = _empty(self.library, state)
        return True


@register_pass(mutates_CFG=False, analysis_only=True)
class UseCode(UseWhole):
    """Lets the next pass, which generates code, fill a `Code`."""

    _name = "vofem_use_code"

    library = Code


def _empty(library: type[CPUCodeLibrary], state: Any) -> CPUCodeLibrary:
    """Return an empty library for the function that is being compiled."""
    empty = library(state.targetctx.codegen(), state.func_id.func_qualname)
    empty.enable_object_caching()
    return empty


@register_pass(mutates_CFG=True, analysis_only=False)
class Lowering(NativeLowering):
    """Generates code that counts references only where the function allocates or returns arrays."""

    _name = "vofem_lowering"

    def __init__(self) -> None:
        super().__init__()
        self._lower: type[Lending] = Lending

    @property
    def lowering_class(self) -> type[Lending]:
        """The class that generates the code."""
        return self._lower

    def run_pass(self, state: Any) -> bool:
        """Generate the code."""
        if only_borrows(state):
            given = state.library
            self._lower = Borrowing
            try:
                return bool(super().run_pass(state))
            except NumbaError as error:
                # This is how numba refuses to allocate without counting.
                if "NRT required" not in str(error):
                    raise
            finally:
                self._lower = Lending
            state.library = _empty(type(given), state)
        state.library.counts = True
        return bool(super().run_pass(state))


@register_pass(mutates_CFG=True, analysis_only=False)
class Closures(InlineClosureLikes):
    """Combines functions with those that are defined in them, and lists with arrays, where there are any."""

    _name = "vofem_closures"

    def run_pass(self, state: Any) -> bool:
        """Change the function."""
        kinds = ("make_function", "build_list")
        blocks = state.func_ir.blocks.values()
        return any(any(block.find_exprs(kind)) for block in blocks for kind in kinds) and super().run_pass(state)


@register_pass(mutates_CFG=True, analysis_only=False)
class Rewrites(NopythonRewrites):
    """Combines operations on arrays, where there are any."""

    _name = "vofem_rewrites"

    def run_pass(self, state: Any) -> bool:
        """Change the function."""
        return not only_borrows(state) and super().run_pass(state)


#: Passes of numba, and what takes their place.
_INSTEAD = {NativeLowering: Lowering, InlineClosureLikes: Closures, NopythonRewrites: Rewrites}


class Entry(CompilerBase):
    """numba's compiler, which generates code as `Lowering` does."""

    #: The pass that comes before the code is generated.
    prepare: Any = UseWhole

    def compile_extra(self, func: Any) -> Any:
        """Compile a function, and what it calls."""
        with own_overloads(Callee):
            return super().compile_extra(func)

    def define_pipelines(self) -> list[Any]:
        """Return the passes of the compiler."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        order = [one for one, _ in passes.passes]
        passes.add_pass_after(self.prepare, order[order.index(NativeLowering) - 1])
        passes.passes = [(_INSTEAD.get(one, one), text) for one, text in passes.passes]
        passes.finalize()
        return [passes]


class Callee(Entry):
    """As `Entry`, with code that is neither optimised nor translated."""

    prepare = UseCode

    def compile_extra(self, func: Any) -> Any:
        """Compile a function as a part of a kernel, whose compilation is under way."""
        return CompilerBase.compile_extra(self, func)


def only_borrows(state: Any) -> bool:
    """Return whether a function neither returns arrays nor is given new ones by what it calls."""
    bundles = types.NamedTupleClass
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
    if isinstance(kind, types.BaseTuple):
        return any(_holds_arrays(one) for one in kind)
    if isinstance(kind, types.Pair):
        return _holds_arrays(kind.first_type) or _holds_arrays(kind.second_type)
    plain = (types.Number, types.Boolean, types.NoneType, types.Literal, types.Function, types.Dispatcher)
    ranges = (types.RangeType, types.RangeIteratorType, types.SliceType)
    return not isinstance(kind, (*plain, *ranges, types.Module, types.Record, types.Omitted))
