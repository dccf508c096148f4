# mypy: disable-error-code="no-any-return"
"""Contacts: both force laws, with the ideal and the resolved switch.

A contact is closed exactly while ``s = u - gap > 0`` (Eq. 8 of the paper).
The force of a closed contact is ``K (u - offset) + C0 u'``, with K = K0 under
the ideal switch. The offset is 0 under the displacement law, whose force acts on
the whole displacement (Eqs. 9b, 13, 18c). It is the gap under the penetration law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array
from vofem.kernels.jit import jit
from vofem.laws.group import LawGroup
from vofem.laws.law import CLOSED, DAMPING, FORCE, JUMP, KINK, MEAN, OPEN, PINNED, STORED, TANGENT, Law
from vofem.laws.moving import Moving, gathered
from vofem.laws.resolved import resolved_contact, steepest, switch

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

Status = NDArray[np.int64]

#: Distance in m at which a contact stands open that is not on its beam.
_AWAY = 1.0

#: Width, as a fraction of the gap, over which compiled loops spread the jump of the displacement law.
_RAMP = 1e-12


@dataclass(frozen=True)
class ContactLaws(LawGroup):
    """Contacts, one per row.

    While closed, the force ``R`` acts on the structure as ``-b R``:

    - ``R = K0 (b.q) + C0 (b.q')`` where `jump` is true (Eqs. 9b, 13, 18c), and
    - ``R = K0 (b.q - gap) + C0 (b.q')`` elsewhere.
    """

    kind: ClassVar[str] = "contacts"
    named: ClassVar[str] = "contacts"
    place: ClassVar[int] = 0

    names: tuple[str, ...]
    rows: csr_matrix  #: Shape (n_contacts, n).
    #: `gap`, `stiffness`, `damping`: gap, m, stiffness K0, N/m, and coefficient of the damper, N s/m, shape
    #: (n_contacts,).
    gap: Array
    stiffness: Array
    damping: Array
    jump: NDArray[np.bool_]  #: Whether the force acts on the whole displacement, shape (n_contacts,).
    resolution: Array  #: s0 in 1/m of the resolved switch; inf for the ideal one. Shape (n_contacts,).
    #: Coefficient of restitution of rigid stops, whose stiffness is 0 here; NaN for elastic contacts. Shape
    #: (n_contacts,).
    restitution: Array
    #: What is added to the coordinates ``b.q`` because stops and bases move; None where they do not.
    moving: Moving | None = None
    #: Numbers of sliders that are followed as contacts; empty without them.
    sliders: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def gather(cls, rows: csr_matrix, laws: tuple[Any, ...]) -> ContactLaws:
        """Return the group of some contacts, whose attributes are named as those of the group."""
        numbers = {
            name: np.array([getattr(law, name) for law in laws])
            for name in ("gap", "stiffness", "damping", "jump", "resolution", "restitution")
        }
        return cls(tuple(law.name for law in laws), rows, **numbers, moving=gathered(laws))

    @property
    def labels(self) -> tuple[str, ...]:
        """Names with the class of their effect before them."""
        kinds = np.where(self.rigid, "RigidStop", "Contact")
        return tuple(f"{kind} {name!r}" for kind, name in zip(kinds, self.names, strict=True))

    @cached_property
    def rigid(self) -> NDArray[np.bool_]:
        """Which are rigid stops, shape (n_contacts,)."""
        return ~np.isnan(self.restitution)

    @property
    def jumps(self) -> NDArray[np.bool_]:
        """Whose forces jump at their gaps, shape (n_contacts,)."""
        return self.jump & (self.gap != 0.0)

    # -- coordinates ----------------------------------------------------------------------------------

    def gap_function(self, samples: Any, index: int, times: Array) -> Array:
        """Return the gap function of one contact in m at the times of samples, which offer ``along(rows, "q")``."""
        u = samples.along(self.rows[[index]], "q")[0]
        return np.asarray(u + self._more(samples, times, 0)[index] - self.gap[index])

    def gaps(self, index: int, times: Array) -> Array:
        """Return the gap of one contact at times in the frame of its bodies, in which stops in space move."""
        rest = np.full(times.shape, self.gap[index])
        return rest if self.moving is None else rest - self.moving.at(times)[index]

    def gap_rate(self, samples: Any, index: int, times: Array) -> Array:
        """Return the rate of the gap function of one contact in m/s at the times of samples."""
        rate = samples.along(self.rows[[index]], "v")[0]
        return np.asarray(rate + self._more(samples, times, 1)[index])

    def _more(self, samples: Any, times: Array, rate: int) -> Array:
        """Return what coordinates, or their rates, have beside the rows at rest, (n_contacts, n_times) or (n, 1)."""
        if self.moving is None:
            return np.zeros((len(self), 1))
        if not self.moving.riders:
            return self.moving.rate(times) if rate else self.moving.at(times)
        if rate:
            return self.moving.added_rates(samples.q, samples.v, times)
        return self.moving.added(samples.q, times)

    def shifted(self, start: float) -> ContactLaws:
        """Return the contacts for a run that begins at a time in s."""
        return self if self.moving is None else replace(self, moving=self.moving.shifted(start))

    def _in_space(self, chosen: Sequence[int] | None = None) -> str:
        assert self.moving is not None
        moved = np.any(self.moving.weights, axis=1)
        return next(self.labels[j] for j in (range(moved.size) if chosen is None else chosen) if moved[j])

    @property
    def away(self) -> Array:
        """Coordinates at which the contacts are open."""
        return np.minimum(self.gap, 0.0) - _AWAY

    @property
    def offset(self) -> Array:
        """The coordinate at which the spring force is zero: 0 under the displacement law, else the gap."""
        return np.where(self.jump, 0.0, self.gap)

    @property
    def ideal(self) -> bool:
        """Whether all switches are ideal."""
        return bool(np.all(np.isinf(self.resolution)))

    # -- what contacts need of a method ---------------------------------------------------------------

    def _resolved(self) -> str:
        return self.labels[int(np.argmax(np.isfinite(self.resolution)))]

    def rigid_refusal(self, what: str) -> str | None:
        """Return why something that needs finite forces cannot treat the contacts: only where stops are rigid."""
        if not self.rigid.any():
            return None
        return (
            f"{what} needs stops that yield, and {self.labels[int(np.argmax(self.rigid))]} is rigid: velocities jump. "
            "Only simulate(method='event_driven') and orbits by shooting take it; use a Contact with a large stiffness "
            "here, with a damper for the restitution"
        )

    def nonlinearity(self, method: str) -> str | None:
        """Return why the force is not piecewise linear: under a resolved switch, or of jumps beside moving stops."""
        if self.travelling is not None:
            return (
                f"{self.travelling} travels along a beam, so that the equations of motion depend on time while it is "
                f"closed; {method} does not treat it"
            )
        if self.moving is not None and np.any(self.jump | self.rigid):
            j = int(np.argmax(self.jump | self.rigid))
            why, cure = "acts on the displacement", f"give {self.labels[j]} acts_on='penetration'"
            if self.rigid[j]:
                why, cure = "is rigid", f"replace {self.labels[j]} by a stiff Contact with acts_on='penetration'"
            return (
                f"{self._in_space()} sees the displacement of a base, and {self.labels[j]} {why}, so that it may rest "
                f"at its gap; {method} does not treat both in one scene: {cure}"
            )
        if self.ideal:
            return None
        return (
            f"{self._resolved()} has a resolved switch, whose force is not piecewise linear; {method} needs "
            "switch='ideal'"
        )

    def harmonic_refusal(self) -> str | None:
        """Return why harmonic balance cannot treat the contacts: where bases move them, or stops are rigid."""
        return self.moving_refusal("harmonic balance") or self.rigid_refusal("harmonic balance")

    def moving_refusal(self, what: str, chosen: Sequence[int] | None = None) -> str | None:
        """Return why something takes no contacts that bases move, and what to do instead; None where none is moved.

        `chosen`: numbers of the contacts that matter; all of them where not given.
        """
        if self.moving is None or (chosen is not None and not np.any(self.moving.weights[list(chosen)])):
            return None
        if self.travelling is not None:
            return (
                f"{self.travelling} travels along a beam, which {what} cannot take into account; simulate the scene, "
                "or put the contact at a place of interest, beam.at(x)"
            )
        return (
            f"{self._in_space(chosen)} sees the displacement of a base, which {what} cannot take into account; "
            "simulate the scene, until it has settled where a steady state is wanted, or let stops stand on the base"
        )

    def statics_refusal(self, path: bool) -> str | None:
        """Return why statics cannot treat the contacts: a resolved switch, a rigid stop, or a base that moves."""
        if self.travelling is not None:
            return self.moving_refusal("quasi_static" if path else "equilibrium")
        if self.moving is not None:
            return (
                f"{'quasi_static' if path else 'equilibrium'} knows no time, and {self._in_space()} sees the "
                "displacement of a base that moves; leave the BaseMotion out, or let the stop stand on the base"
            )
        if self.ideal:
            return self.rigid_refusal("quasi_static" if path else "equilibrium")
        return (
            f"{'quasi_static' if path else 'equilibrium'} needs ideal switches; {self._resolved()} has a resolved one"
        )

    # -- the laws on arrays: u and s of shape (n_contacts,) or (n_contacts, n_times) ------------------

    def column(self, values: Array, like: Array) -> Array:
        """Return numbers of the contacts, one for each, in a shape that broadcasts with that of `like`."""
        return values.reshape(values.shape + (1,) * (like.ndim - 1))

    def elastic(self, u: Array) -> Array:
        """Return the spring forces in N at coordinates u if all contacts were closed."""
        return np.asarray(self.column(self.stiffness, u) * (u - self.column(self.offset, u)))

    def force(self, s: Array, rate: Array, status: Status) -> Array:
        """Return the contact forces under the ideal switch.

        They are computed from the gap functions, so that small penetrations are accurate. The force of a pinned contact
        follows from the structure and is returned as zero here.
        """
        elastic = self.column(self.stiffness, s) * (s + self.column(self.gap - self.offset, s))
        return np.where(status == CLOSED, elastic + self.column(self.damping, s) * rate, 0.0)

    def closed_potential(self, s: Array, status: Status) -> Array:
        """Return the energy of closed contacts with an ideal switch, J, summed over contacts."""
        return np.asarray(np.sum(np.where(status == CLOSED, self.closed_energies(s), 0.0), axis=0))

    def closed_energies(self, s: Array) -> Array:
        """Return the energy in J that every contact would store if it were closed, for an ideal switch.

        It is ``K0 (u^2 - gap^2)/2`` under the displacement law and ``K0 s^2/2`` under the penetration law. The
        shape is that of s.
        """
        return 0.5 * self.column(self.stiffness, s) * s * (s + 2.0 * self.column(self.gap - self.offset, s))

    def shares(self, s: Array) -> Array:
        """Return ``K_eq/K0`` at gap functions s, from 0 (open) to 1 (closed) (Eqs. 8, 12a, 17)."""
        share = np.where(s > 0.0, 1.0, 0.0)
        for j in np.flatnonzero(np.isfinite(self.resolution)):
            share[j] = np.reshape([switch(self.resolution[j] * x) for x in np.ravel(s[j])], np.shape(s[j]))
        return share

    def scaled(self, factor: float) -> ContactLaws:
        """Return contacts with springs and dampers times a factor."""
        return replace(self, stiffness=factor * self.stiffness, damping=factor * self.damping)

    def respond(self, u: Array, width: float) -> tuple[Array, Array, Status]:
        """Return reaction, tangent and status of ideal switches; jumps are spread over `width` times the gap."""
        s, ramp = u - self.gap, np.where(self.jump, width * self.gap, 0.0)
        beyond = s > ramp
        within = (s > 0.0) & ~beyond
        steep = self.stiffness * (self.gap + ramp) / np.where(ramp > 0.0, ramp, 1.0)
        reaction = np.where(beyond, self.elastic(u), np.where(within, steep * s, 0.0))
        tangent = np.where(beyond, self.stiffness, np.where(within, steep, 0.0))
        return reaction, tangent, np.where(beyond, CLOSED, np.where(within, PINNED, OPEN)).astype(np.int64)

    def numbers(self) -> Array:
        """Return all numbers that define the laws."""
        elastic = np.append(super().numbers(), self.sliders)
        return np.append(elastic, np.nan_to_num(self.restitution, nan=-1.0)) if self.rigid.any() else elastic

    @cached_property
    def forms(self) -> tuple[Law, ...]:
        """The contacts one by one, as all methods but event_driven see them."""
        return tuple(self._form(*numbers) for numbers in zip(
            self.labels, self.names, self.gap, self.offset, self.stiffness, self.damping, self.jump, self.resolution,
            strict=True,
        ))  # fmt: skip

    def _form(self, label: str, name: str, gap: float, offset: float, k: float, c: float, jump: bool, s0: float) -> Law:
        ideal = bool(np.isinf(s0))
        last = (_RAMP * gap if jump else 0.0) if ideal else s0
        return Law(
            label, name, contact if ideal else resolved_contact, np.array([gap, offset, k, c, last]),
            stiffness=float(k * steepest(gap, bool(jump), s0)), damped=bool(c > 0.0),
            rising=not (ideal and jump and gap > 0.0),
        )  # fmt: skip


def initial_status(laws: ContactLaws, q: Array, v: Array, size: Array | None = None) -> Status:
    """Return the status at t = 0: closed if ``s > 0``, or if ``s = 0`` and the contact is closing.

    `q`, `v` (shape (n,)): displacements and velocities at t = 0.
    `size` (shape (n_contacts,)): sums of the magnitudes of the terms of ``rows @ q``, where they are known.
    """
    u, rate = laws.coordinates(q[:, None], np.zeros(1))[:, 0], laws.rates(q[:, None], v[:, None], np.zeros(1))[:, 0]
    # An s below the rounding of the terms that u sums is zero.
    if size is None:
        size = np.asarray(abs(laws.rows) @ np.abs(q))
    s = u - laws.gap
    zero = np.abs(s) <= 4.0 * np.finfo(float).eps * (size + np.abs(laws.gap))
    return np.where((~zero & (s > 0)) | (zero & (rate > 0)), CLOSED, OPEN).astype(np.int64)


# -- the law of one contact with an ideal switch -------------------------------------------------------


@jit
def contact(what: int, p: Any, z: Any, u0: float, u1: float) -> float:
    """Answer for a contact of p = (gap, offset, K0, C0, width of the jump); see `law`."""
    gap, offset, k, ramp = p[0], p[1], p[2], p[4]
    s = u1 - gap
    if what == KINK:
        return gap if u1 == 0.0 else np.nan
    if what == JUMP:
        return k * (gap - offset)
    s0 = u0 - gap
    if what in (MEAN, DAMPING) and s0 != s:
        if s0 <= 0.0 and s <= 0.0:
            return 0.0
        if what == DAMPING:
            return p[3] * ((max(s, 0.0) - max(s0, 0.0)) / (s - s0))
        if s0 >= ramp and s >= ramp:
            return k * (0.5 * (s0 + s) + (gap - offset))
        path = s - s0
        return k * (_height_over(path, s, ramp, gap - offset) - _height_over(path, s0, ramp, gap - offset))
    if s <= 0.0:
        return 0.0
    if what == DAMPING:
        return p[3]
    if what == STORED:
        stored = 0.5 * k * s * (s + 2.0 * (gap - offset))
        # A part of the potential of a jump is missing because the force rises over a small width.
        within = min(s, ramp)
        return stored - k * gap * within * (1.0 - 0.5 * within / ramp) if ramp > 0.0 else stored
    if what in (FORCE, MEAN):
        return k * (u1 - offset) if s >= ramp else k * ((gap + ramp) / ramp) * s
    if what == TANGENT:
        return k if s >= ramp else k * ((gap + ramp) / ramp)
    return 0.0


@jit
def _height_over(path: float, s: float, ramp: float, lever: float) -> float:
    """Return the potential of an ideal switch over its stiffness and a length, m; squares of tiny s would vanish."""
    if s <= 0.0:
        return 0.0
    if s < ramp:
        return (s / path) * (0.5 * s * ((lever + ramp) / ramp))
    return (s / path) * (0.5 * s + lever) - 0.5 * lever * (ramp / path)
