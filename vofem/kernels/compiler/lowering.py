"""Translates kernels from numba's language to LLVM's, with few instructions for bundles and elements of arrays."""

from __future__ import annotations

import operator
from collections import Counter
from typing import Any

from llvmlite.ir import Constant
from numba.core import cgutils, ir
from numba.core import types as numba_types
from numba.core.analysis import must_use_alloca
from numba.core.lowering import Lower

from vofem.kernels.compiler.builder import Builder, drop_unused
from vofem.kernels.compiler.code import context_of_kernels

types: Any = numba_types

#: Operators for which numba has functions of its own where an operand is a constant, and products.
_POWERS = frozenset([operator.pow, operator.ipow])
_PRODUCTS = frozenset([operator.mul, operator.imul])


class Lending(Lower):
    """As numba's own, but arguments and their parts are lent by the caller, who keeps them until the call ends.

    Variables that stand for them need no place in memory, and no references to their arrays are counted.
    """

    context: Any
    builder: Any
    fnargs: Any
    call_helper: Any
    _singly_assigned_vars: set[str]
    _blk_local_varmap: dict[str, Any]

    #: Whether references to arrays of other variables are counted.
    counts = True

    def init(self) -> None:
        """Find the variables that are assigned once, and those among them that are lent."""
        super().init()
        assignments = [one for block in self.blocks.values() for one in block.find_insts(ir.Assign)]
        times = Counter(one.target.name for one in assignments)
        special = must_use_alloca(self.func_ir.blocks)
        self._once = {name for name, count in times.items() if count == 1 and name not in special}
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

    def lower_binop(self, resty: Any, expr: Any, op: Any) -> Any:
        """Return the result of an operator, and leave that of operands which are not numbers to numba."""
        signature = self.fndesc.calltypes[expr]
        numbers = all(isinstance(kind, (types.Integer, types.Float, types.Complex)) for kind in signature.args)
        if not numbers or op in _POWERS:
            return super().lower_binop(resty, expr, op)
        operands = [
            self.context.cast(self.builder, self.loadvar(one.name), self.typeof(one.name), kind)
            for one, kind in zip((expr.lhs, expr.rhs), signature.args, strict=True)
        ]
        if op in _PRODUCTS and isinstance(signature.return_type, types.Complex):
            result = self._product(signature.return_type, *operands)
        else:
            function = self.context.typing_context.resolve_value_type(op)
            result = self.context.get_function(function, signature)(self.builder, operands)
        return self.context.cast(self.builder, result, signature.return_type, resty)

    def _product(self, kind: Any, one: Any, two: Any) -> Any:
        """Return the product of complex numbers: numba's own function for it is a hundred times longer.

        The difference is in products of infinite numbers.
        """
        builder = self.builder
        a, b, product = (self.context.make_complex(builder, kind, value) for value in (one, two, None))
        product.real = builder.fsub(builder.fmul(a.real, b.real), builder.fmul(a.imag, b.imag))
        product.imag = builder.fadd(builder.fmul(a.real, b.imag), builder.fmul(a.imag, b.real))
        return product._getvalue()

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        """Return an element of an array by its address, and leave the rest to numba."""
        address = self._address(value.name, index.name)
        if address is None:
            return super().lower_getitem(resty, expr, value, index, signature)
        dtype = self.typeof(value.name).dtype
        return self.context.cast(self.builder, self.context.unpack_value(self.builder, dtype, address), dtype, resty)

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        """Set an element of an array by its address, and leave the rest to numba."""
        kind, address = self.typeof(value_var.name), None
        if isinstance(kind, (types.Number, types.Boolean)):
            address = self._address(target_var.name, index_var.name)
        if address is None:
            return super().lower_setitem(target_var, index_var, value_var, signature)
        dtype = self.typeof(target_var.name).dtype
        value = self.context.cast(self.builder, self.loadvar(value_var.name), kind, dtype)
        return self.context.pack_value(self.builder, dtype, value, address)

    def _address(self, array: str, index: str) -> Any:
        """Return the address of an element of an array of numbers; None where the index means something else."""
        kind, where = self.typeof(array), self.typeof(index)
        if not isinstance(kind, types.Array) or kind.layout not in "CA" or not kind.aligned:
            return None
        if not isinstance(kind.dtype, (types.Number, types.Boolean)) or self.context.enable_boundscheck:
            return None
        several = isinstance(where, types.BaseTuple)
        axes = tuple(where) if several else (where,)
        if len(axes) != kind.ndim or not all(isinstance(axis, types.Integer) for axis in axes):
            return None
        builder, model = self.builder, self.context.data_model_manager[kind]
        bundle, given = self.loadvar(array), self.loadvar(index)
        shape, strides = (model.get(builder, bundle, name) for name in ("shape", "strides"))
        offset = None
        for k, axis in enumerate(axes):
            at = self._from_start(builder.extract_value(given, k) if several else given, axis, shape, k)
            if kind.layout == "A":
                at = builder.mul(builder.extract_value(strides, k), at)
            elif offset is not None:
                offset = builder.mul(offset, builder.extract_value(shape, k))
            offset = at if offset is None else builder.add(offset, at)
        data = model.get(builder, bundle, "data")
        if kind.layout == "A":
            return cgutils.pointer_add(builder, data, offset)
        return builder.gep(data, [offset])

    def _from_start(self, index: Any, kind: Any, shape: Any, axis: int) -> Any:
        """Return an index counted from the start of an axis: one below zero counts from its end."""
        builder = self.builder
        index = self.context.cast(builder, index, kind, types.intp if kind.signed else types.uintp)
        if not kind.signed or (isinstance(index, Constant) and index.constant >= 0):
            return index
        wrapped = builder.add(builder.extract_value(shape, axis), index)
        return builder.select(builder.icmp_signed("<", index, index.type(0)), wrapped, index)


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
