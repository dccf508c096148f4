"""The base of all groups of scalar laws: what methods that are not loops ask of the laws of one kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from vofem.arrays import Array, Complex
from vofem.laws.law import FORCE, STORED, Law, LawSet
from vofem.laws.moving import Moving

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


class StepPast(Protocol):
    """The past of laws whose force over a step is affine in the coordinate at its end, but depends on earlier steps."""

    #: `row`, `count`: number of the first law among all laws, and of these laws.
    row: int
    count: int
    terms: int  #: Number of internal variables of all laws.
    y: Array  #: The internal variables; changed in place.

    def begin(self, start: Any, dt: float | None) -> Array:
        """Set the internal variables to those at t = 0 of a run from a `State`; return the forces there, N, (count,).

        Explicit methods give their step in s: for them it is the mean force over the first step.
        """

    def most_steps(self, count: int) -> int:
        """Return the number of steps, at most the given one, for which `over` is called at once."""

    def over(self, dt: float, times: Array) -> Any:
        """Return the data for compiled loops over steps of one size in s, given a time within each."""


class LawGroup:
    """Scalar laws of one kind, one for each row b.

    The coordinate of a law is ``u = b.q``. Its reaction R acts on the structure
    as the force ``-b R``. A group gives its laws as functions (`forms`), from which
    all numbers are derived. Its refusals say which methods cannot treat it, and why.

    `names`, `labels`: names of the laws, and names with the class of the effect in front for messages.
    """

    kind: ClassVar[str] = "laws"  #: Name of the kind of law, for readers.

    #: Position of the group among those of a system; contacts come first.
    place: ClassVar[int] = 1

    rows: csr_matrix  #: Over the free degrees of freedom, shape (n_laws, n).

    #: What moves the coordinates beside the structure; None where nothing does.
    moving: Moving | None = None

    @classmethod
    def gather(cls, rows: csr_matrix, laws: tuple[Any, ...]) -> LawGroup:
        """Return the group of some laws with their rows over the free degrees of freedom."""
        return cls(rows, laws)  # type: ignore[call-arg]

    if TYPE_CHECKING:

        @property
        def names(self) -> tuple[str, ...]:
            """Names of the laws."""

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the laws with the class of their effect, for messages."""
        raise NotImplementedError

    def __getstate__(self) -> dict[str, Any]:
        # What is derived is derived again in another process.
        return {name: value for name, value in vars(self).items() if name not in ("forms", "alone")}

    def __len__(self) -> int:
        return int(self.rows.shape[0])

    def place_of(self, law: Any) -> int | None:
        """Return the position of a law in the group, None where the group does not hold it as an object."""
        return None

    # -- coordinates ----------------------------------------------------------------------------------

    def coordinates(self, q: Array, times: Array) -> Array:
        """Return the coordinates u at times, shape (n_laws, n_times), for displacements q of shape (n, n_times).

        They are NaN for a law at a point that travels and is not on its beam.
        """
        u = np.asarray(self.rows @ q)
        return u if self.moving is None else u + self.moving.added(q, times)

    def rates(self, q: Array, v: Array, times: Array) -> Array:
        """Return the rates of the coordinates at times, shape (n_laws, n_times), for a motion q, v of (n, n_times)."""
        rate = np.asarray(self.rows @ v)
        return rate if self.moving is None else rate + self.moving.added_rates(q, v, times)

    @property
    def away(self) -> Array:
        """Coordinates at which the laws exert no force, shape (n_laws,)."""
        return np.zeros(len(self))

    @property
    def tied(self) -> NDArray[np.bool_]:
        """Whether a law holds its coordinate at zero, whatever force that takes, shape (n_laws,)."""
        return np.zeros(len(self), dtype=bool)

    @property
    def travelling(self) -> str | None:
        """The label of the first law whose place travels along a beam, or None."""
        if self.moving is None or not self.moving.riders:
            return None
        return self.labels[min(self.moving.riders)]

    # -- what the group needs of a method -----------------------------------------------------------

    @property
    def driven(self) -> Any:
        """The one law of the group if the applied load drives it, so that no method for general scenes takes it."""
        return None

    def nonlinearity(self, method: str) -> str | None:
        """Return why methods for piecewise linear forces cannot treat the group, or None if they can."""
        raise NotImplementedError

    def statics_refusal(self, path: bool) -> str | None:
        """Return why statics cannot treat the group, alone or along a load path, or None if it can."""
        return None

    def modes_refusal(self) -> str | None:
        """Return why the group has no natural modes, and what to do instead, or None if it has."""
        return None

    def harmonic_refusal(self) -> str | None:
        """Return why harmonic balance cannot treat the group, and what to do instead, or None if it can."""
        return None

    # -- the laws as functions ------------------------------------------------------------------------

    #: What laws are called whose names must differ, because histories are found by them; empty where none are found.
    named: ClassVar[str] = ""

    #: Whether force, stored energy and loss of every law are recorded along a run.
    recorded: ClassVar[bool] = False

    #: Whether the laws are recorded sliders, which have histories of their own.
    slides: ClassVar[bool] = False

    #: Whether the laws take part in statics; laws that yield to every lasting force do not.
    static: ClassVar[bool] = True

    @property
    def forms(self) -> tuple[Law, ...]:
        """The laws as functions with numbers, one for each row."""
        raise NotImplementedError

    @cached_property
    def alone(self) -> LawSet:
        """The laws of the group, with the internal variables that they have before any load."""
        return LawSet([self])

    @property
    def bounded(self) -> bool:
        """Whether `steepest` bounds the tangents wherever the coordinates go."""
        return all(law.stiffness is not None for law in self.forms)

    def steepest(self, u: Array) -> Array:
        """Return bounds of the tangents in N/m; where a law has none, its tangent at its coordinate u."""
        laws = self.alone
        return np.array([
            float(laws.tangent(j, u[[j]])[0]) if law.stiffness is None else law.stiffness
            for j, law in enumerate(self.forms)
        ])  # fmt: skip

    def limits(self) -> Array:
        """Return the limit loads in N, which the forces never exceed; inf where there is none."""
        return np.array([law.limit for law in self.forms])

    def units(self) -> tuple[str, ...]:
        """Return the units of the forces, for messages."""
        return tuple(law.unit for law in self.forms)

    def virgin(self) -> list[Array]:
        """Return the internal variables of every law before any load; the first is the dissipated energy in J."""
        return [law.virgin() for law in self.forms] if self.recorded else [np.zeros(0)] * len(self)

    def potential(self, u: Array) -> Array:
        """Return the energy in J that follows from u alone, shape (n_times,), for u of shape (n_laws, n_times).

        Energy that depends on internal variables is recorded along the run.
        """
        if self.recorded:
            return np.zeros(u.shape[1])
        return np.asarray(np.sum(self.alone.everywhere(STORED, u), axis=0))

    def reactions(self, u: Array) -> Array:
        """Return the forces in N that follow from u alone, shape (n_laws, n_times), for u of the same shape."""
        return self.alone.everywhere(FORCE, u)

    def numbers(self) -> Array:
        """Return all numbers that define the laws, by which two groups are compared; Python functions have none."""
        laws = () if self.linear else self.forms
        return np.concatenate([np.zeros(0), *(np.append(law.parameters, law.past) for law in laws)])

    #: Whether another run can start with the past that the laws have at the end of a run.
    past_is_kept: ClassVar[bool] = True

    def past_in_steps(self, row: int, shortest: float, t_end: float) -> StepPast | None:
        """Return the internal variables that the laws have in a run in time steps beside those of `virgin`, or None.

        `row`: number of the first law of the group among all laws.
        `shortest`, `t_end`: shortest step, and the longest time that will be reached, in s.
        """
        return None

    def shifted(self, start: float) -> LawGroup:
        """Return the laws for a run that begins at a time in s; they differ only if they vary in time."""
        return self

    def scaled(self, factor: float) -> LawGroup | None:
        """Return the laws with all forces and energies multiplied by a factor, or None if this is not possible."""
        return None

    # -- the law in harmonic motions ------------------------------------------------------------------

    #: Whether forces are linear in a motion that has lasted for ever, so that `harmonic_stiffness` gives them.
    linear: ClassVar[bool] = False

    def harmonic_stiffness(self, omega: float) -> Complex:
        """Return the complex stiffnesses in N/m of linear laws at an angular frequency in rad/s, shape (n_laws,)."""
        raise NotImplementedError

    def stored_by_pairs(self, p: Complex) -> Complex:
        """Return the energy that linear laws store in a sum of motions ``a_k exp(p_k t)``, shape (n_laws, k, k).

        The entries, in N/m, are the factors of ``a_k a_l exp((p_k + p_l) t)/2``.
        """
        raise NotImplementedError


@dataclass(frozen=True)
class ListedLaws(LawGroup):
    """A group that holds its laws as objects with a `name` and a `label`, one per row."""

    rows: csr_matrix  #: Shape (n_laws, n).
    laws: tuple[Any, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the laws."""
        return tuple(law.name for law in self.laws)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names with the class of their effects."""
        return tuple(law.label for law in self.laws)

    def place_of(self, law: Any) -> int | None:
        """Return the position of a law."""
        return next((k for k, one in enumerate(self.laws) if one is law), None)


def past_of(groups: Sequence[LawGroup], states: Array, name: str) -> Array | None:
    """Return the internal variables of the law of that name from the flat array of all laws, or None."""
    start = 0
    for group in groups:
        for mine, virgin in zip(group.names, group.virgin(), strict=True):
            if virgin.size and mine == name:
                return states[start : start + virgin.size].copy()
            start += virgin.size
    return None


def gathered_past(groups: Sequence[LawGroup], known: Callable[[str], Array | None]) -> Array | None:
    """Return the internal variables of all laws, taken by name from an earlier run, or None if there are none."""
    states, found = [np.zeros(0)], False
    for group in groups:
        for name, virgin in zip(group.names, group.virgin(), strict=True):
            past = known(name) if virgin.size else None
            if past is not None and past.shape == virgin.shape:
                states.append(past)
                found = True
            else:
                states.append(virgin)
    return np.concatenate(states) if found else None
