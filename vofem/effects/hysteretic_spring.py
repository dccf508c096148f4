"""Springs that soften and remember: as the paper prints it, and for cyclic loads."""

from __future__ import annotations

from vofem._validate import choice, number, one_of
from vofem.assembly import SystemBuilder
from vofem.bodies.base import Point, automatic_name
from vofem.effects.side import distinct, side_of
from vofem.effects.softening import Backbone, Softening
from vofem.effects.two_points import TwoPoints
from vofem.errors import ArgumentError
from vofem.fractional.constants import ideal
from vofem.laws import PrintedLaw


class HystereticSpring(TwoPoints):
    """A spring between two points, or from a point to ground, that softens and keeps a residual elongation.

    Up to `linear_limit` it is linear. Beyond, a first loading follows the
    backbone ``F = K (1 - softening(F)) u``, and unloading is elastic at K.
    `memory` says what the spring knows of its past:

    - "printed": Eqs. 22-25 as they stand. The spring forgets its residual
      elongation as soon as the load rises again: loaded to 7 N and unloaded to
      3 N it jumps from 10 m to 3 m at the first step of reloading. The applied
      force drives the law, so it holds for a spring that alone carries a single
      loaded mass.
    - "cyclic": elastic between unloading and reloading up to the largest force
      reached, then on along the backbone; the same in compression, with a
      largest force of its own.

    Parameters
    ----------
    a, b : points
    stiffness : float
        K in N/m, positive.
    linear_limit : float
        d0 in m, positive.
    softening : LinearSoftening or callable, optional
        The number by which the secant stiffness has fallen, as a function of
        the force's magnitude in N: 0 at ``K d0``, not decreasing; where it is 1
        lies the limit load. Eq. 24, ``(|F| - K d0)/(4 N)``, where not given. A
        callable is tabulated once, to 1e-11, up to 1e4 linear limits.
    memory : {"printed", "cyclic"}
        There is no default.
    of : {"displacement", "rotation"}
        Whether it acts on displacements (m, N) or on rotations of beams (rad, N m).
    name : str, optional

    Raises
    ------
    ArgumentError
        For arguments out of range, or a softening that does not begin at 0 or decreases.
    """

    def __init__(
        self,
        a: Point,
        b: Point | None = None,
        *,
        stiffness: float,
        linear_limit: float,
        softening: Softening | None = None,
        memory: str | None = None,
        of: str = "displacement",
        name: str | None = None,
    ) -> None:
        self.name = automatic_name(name, "HystereticSpring")
        label = f"HystereticSpring {self.name!r}"
        self._attach(label, a, b, of)
        self.stiffness = number(f"{label}: stiffness", stiffness, positive=True)
        self.linear_limit = number(f"{label}: linear_limit", linear_limit, positive=True)
        if memory is None:
            raise ArgumentError(
                f"{label}: memory is missing, expected {one_of(('printed', 'cyclic'))}: 'printed' is Eq. 22 of the "
                "paper, which forgets at reloading; 'cyclic' remembers"
            )
        self.memory = choice(f"{label}: memory", memory, ("printed", "cyclic"))
        self._backbone = Backbone(label, self.stiffness, self.linear_limit, softening)
        self.softening: Softening = self._backbone.softening
        self._law = self._backbone.law(self.name, unit=self.units.force) if self.memory == "cyclic" else None

    @property
    def limit_load(self) -> float:
        """The force in N that the spring never reaches; inf where there is none."""
        return self._backbone.limit

    def operator_stiffness(self, elongation: float, force: float, rising: bool) -> float:
        """Return K of Eqs. 22 and 25 in N/m: two variable-order operators on constants, multiplied and taken from K.

        Parameters
        ----------
        elongation : float
            In m.
        force : float
            The applied one, N.
        rising : bool
            Whether it rises; while it is held, whether it rose before.
        """
        softened = ideal(self._backbone.level(abs(force)), abs(elongation) - self.linear_limit)
        loading = ideal(self.stiffness, 1.0 if rising else -1.0)
        return float(self.stiffness - softened * loading)

    def integer_stiffness(self, elongation: float, force: float, rising: bool) -> float:
        """Return K of Eq. 26 in N/m, the integer-order law of the paper; arguments as in `operator_stiffness`."""
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


class CrushingStop(TwoPoints):
    """A stop behind a gap that yields under force and keeps its dent.

    With the approach s (as of `Contact`: ``u_a - u_b``, ``-eta`` for a stop
    below, ``eta`` above) it pushes back where s exceeds the gap: along the
    backbone of `HystereticSpring` when it is first crushed, elastically at
    `stiffness` when it unloads and is hit again, and it never pulls.

    Parameters
    ----------
    a, b : points
        With b, a is the lower one. Without: a stop fixed in space.
    gap : float
        In m.
    side : {"below", "above"}
        For a stop fixed in space.
    stiffness, linear_limit, softening, of
        As of `HystereticSpring`.
    name : str, optional

    Raises
    ------
    ArgumentError
        For arguments out of range.
    """

    def __init__(
        self,
        a: Point,
        b: Point | None = None,
        *,
        gap: float,
        stiffness: float,
        linear_limit: float,
        softening: Softening | None = None,
        side: str | None = None,
        of: str = "displacement",
        name: str | None = None,
    ) -> None:
        self.name = automatic_name(name, "CrushingStop")
        label = f"CrushingStop {self.name!r}"
        self._attach(label, a, b, of)
        distinct(label, self.a, self.b)
        self.side = side_of(label, "a stop", self.b, side)
        self.gap = number(f"{label}: gap", gap)
        self.stiffness = number(f"{label}: stiffness", stiffness, positive=True)
        self.linear_limit = number(f"{label}: linear_limit", linear_limit, positive=True)
        backbone = Backbone(label, self.stiffness, self.linear_limit, softening)
        self.softening: Softening = backbone.softening
        self._law = backbone.law(self.name, one_sided=True, gap=self.gap, unit=self.units.force)

    @property
    def limit_load(self) -> float:
        """The force in N that the stop never reaches; inf where there is none."""
        return self._law.limit

    def compile(self, builder: SystemBuilder) -> None:
        """Add row and law."""
        builder.add_law(self._row(builder, -1.0 if self.side == "below" else 1.0), self._law)

    def describe(self) -> str:
        """Return name, place and numbers."""
        where = (
            f"{self.side} {self.a.describe()}"
            if self.b is None
            else f"of {self.a.describe()} below {self.b.describe()}"
        )
        units, rotation = self.units, " in rotation" if self.of == "rotation" else ""
        return (
            f"CrushingStop {self.name!r} {where}{rotation}: gap {self.gap:g} {units.coordinate}, {self.stiffness:g} "
            f"{units.stiffness}, linear to {self.linear_limit:g} {units.coordinate}, limit load {self.limit_load:g} "
            f"{units.force}"
        )
