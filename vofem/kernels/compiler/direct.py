"""Translates what kernels do most from numba's language to LLVM's, with few instructions.

These are arithmetic of numbers, reading and writing elements of arrays, rows and sizes of arrays, and loops over
ranges. For each of them numba writes ten to a hundred instructions, most of which store a value in memory and read it
again. LLVM removes these later, but writing, reading and removing them is most of the time of compilation.
"""

from __future__ import annotations

import operator
import sys
from collections import Counter
from typing import Any

from llvmlite.ir import Constant, Undefined
from numba.core import cgutils, ir
from numba.core import types as numba_types
from numba.core.analysis import must_use_alloca
from numba.core.lowering import Lower

types: Any = numba_types

#: Operators for which numba has functions of its own where an operand is a constant, and products.
_POWERS = frozenset([operator.pow, operator.ipow])
_PRODUCTS = frozenset([operator.mul, operator.imul])
_COMPLEX = _PRODUCTS | {operator.truediv, operator.itruediv}

#: The parts of a complex number.
_PARTS = {"real": 0, "imag": 1}

#: Attributes of arrays, and the names that numba gives them.
_SIZES = {"size": "nitems", "shape": "shape"}


class Direct(Lower):
    """As numba's own, with fewer instructions."""

    context: Any
    builder: Any
    blocks: Any
    func_ir: Any

    #: Whether references to arrays are counted.
    counts = True

    def init(self) -> None:
        """Find the iterators that are used in loops only."""
        super().init()
        values = [one for block in self.blocks.values() for one in block.find_insts(ir.Assign)]
        times = Counter(one.target.name for one in values)
        special = must_use_alloca(self.func_ir.blocks)
        #: Variables that are assigned once.
        self._once = {name for name, count in times.items() if count == 1 and name not in special}
        #: What these iterators and their copies stand for: the variable to which the iterator was given first.
        self._iterators = _of_loops(self.blocks)
        #: Where counters of iterators over ranges are stored, with the ends and the steps of the ranges,
        #: and whether no number of the range is negative.
        self._counters: dict[str, tuple[Any, Any, int, bool]] = {}
        self._others: set[str] = set()
        #: Variables that hold tuples, with those that these were built of.
        self._tuples: dict[str, list[str]] = {}
        #: Variables that hold numbers of such a range, which are not negative.
        self._natural: set[str] = set()

    def lower_assign(self, ty: Any, inst: Any) -> Any:
        """Return the value that is assigned; that of an iterator over a range is not used."""
        value, name = inst.value, inst.target.name
        if isinstance(value, ir.Expr) and value.op == "getiter" and self._begin(value, name):
            return Constant(self.context.get_value_type(ty), Undefined)
        result = super().lower_assign(ty, inst)
        if isinstance(value, ir.Expr) and value.op == "build_tuple" and name in self._once:
            self._tuples[name] = [item.name for item in value.items]
        if name in self._once and self._is_natural(value):
            self._natural.add(name)
        return result

    def _is_natural(self, value: Any) -> bool:
        """Return whether a value is a number of a range without negative numbers, or the pair that holds it."""
        if isinstance(value, ir.Var):
            return value.name in self._natural
        if not isinstance(value, ir.Expr):
            return False
        if value.op == "iternext":
            return bool(self._counters.get(self._iterators.get(value.value.name, ""), (0, 0, 0, False))[3])
        return value.op == "pair_first" and value.value.name in self._natural

    def lower_expr(self, resty: Any, expr: Any) -> Any:
        """Return the value of an expression, and leave most kinds of expressions to numba."""
        result = None
        if expr.op == "getattr":
            result = self._attribute(expr)
        elif expr.op == "call":
            result = self._call(resty, expr)
        elif expr.op == "iternext":
            result = self._next(resty, expr)
        elif expr.op in ("pair_first", "pair_second") and isinstance(resty, (types.Number, types.Boolean)):
            result = self.builder.extract_value(self.loadvar(expr.value.name), int(expr.op == "pair_second"))
        elif expr.op == "static_getitem" and expr.index_var is not None and self._is_array(expr.value):
            return self.lower_getitem(resty, expr, expr.value, expr.index_var, self.fndesc.calltypes[expr])
        return super().lower_expr(resty, expr) if result is None else result

    def _is_array(self, variable: Any) -> bool:
        return isinstance(self.typeof(variable.name), types.Array)

    # -- loops ------------------------------------------------------------------------------------

    def _call(self, resty: Any, expr: Any) -> Any:
        """Return a range or a slice, which are known by their parts; None for other calls."""
        called = self.typeof(expr.func.name)
        if not isinstance(called, types.Function) or expr.kws or expr.vararg:
            return None
        if called.typing_key is range:
            kind, most = resty.dtype, None
        elif called.typing_key is slice and resty == types.slice2_type:
            kind, most = types.intp, sys.maxsize
        else:
            return None
        zero, one, last = (
            None if number is None else self.context.get_constant(kind, number) for number in (0, 1, most)
        )
        given = [self.loadvar(item.name) for item in expr.args]
        kinds = [self.typeof(item.name) for item in expr.args]
        if len(given) == 1:
            given, kinds = [zero, *given], [kind, *kinds]
        for place, default in enumerate((zero, last)):
            if isinstance(kinds[place], types.NoneType):
                given[place], kinds[place] = default, kind
        parts = [self.context.cast(self.builder, *pair, kind) for pair in zip(given, kinds, strict=True)]
        return self._struct(resty, parts if len(parts) == 3 else [*parts, one])

    def _begin(self, getiter: Any, name: str) -> bool:
        """Begin to count where a loop runs over a range of whole numbers with a constant step; return whether."""
        kind = self.typeof(getiter.value.name)
        if not isinstance(kind, types.RangeType) or kind.dtype != types.int64:
            return False
        if self._iterators.get(name) != name or name in self._others:
            return False
        start, stop, step = (self.builder.extract_value(self.loadvar(getiter.value.name), k) for k in range(3))
        if not isinstance(step, Constant) or step.constant == 0:
            return False
        counter = cgutils.alloca_once(self.builder, start.type)
        self.builder.store(start, counter)
        natural = step.constant > 0 and isinstance(start, Constant) and start.constant >= 0
        self._counters[name] = counter, stop, step.constant, natural
        return True

    def _next(self, resty: Any, expr: Any) -> Any:
        """Return the next number of a range and whether there is one; None for other iterators."""
        origin = self._iterators.get(expr.value.name)
        if origin not in self._counters:
            self._others.add(str(origin))
            return None
        builder, (counter, stop, step, _) = self.builder, self._counters[str(origin)]
        number = builder.load(counter)
        builder.store(builder.add(number, number.type(step)), counter)
        return self._struct(resty, [number, builder.icmp_signed("<" if step > 0 else ">", number, stop)])

    # -- numbers ----------------------------------------------------------------------------------

    def _struct(self, kind: Any, parts: list[Any]) -> Any:
        """Return a value that is combined of parts."""
        whole = Constant(self.context.get_value_type(kind), Undefined)
        for place, part in enumerate(parts):
            whole = self.builder.insert_value(whole, part, place)
        return whole

    def _attribute(self, expr: Any) -> Any:
        """Return a part of a complex number, or size or shape of an array; None for other attributes."""
        kind = self.typeof(expr.value.name)
        if isinstance(kind, types.Complex) and expr.attr in _PARTS:
            return self.builder.extract_value(self.loadvar(expr.value.name), _PARTS[expr.attr])
        if isinstance(kind, types.Array) and expr.attr in _SIZES:
            model = self.context.data_model_manager[kind]
            return model.get(self.builder, self.loadvar(expr.value.name), _SIZES[expr.attr])
        return None

    def lower_binop(self, resty: Any, expr: Any, op: Any) -> Any:
        """Return the result of an operator, and leave that of operands which are not numbers to numba."""
        signature = self.fndesc.calltypes[expr]
        numbers = all(isinstance(kind, (types.Integer, types.Float, types.Complex)) for kind in signature.args)
        if not numbers:
            return super().lower_binop(resty, expr, op)
        if op in _POWERS:
            if expr.static_rhs != 2 or not isinstance(signature.return_type, types.Float):
                return super().lower_binop(resty, expr, op)
            base = self.context.cast(
                self.builder, self.loadvar(expr.lhs.name), self.typeof(expr.lhs.name), signature.return_type
            )
            return self.context.cast(self.builder, self.builder.fmul(base, base), signature.return_type, resty)
        operands = [
            self.context.cast(self.builder, self.loadvar(one.name), self.typeof(one.name), kind)
            for one, kind in zip((expr.lhs, expr.rhs), signature.args, strict=True)
        ]
        if op in _COMPLEX and isinstance(signature.return_type, types.Complex):
            own = self._product if op in _PRODUCTS else self._quotient
            result = own(signature.return_type, *operands)
        else:
            function = self.context.typing_context.resolve_value_type(op)
            function.get_call_type(self.context.typing_context, signature.args, {})
            result = self.context.get_function(function, signature)(self.builder, operands)
        return self.context.cast(self.builder, result, signature.return_type, resty)

    def _product(self, kind: Any, one: Any, two: Any) -> Any:
        """Return the product of complex numbers: numba's own function for it is a hundred times longer.

        The difference is in products of infinite numbers.
        """
        builder = self.builder
        a, b, c, d = (builder.extract_value(value, part) for value in (one, two) for part in (0, 1))
        real = builder.fsub(builder.fmul(a, c), builder.fmul(b, d))
        imaginary = builder.fadd(builder.fmul(a, d), builder.fmul(b, c))
        return self._struct(kind, [real, imaginary])

    def _quotient(self, kind: Any, one: Any, two: Any) -> Any:
        """Return the quotient of complex numbers, by the larger part of the divisor as numba does."""
        builder, context = self.builder, self.context
        a, b, c, d = (builder.extract_value(value, part) for value in (one, two) for part in (0, 1))
        zero = c.type(0.0)
        both = builder.and_(builder.fcmp_ordered("==", c, zero), builder.fcmp_ordered("==", d, zero))
        with cgutils.if_unlikely(builder, both):
            context.error_model.fp_zero_division(builder, ("complex division by zero",), self.loc)
        # Not ordered, so that a part which is not a number ends in the quotient.
        size_c, size_d = (builder.select(builder.fcmp_ordered("<", x, zero), builder.fneg(x), x) for x in (c, d))
        first = builder.fcmp_unordered(">=", size_c, size_d)
        large, small = builder.select(first, c, d), builder.select(first, d, c)
        ratio = builder.fdiv(small, large)
        divisor = builder.fadd(large, builder.fmul(small, ratio))
        near, far = builder.select(first, a, b), builder.select(first, b, a)
        real = builder.fadd(near, builder.fmul(far, ratio))
        # b - a ratio in the first case, b ratio - a in the second.
        imaginary = builder.fsub(
            builder.select(first, b, builder.fmul(b, ratio)), builder.select(first, builder.fmul(a, ratio), a)
        )
        return self._struct(kind, [builder.fdiv(real, divisor), builder.fdiv(imaginary, divisor)])

    # -- arrays -----------------------------------------------------------------------------------

    def lower_getitem(self, resty: Any, expr: Any, value: Any, index: Any, signature: Any) -> Any:
        """Return an element of an array by its address, or a row or a part of one, and leave the rest to numba."""
        kind = self.typeof(value.name)
        address, rest = self._address(value.name, index.name)
        if address is None or (rest and not (isinstance(resty, types.Array) and resty.ndim == rest)):
            return super().lower_getitem(resty, expr, value, index, signature)
        if not rest:
            element = self.context.unpack_value(self.builder, kind.dtype, address)
            return self.context.cast(self.builder, element, kind.dtype, resty)
        builder, model = self.builder, self.context.data_model_manager[kind]
        whole, names = self.loadvar(value.name), ("meminfo", "parent", "itemsize", "shape", "strides")
        meminfo, parent, itemsize, shape, strides = (model.get(builder, whole, name) for name in names)
        lengths, distances = (
            [builder.extract_value(part, k) for k in range(kind.ndim - rest, kind.ndim)] for part in (shape, strides)
        )
        bounds = self._slice(index.name)
        if bounds is not None:
            start, stop = (self._clipped(builder.extract_value(bounds, k), lengths[0]) for k in range(2))
            address = builder.gep(address, [start])
            length = builder.sub(stop, start)
            lengths = [builder.select(builder.icmp_signed("<", length, length.type(0)), length.type(0), length)]
        count = lengths[0]
        for length in lengths[1:]:
            count = builder.mul(count, length)
        axes = types.UniTuple(types.intp, rest)
        row = self._struct(
            resty,
            [meminfo, parent, count, itemsize, address, self._struct(axes, lengths), self._struct(axes, distances)],
        )
        self.incref(resty, row)
        return row

    def _slice(self, index: str) -> Any:
        """Return the slice at the end of an index; None if there is none."""
        if isinstance(self.typeof(index), types.SliceType):
            return self.loadvar(index)
        last = self._indices(index)[-1]
        return self.loadvar(last) if last and isinstance(self.typeof(last), types.SliceType) else None

    def _clipped(self, bound: Any, length: Any) -> Any:
        """Return a bound of a slice within an axis: one below zero counts from its end."""
        builder = self.builder
        if isinstance(bound, Constant) and bound.constant == 0:
            return bound
        if isinstance(bound, Constant) and bound.constant == sys.maxsize:
            return length
        zero = bound.type(0)
        bound = builder.select(builder.icmp_signed("<", bound, zero), builder.add(bound, length), bound)
        bound = builder.select(builder.icmp_signed("<", bound, zero), zero, bound)
        return builder.select(builder.icmp_signed(">", bound, length), length, bound)

    def lower_setitem(self, target_var: Any, index_var: Any, value_var: Any, signature: Any) -> Any:
        """Set an element of an array by its address, and leave the rest to numba."""
        kind, address = self.typeof(value_var.name), None
        if isinstance(kind, (types.Number, types.Boolean)):
            address, rest = self._address(target_var.name, index_var.name)
            address = None if rest else address
        if address is None:
            return super().lower_setitem(target_var, index_var, value_var, signature)
        dtype = self.typeof(target_var.name).dtype
        value = self.context.cast(self.builder, self.loadvar(value_var.name), kind, dtype)
        return self.context.pack_value(self.builder, dtype, value, address)

    def _address(self, array: str, index: str) -> tuple[Any, int]:
        """Return the address of an element of an array of numbers, or of a row, and the number of axes that are left.

        The address is None where the index means something else.
        """
        kind, where = self.typeof(array), self.typeof(index)
        if not isinstance(kind, types.Array) or kind.layout not in "CA" or not kind.aligned:
            return None, 0
        if not isinstance(kind.dtype, (types.Number, types.Boolean)) or self.context.enable_boundscheck:
            return None, 0
        several = isinstance(where, types.BaseTuple)
        axes = tuple(where) if several else (where,)
        if axes and axes[-1] == types.slice2_type and len(axes) == kind.ndim and kind.layout == "C":
            # The slice of the last axis is left to the caller.
            if several and not self._indices(index)[-1]:
                return None, 0
            axes = axes[:-1]
        rest = kind.ndim - len(axes)
        if rest < 0 or (rest and kind.layout == "A") or not all(isinstance(axis, types.Integer) for axis in axes):
            return None, 0
        builder, model = self.builder, self.context.data_model_manager[kind]
        bundle, given = self.loadvar(array), self.loadvar(index)
        shape, strides = (model.get(builder, bundle, name) for name in ("shape", "strides"))
        offset = None
        for k in range(kind.ndim):
            at = None
            if k < len(axes):
                at = builder.extract_value(given, k) if several else given
                if self._indices(index)[k] not in self._natural:
                    at = self._from_start(at, axes[k], shape, k)
            if kind.layout == "A":
                at = builder.mul(builder.extract_value(strides, k), at)
            elif offset is not None:
                offset = builder.mul(offset, builder.extract_value(shape, k))
            if at is not None:
                offset = at if offset is None else builder.add(offset, at)
        data = model.get(builder, bundle, "data")
        if offset is None:
            return data, rest
        if kind.layout == "A":
            return cgutils.pointer_add(builder, data, offset), rest
        return builder.gep(data, [offset]), rest

    def _indices(self, index: str) -> list[str]:
        """Return the variables of an index, which may be a tuple of some; names that do not exist if it is another."""
        kind = self.typeof(index)
        others = [""] * len(kind) if isinstance(kind, types.BaseTuple) else [index]
        return self._tuples.get(index, others)

    def _from_start(self, index: Any, kind: Any, shape: Any, axis: int) -> Any:
        """Return an index counted from the start of an axis: one below zero counts from its end."""
        builder = self.builder
        index = self.context.cast(builder, index, kind, types.intp if kind.signed else types.uintp)
        if not kind.signed or (isinstance(index, Constant) and index.constant >= 0):
            return index
        wrapped = builder.add(builder.extract_value(shape, axis), index)
        return builder.select(builder.icmp_signed("<", index, index.type(0)), wrapped, index)


def _of_loops(blocks: Any) -> dict[str, str]:
    """Return the iterators that are used in loops only, and their copies, with the names that iterators had first."""
    first: dict[str, str] = {}
    copies: list[tuple[str, str]] = []
    spoilt: set[str] = set()
    for block in blocks.values():
        for one in block.body:
            value = one.value if isinstance(one, ir.Assign) else None
            if isinstance(value, ir.Var):
                copies.append((one.target.name, value.name))
            elif isinstance(value, ir.Expr) and value.op == "getiter":
                spoilt.update([one.target.name] if one.target.name in first else [])
                first[one.target.name] = one.target.name
            elif not isinstance(one, ir.Del) and not (isinstance(value, ir.Expr) and value.op == "iternext"):
                # Other uses of a variable, or other values that it is given.
                spoilt.update(var.name for var in one.list_vars())
    known = -1
    while len(first) + len(spoilt) > known:
        known = len(first) + len(spoilt)
        for target, source in copies:
            if source in first and first.setdefault(target, first[source]) != first[source]:
                spoilt.update([first[target], first[source]])
            if target in first and source not in first:
                spoilt.add(target)
    bad = {origin for name, origin in first.items() if name in spoilt}
    return {name: origin for name, origin in first.items() if origin not in bad}
