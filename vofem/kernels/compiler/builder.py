"""Writes LLVM's language for bundles of arrays without instructions that take a bundle apart and put it together."""

from __future__ import annotations

from typing import Any

from llvmlite.ir import IRBuilder
from llvmlite.ir.instructions import (
    CastInstr,
    CompareInstr,
    ExtractValue,
    GEPInstr,
    InsertValue,
    Instruction,
    LoadInstr,
    PhiInstr,
    SelectInstr,
)

#: Instructions that only compute a value, besides arithmetic.
_VALUES = (CastInstr, CompareInstr, ExtractValue, GEPInstr, InsertValue, LoadInstr, SelectInstr)
_ARITHMETIC = frozenset(["add", "sub", "mul", "and", "or", "xor", "fadd", "fsub", "fmul", "fneg"])


class Builder(IRBuilder):
    """llvmlite's builder, which takes a part of a bundle from where the bundle was put together.

    A function gets the parts of its bundles one by one, and gives them on one by one. numba's code combines them in
    between. Most of these instructions are not needed, and LLVM would take long to remove them.
    """

    _block: Any
    _anchor: Any

    def __init__(self, block: Any) -> None:
        super().__init__(block)
        self._parts: dict[tuple[Any, int], Any] = {}

    def extract_value(self, agg: Any, idx: Any, name: str = "") -> Any:
        """Return a part of an aggregate: one that is known already, if there is one."""
        place = idx if isinstance(idx, int) else idx[0] if len(idx) == 1 else None
        if place is None:
            return super().extract_value(agg, idx, name)
        whole = agg
        while isinstance(whole, InsertValue) and len(whole.indices) == 1:
            if whole.indices[0] == place:
                return whole.operands[1]
            whole = whole.operands[0]
        if not isinstance(whole, Instruction):
            return super().extract_value(whole, place, name)
        part = self._parts.get((whole, place))
        if part is None:
            part = self._parts[whole, place] = self._take(whole, place, name)
        return part

    def _take(self, whole: Any, place: int, name: str) -> Any:
        """Write the instruction into the block that defines the aggregate, where it holds for all later uses."""
        home = whole.parent
        if home is self.block:
            return super().extract_value(whole, place, name)
        here, anchor = self._block, self._anchor
        if home.is_terminated:
            self.position_before(home.terminator)
        else:
            self.position_at_end(home)
        part = super().extract_value(whole, place, name)
        self._block, self._anchor = here, anchor
        return part


def drop_unused(function: Any) -> None:
    """Remove instructions of a function which only compute a value that nothing uses."""
    uses: dict[Any, int] = {}
    for block in function.blocks:
        for one in block.instructions:
            for operand in _operands(one):
                uses[operand] = uses.get(operand, 0) + 1
    for block in reversed(function.blocks):
        kept = []
        for one in reversed(block.instructions):
            if (isinstance(one, _VALUES) or one.opname in _ARITHMETIC) and not uses.get(one):
                for operand in _operands(one):
                    uses[operand] -= 1
            else:
                kept.append(one)
        block.instructions[:] = reversed(kept)


def _operands(one: Any) -> list[Any]:
    """Return the results of other instructions that an instruction uses."""
    used = [value for value, _ in one.incomings] if isinstance(one, PhiInstr) else one.operands
    return [value for value in used if isinstance(value, Instruction)]
