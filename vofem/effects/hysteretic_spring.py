"""Hysteretic springs with the backbone of Eq. 24: the law that the paper prints, and one for cyclic loads."""

from __future__ import annotations

from dataclasses import KW_ONLY
from typing import Annotated, Literal

from vofem.assembly import SystemBuilder
from vofem.effects.kinds import Named
from vofem.effects.softening import Backbone, InitialStiffness, LinearLimit, SofteningOf
from vofem.effects.stop import Side, Stop
from vofem.effects.two_points import TwoPoints
from vofem.fractional.constants import ideal
from vofem.laws import PrintedLaw
from vofem.parameters import CHOSEN, Choice, Real, declared, label_of, rule


@declared()
class HystereticSpring(TwoPoints):
    """A spring between two points, or from a point to ground, that softens and keeps a residual elongation.

    The spring is linear up to `linear_limit`. Beyond it, a first loading follows
    the backbone ``F = K (1 - softening(F)) u``, and unloading is elastic with
    stiffness K. `memory` chooses how earlier loading acts on the spring:

    - "printed" is Eqs. 22-25 as they stand. The spring loses its residual
      elongation as soon as the load rises again: loaded to 7 N and unloaded to
      3 N, it jumps from 10 m to 3 m at the first step of reloading. The law is
      driven by the applied force. It therefore holds only for a spring that
      is the single support of a single loaded mass.
    - "cyclic" stores the largest force that was reached. Unloading and reloading are
      elastic up to this force; beyond it the spring follows the backbone.
      Compression has a largest force of its own.

    Raises
    ------
    ArgumentError
        For arguments out of range, or a softening that does not begin at 0 or decreases.
    """

    _: KW_ONLY
    stiffness: InitialStiffness
    linear_limit: LinearLimit
    softening: SofteningOf = None
    memory: Annotated[
        Literal["printed", "cyclic"] | None,
        Choice(
            ("printed", "cyclic"),
            "The memory of the spring for earlier loading, see above. There is no default.",
            "one of 'printed', 'cyclic': 'printed' is Eq. 22 of the paper, which forgets at reloading; 'cyclic' "
            "remembers",
        ),
    ] = None
    name: Named = CHOSEN

    @rule("softening", "stiffness", "linear_limit", "memory", "of")
    def _follow_the_backbone(self) -> None:
        self._backbone = Backbone(label_of(self), self.stiffness, self.linear_limit, self.softening)
        self.softening = self._backbone.softening
        name, unit = self.name, self.units.force
        self._law = self._backbone.law(name, unit=unit) if self.memory == "cyclic" else None

    @property
    def limit_load(self) -> float:
        """The limit load in N, which the spring approaches and never reaches; inf where there is none."""
        return self._backbone.limit

    def operator_stiffness(self, elongation: float, force: float, rising: bool) -> float:
        """Return the stiffness of Eqs. 22 and 25 in N/m: K minus the product of two variable-order operators.

        Parameters
        ----------
        elongation : float
            Elongation of the spring, m.
        force : float
            The applied force in N.
        rising : bool
            Whether the force rises. While the force is constant: whether it rose before.
        """
        softened = ideal(self._backbone.level(abs(force)), abs(elongation) - self.linear_limit)
        loading = ideal(self.stiffness, 1.0 if rising else -1.0)
        return float(self.stiffness - softened * loading)

    def integer_stiffness(self, elongation: float, force: float, rising: bool) -> float:
        """Return the stiffness of Eq. 26 in N/m, the integer-order law of the paper.

        The arguments are those of `operator_stiffness`.
        """
        if rising and elongation > self.linear_limit:
            return self.stiffness * (1.0 - self._backbone.level(abs(force)))
        return self.stiffness

    def compile(self, builder: SystemBuilder) -> None:
        """Add row and law."""
        if self._law is not None:
            builder.add_law(self._row(builder), self._law)
            return
        backbone = self._backbone
        law = PrintedLaw(backbone.label, self.name, self.stiffness, self.linear_limit, backbone.level, backbone.limit)
        builder.add_law(self._row(builder), law)

    def describe(self) -> str:
        """Return name, points and numbers."""
        return (
            f"HystereticSpring {self.name!r} from {self._where()}: {self.stiffness:g} {self.units.stiffness}, "
            f"linear to {self.linear_limit:g} {self.units.coordinate}, "
            f"limit load {self.limit_load:g} {self.units.force}, memory {self.memory}"
        )


@declared()
class CrushingStop(Stop):
    """A stop behind a gap that yields under force and keeps its residual deformation.

    The approach s is ``u_a - u_b`` between two points, ``-eta`` for a stop below,
    and ``eta`` for a stop above. The stop pushes back when s exceeds the gap.
    While it is crushed further than before, its force follows the backbone of
    `HystereticSpring`. When it unloads and is hit again, it is elastic with
    `stiffness`. It never pulls.

    Raises
    ------
    ArgumentError
        For arguments out of range.
    """

    _: KW_ONLY
    gap: Annotated[float, Real("m", "Gap before the stop is touched.")]
    side: Side = None
    stiffness: InitialStiffness
    linear_limit: LinearLimit
    softening: SofteningOf = None
    name: Named = CHOSEN

    @rule("softening", "stiffness", "linear_limit", "gap", "of")
    def _follow_the_backbone(self) -> None:
        backbone = Backbone(label_of(self), self.stiffness, self.linear_limit, self.softening)
        self.softening = backbone.softening
        self._law = backbone.law(self.name, one_sided=True, gap=self.gap, unit=self.units.force)

    @property
    def limit_load(self) -> float:
        """The limit load in N, which the stop approaches and never reaches; inf where there is none."""
        return self._law.limit

    def compile(self, builder: SystemBuilder) -> None:
        """Add row and law."""
        builder.add_law(self._row(builder, -1.0 if self.side == "below" else 1.0), self._law)

    def describe(self) -> str:
        """Return name, place and numbers."""
        units = self.units
        return (
            f"CrushingStop {self.name!r} {self._place()}, {self.stiffness:g} {units.stiffness}, "
            f"linear to {self.linear_limit:g} {units.coordinate}, limit load {self.limit_load:g} {units.force}"
        )
