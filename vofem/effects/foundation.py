"""Elastic foundations of Winkler's type, two-sided or with lift-off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from vofem.arrays import Array
from vofem.assembly import ContactEntry, SystemBuilder
from vofem.bodies.base import Row
from vofem.bodies.beam import Beam
from vofem.bodies.coefficient import evaluate_along
from vofem.bodies.cubics import hermite, rows_on_elements
from vofem.bodies.kinds import Along
from vofem.effects.kinds import Acting, OnBody
from vofem.errors import ArgumentError
from vofem.parameters import CHOSEN, Flag, Name, Real, declared, label_of, rule

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


#: Gauss points per element: exact for a stiffness of degree 7 times two cubics.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(7)


@declared()
class Foundation(Acting):
    """A Winkler foundation along a whole beam: a force ``-k(x) eta`` per length.

    The beam may lift off from a one-sided foundation. Such a foundation is modelled by a contact below every node
    (``acts_on="penetration"``), with the stiffness of the length that belongs to the node. The paper mentions such
    contact along the whole length at the end of section 4.2.

    Raises
    ------
    ArgumentError
        If a gap is given for a two-sided foundation, or a value is out of range.
    """

    beam: Annotated[Beam, OnBody("The beam that rests on the foundation.", beam=True)]
    _: KW_ONLY
    stiffness: Annotated[
        float | Callable[[Array], Any], Along("N/m per m", "Stiffness k of the foundation.", Real(least=0))
    ]
    one_sided: Annotated[bool, Flag("Whether the foundation can only push, so that the beam may lift off.")] = False
    gap: Annotated[
        float, Real("m", "Gap below the beam, for a one-sided foundation only. A negative gap is a preload.")
    ] = 0.0
    name: Annotated[
        str,
        Name(
            "Unique in a scene. Contacts of a one-sided foundation are called ``name[0]``, ``name[1]``, ... from the "
            "left."
        ),
    ] = CHOSEN

    @rule("gap", "one_sided")
    def _gap_of_one_side(self) -> None:
        if self.gap and not self.one_sided:
            raise ArgumentError(
                f"{label_of(self)}: gap is {self.gap:g} m, but a two-sided foundation has none; set one_sided"
            )

    def along(self, x: Array) -> Array:
        """Return k in N/m per m at points x, checked."""
        return evaluate_along(f"Foundation {self.name!r}: stiffness", self.stiffness, x, negative=False)

    def compile(self, builder: SystemBuilder) -> None:
        """Add strains to the stiffness, or a contact at every node."""
        if not self.one_sided:
            builder.add_strains(self.beam, self._strains())
            return
        h = self.beam.element_lengths
        share = 0.5 * (np.append(h, 0.0) + np.insert(h, 0, 0.0))
        offset = builder.offsets[self.beam]
        held = {node for node, kind in self.beam.supports.items() if kind != "guided"}
        displacements = np.flatnonzero(~self.beam.degrees_of_freedom.rotation)
        for node, stiffness in enumerate(self.along(self.beam.nodes) * share):
            # Nodes on a support do not move, and nodes without stiffness exert no force.
            if node in held or stiffness == 0.0:
                continue
            row = Row(np.array([offset + displacements[node]]), np.array([-1.0]))
            builder.add_contact(
                ContactEntry(f"{self.name}[{node}]", row, self.gap, float(stiffness), 0.0, False, np.inf)
            )

    def _strains(self) -> csr_matrix:
        """Return rows D with the foundation's stiffness ``D'D``, at the Gauss points of every element."""
        h = self.beam.element_lengths
        xi = 0.5 * (1.0 + _NODES)
        x = self.beam.nodes[:-1, None] + xi * h[:, None]
        root = np.sqrt(self.along(x) * 0.5 * _WEIGHTS * h[:, None])
        return rows_on_elements(np.stack([root * hermite(i, xi, h[:, None]) for i in range(4)], axis=-1))

    def describe(self) -> str:
        """Return beam, stiffness and kind."""
        k = "k(x)" if callable(self.stiffness) else f"{self.stiffness:g}"
        kind = f"one-sided, gap {self.gap:g} m" if self.one_sided else "two-sided"
        return f"Foundation {self.name!r} under {self.beam.label}: {k} N/m per m, {kind}"
