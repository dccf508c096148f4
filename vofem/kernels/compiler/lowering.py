"""Translates kernels from numba's language to LLVM's without counting references to what callers keep."""

from __future__ import annotations

from typing import Any

from numba.core import ir
from numba.core import types as numba_types

from vofem.kernels.compiler.builder import Builder, drop_unused
from vofem.kernels.compiler.code import context_of_kernels
from vofem.kernels.compiler.direct import Direct

types: Any = numba_types


class Lending(Direct):
    """As `Direct`, but arguments and their parts are lent by the caller, who keeps them until the call ends.

    Variables that stand for them need no place in memory, and no references to their arrays are counted.
    """

    fnargs: Any
    call_helper: Any
    _singly_assigned_vars: set[str]
    _blk_local_varmap: dict[str, Any]

    def init(self) -> None:
        """Find the variables that are assigned once, and those among them that are lent."""
        super().init()
        assignments = [one for block in self.blocks.values() for one in block.find_insts(ir.Assign)]
        self._lent: set[str] = set()
        known = -1
        while len(self._lent) > known:
            known = len(self._lent)
            self._lent.update(
                one.target.name for one in assignments if one.target.name in self._once and self._is_lent(one.value)
            )
        self._singly_assigned_vars |= self._lent

    def _is_lent(self, value: Any) -> bool:
        """Return whether a value is an argument or a part of one."""
        if isinstance(value, ir.Arg):
            return not isinstance(self.typeof("arg." + value.name), types.Omitted)
        if isinstance(value, ir.Var):
            return value.name in self._lent
        if not isinstance(value, ir.Expr) or value.op not in ("getattr", "static_getitem"):
            return False
        if value.value.name not in self._lent:
            return False
        kind = self.typeof(value.value.name)
        if value.op == "getattr":
            return isinstance(kind, types.BaseNamedTuple) and value.attr in kind.fields
        return isinstance(kind, types.BaseTuple) and isinstance(value.index, int)

    def lower_assign(self, ty: Any, inst: Any) -> Any:
        """Return the value that is assigned."""
        if inst.target.name not in self._lent:
            return super().lower_assign(ty, inst)
        value = inst.value
        if isinstance(value, ir.Arg):
            return self.context.cast(self.builder, self.fnargs[value.index], self.typeof("arg." + value.name), ty)
        if isinstance(value, ir.Var):
            return self.context.cast(self.builder, self.loadvar(value.name), self.typeof(value.name), ty)
        kind = self.typeof(value.value.name)
        place = kind.fields.index(value.attr) if value.op == "getattr" else value.index % len(kind)
        part = self.builder.extract_value(self.loadvar(value.value.name), place)
        return self.context.cast(self.builder, part, kind[place], ty)

    def delvar(self, name: str) -> None:
        """Let a variable end: what is lent is not released."""
        if name not in self._lent:
            super().delvar(name)

    def lower(self) -> None:
        """Generate the code of the function."""
        given = self.context
        self.context = context_of_kernels(given, self.counts)
        try:
            super().lower()
        finally:
            self.context = given

    def setup_function(self, fndesc: Any) -> None:
        """Begin the function with a `Builder`."""
        super().setup_function(fndesc)
        self.builder = Builder(self.entry_block)
        self.call_helper = self.call_conv.init_call_helper(self.builder)

    def lower_normal_function(self, fndesc: Any) -> None:
        """Generate the code of the function's body."""
        super().lower_normal_function(fndesc)
        drop_unused(self.function)


class Borrowing(Lending):
    """As `Lending`, for functions that only use arrays which their callers keep: no references at all are counted.

    Wrappers for calls from Python count them. Every variable that is assigned once needs no place in memory.
    """

    counts = False

    def init(self) -> None:
        """Find the variables that are assigned once."""
        super().init()
        self._singly_assigned_vars = self._once

    def storevar(self, value: Any, name: str, argidx: int | None = None) -> None:
        """Give a variable a value; the value before needs no release."""
        if name in self._singly_assigned_vars:
            self._blk_local_varmap[name] = value
        else:
            self.builder.store(value, self.getvar(name))

    def delvar(self, name: str) -> None:
        """Do nothing: nothing is released."""
