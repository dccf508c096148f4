"""Hysteretic springs with the backbone of Eq. 24: the law that the paper prints, and one for cyclic loads."""

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

    Parameters
    ----------
    a, b : points
        ``beam.at(x)`` or a `Mass`. Without b it acts between a and the ground.
    stiffness : float
        K in N/m, positive.
    linear_limit : float
        Largest elongation d0 up to which the spring is linear, in m, positive.
    softening : LinearSoftening or callable, optional
        The share by which the secant stiffness has fallen, as a function of the
        magnitude of the force in N. It is 0 at ``K d0`` and does not decrease.
        It reaches 1 at the limit load. The default is Eq. 24,
        ``(|F| - K d0)/(4 N)``. A callable is tabulated once, up to 1e4 linear
        limits, with an error of 1e-11.
    memory : "printed" or "cyclic"
        The memory of the spring for earlier loading, see above. There is no default.
    of : {"displacement", "rotation"}
        Whether it acts on displacements (m, N) or on rotations of beams (rad, N m).
    name : str, optional
        Unique in a scene.

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


class CrushingStop(TwoPoints):
    """A stop behind a gap that yields under force and keeps its residual deformation.

    The approach s is ``u_a - u_b`` between two points, ``-eta`` for a stop below,
    and ``eta`` for a stop above. The stop pushes back when s exceeds the gap.
    While it is crushed further than before, its force follows the backbone of
    `HystereticSpring`. When it unloads and is hit again, it is elastic with
    `stiffness`. It never pulls.

    Parameters
    ----------
    a, b : points
        ``beam.at(x)`` or a `Mass`. With b, a is the lower point. Without b the stop is fixed in space.
    gap : float
        Gap before the stop is touched, in m.
    side : "below" or "above"
        The side on which a stop that is fixed in space stands.
    stiffness, linear_limit, softening, of
        The same as for `HystereticSpring`.
    name : str, optional
        Unique in a scene.

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
        """The limit load in N, which the stop approaches and never reaches; inf where there is none."""
        return self._law.limit

    def compile(self, builder: SystemBuilder) -> None:
        """Add row and law."""
        builder.add_law(self._row(builder, -1.0 if self.side == "below" else 1.0), self._law)

    def describe(self) -> str:
        """Return name, place and numbers."""
        units = self.units
        return (
            f"CrushingStop {self.name!r} {self._stop(self.side, self.gap)}, {self.stiffness:g} {units.stiffness}, "
            f"linear to {self.linear_limit:g} {units.coordinate}, limit load {self.limit_load:g} {units.force}"
        )
