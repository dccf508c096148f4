"""Periodic orbits by harmonic balance in the coordinates of the laws.

A periodic motion is a Fourier series. The linear part of a structure responds to each harmonic separately. The only
unknowns are therefore the harmonics of the coordinates ``u = B q`` on which laws act, however many degrees of freedom
there are:

    u_k + G_k R_k(u) = B A_k^-1 F_k,    G_k = B A_k^-1 B',    A_k = K + i k omega C - (k omega)^2 M

with R_k the harmonics of the laws' forces along u. Springpots are part of A_k,
exactly, by ``(i k omega)^alpha``.

The harmonics of a force with kinks fall like k^-2, and those of a force with jumps fall like k^-1. The harmonics of the
displacement fall by k^-2 faster. The error of displacements therefore falls like H^-3 with the number H of harmonics
under a penetration law or a spring that slips, and like H^-2 under the displacement law. It is estimated from the
harmonics of the force beyond H, which are known.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from vofem._validate import whole
from vofem.arrays import Array, Complex
from vofem.errors import ArgumentError, ConvergenceError, MethodError, SingularSystemError
from vofem.integrators.event_driven.flow import share_modes
from vofem.integrators.methods import ENERGY_CONSERVING
from vofem.laws.rows import all_rows
from vofem.linalg.eigen import eigenvalues
from vofem.result import Result
from vofem.scene import Scene
from vofem.simulate.simulation import simulate
from vofem.studies.steady.condensed import slowest_decay
from vofem.studies.steady.harmonic.law_path import LawPaths, nonlinear_groups
from vofem.studies.steady.harmonic.linear_rest import FULL, Attached, LinearRest, linear_laws
from vofem.studies.steady.harmonic.solution import HarmonicMotion, harmonic_result
from vofem.studies.steady.harmonic.trigonometric import basis, to_complex, to_real
from vofem.studies.steady.harmonic.variation import monodromy
from vofem.studies.steady.loads import load_series
from vofem.studies.steady.newton import ROUNDING, Evaluation, direction
from vofem.studies.steady.orbit import DECIDED, OrbitSource, OrbitTruncation, PeriodicOrbit
from vofem.studies.steady.problem import OrbitProblem, Work
from vofem.studies.steady.segments.near import orbit_near
from vofem.studies.steady.segments.shooting import Shooting
from vofem.studies.steady.segments.signature import SignatureEvaluation
from vofem.system import State, System, refuse_travelling

#: Default number of harmonics for each period of the loads.
HARMONICS = 25

#: Number of harmonics of the force that are computed beyond those of the unknowns, as a multiple of them.
_BEYOND = 2

#: Margin of frequencies within which Ritz vectors are used again in other problems of a branch.
_MARGIN = 1.3

#: Periods of a transient, and its steps in a period, which are simulated if harmonic balance needs a better start.
_TRANSIENT, _STEPS = 60, 200

#: Steps of shooting to the exact orbit, and its largest distance: a multiple of the error by the harmonics left out.
_NEWTON, _FAR = 3, 10.0

#: Factor from the change of the largest multiplier, by the harmonics beyond those of the unknowns, to a bound.
_SAFETY = 6.0


@dataclass(frozen=True)
class HarmonicEvaluation(Evaluation):
    """The equations at some harmonics, and the motion that these harmonics stand for."""

    problem: HarmonicBalance = field(repr=False)
    u: Array  #: Harmonics of the laws' coordinates, m, shape (n_laws, 2H + 1).
    residual: Array  #: Shape (n,).
    remarks: list[str]  #: On internal variables of laws.
    jacobian: Array = field(repr=False)  #: Empty without derivatives, shape (n, n).

    @property
    def size(self) -> float:
        """Size of the motion, m."""
        return float(np.linalg.norm(self.u))

    @property
    def scales(self) -> Array:
        """Sizes of the unknowns, shape (n,)."""
        return np.full(self.residual.size, self.size if self.size > 0.0 else 1.0)

    @property
    def error(self) -> float:
        """Size of the residual, divided by that of the motion."""
        size = float(np.linalg.norm(self.residual))
        if not np.isfinite(size):
            return np.inf
        return size / self.size if self.size > 0.0 else float(size > 0.0)

    @cached_property
    def truncation(self) -> OrbitTruncation:
        """What the harmonics that are left out would change, to first order, themselves among it.

        The force has them. With them the laws answer otherwise, which changes the harmonics that are kept: much more
        where a law is stiff.
        """
        problem, h, reach = self.problem, self.problem.harmonics, self.problem.reach
        whole = problem.free - np.einsum("kij,jk->ik", problem.compliance, self._forces)
        beyond = np.abs(whole[:, h + 1 :]).sum(axis=1)
        whole[:, : h + 1] = to_complex(self.u.T).T
        forces = problem.forces(to_real(whole.T).T, h)[0]
        known = self.jacobian
        jacobian = known if known.size else problem.jacobian(problem.forces(self.u, h, derivative=True)[1])
        moved = direction(jacobian, -problem.balanced(self.u, forces)).reshape(self.u.shape)
        left = beyond + np.abs(to_complex(moved.T)).sum(axis=0)
        size = np.abs(to_complex(self.u.T)).sum(axis=0)
        error = float(np.max(left / np.where(size > 0.0, size, 1.0), initial=0.0))
        what = f"{h} harmonics; those up to {reach} would change displacements by up to {error:.1e} of themselves"
        return OrbitTruncation(reach - h, error, what, error)

    @cached_property
    def motion(self) -> HarmonicMotion:
        """The motion of the whole structure under the laws' forces, with all their known harmonics."""
        return self.problem.motion(self._forces)

    @cached_property
    def exact(self) -> SignatureEvaluation | None:
        """The exact orbit by shooting, if there is one within the error of the harmonics."""
        problem, motion = self.problem.shooting, self.motion
        if problem is None:
            return None
        q, v = (motion.rest.vectors @ motion.modal(np.zeros(1), order)[:, 0] for order in range(2))
        guess, n = problem.from_state(State(q, v)), problem.size // 2
        try:
            found = orbit_near(problem, guess, _NEWTON)
        except ConvergenceError:
            return None
        away, known = float(np.linalg.norm(found.unknowns[:n] - guess[:n])), found.evaluation
        assert isinstance(known, SignatureEvaluation)
        return known if away <= (_FAR * self.truncation.error + ROUNDING) * known.sizes[0] else None

    @cached_property
    def multipliers(self) -> Complex | None:
        """Floquet multipliers, those of the exact orbit where shooting takes the scene; None where they are unknown."""
        if self.problem.shooting is not None:
            return None if self.exact is None else self.exact.multipliers
        return None if self.problem.undecided is not None else self.problem.multipliers(self.motion)

    @property
    def uncertainty(self) -> float:
        """Error of the largest modulus of the multipliers; that by the harmonics left out is a bound."""
        if self.exact is not None:
            return float(self.exact.uncertainty)
        assert self.multipliers is not None
        first = self.motion.coefficients[:, : self.problem.harmonics + 1]
        few = self.problem.multipliers(replace(self.motion, coefficients=first))
        return max(DECIDED, _SAFETY * abs(float(np.abs(self.multipliers).max() - np.abs(few).max())))

    @cached_property
    def _forces(self) -> Complex:
        return self.problem.forces(self.u, self.problem.reach)[0]


class HarmonicBalance(OrbitProblem):
    """Periodic orbits of a scene as solutions of the balance of harmonics.

    `harmonics`: number of harmonics of the orbit beyond the mean. The default is 25 for each period of the loads.
    `earlier`: a problem at another value of a parameter.
    `size`: number of unknowns: laws times 2 H + 1.
    """

    def __init__(
        self,
        what: str,
        scene: Scene,
        periods: int = 1,
        *,
        period: float | None = None,
        harmonics: int | None = None,
        earlier: HarmonicBalance | None = None,
        work: Work | None = None,
    ) -> None:
        self.system = system = treated(what, scene.model.system)
        self.groups = nonlinear_groups(system)
        if harmonics is None:
            harmonics = HARMONICS * periods if earlier is None else earlier.harmonics
        self.harmonics: int = whole(f"{what}: harmonics", harmonics)
        super().__init__(what, scene, system, periods, period, work)
        self.reach = (1 + _BEYOND) * self.harmonics
        self.omega = self.loads.omega / periods
        self.laws = LawPaths(self.groups)
        self.size = self.laws.size * (2 * self.harmonics + 1)
        self._series = load_series(what, system, self.omega, self.reach)
        if earlier is not None and earlier.size != self.size:
            raise MethodError(
                f"{what}: the scene has {self.laws.size} laws and {self.harmonics} harmonics, and {earlier.laws.size} "
                f"and {earlier.harmonics} at another value of the parameter; build the same laws for all values"
            )
        self._linear(earlier)
        self._before = None if earlier is None else earlier.shooting

    @cached_property
    def shooting(self) -> Shooting | None:
        """The problem of the exact orbits; None where shooting does not take the scene."""
        try:
            return Shooting(self.what, self.scene, self.periods, period=self.period, earlier=self._before)
        except MethodError:
            return None

    # -- the linear rest ------------------------------------------------------------------------------

    def _linear(self, earlier: HarmonicBalance | None) -> None:
        system = self.system
        rows = all_rows(self.groups)
        law_rows = np.zeros((0, system.size)) if rows is None else np.asarray(rows.toarray())
        vectors = np.array([load.vector for load in system.loads]).reshape(-1, system.size)
        inputs = np.concatenate([law_rows, vectors])
        highest: float = self.reach * self.omega
        attached = linear_laws(self.what, system)
        rest = None if earlier is None else earlier.rest
        if earlier is not None and system.size <= FULL:
            share_modes(system, earlier.system)
        if (
            earlier is None
            or rest is None
            or earlier.highest < highest
            or attached
            or not system.has_matrices_of(earlier.system)
            or not np.array_equal(inputs, earlier.inputs)
        ):
            largest = np.linspace(0.0 if not system.rigid.shape[1] else self.omega, _MARGIN * highest, 5)
            rest = LinearRest(system, attached, inputs, largest, self.work.runs)
            highest *= _MARGIN
        else:
            highest = earlier.highest
        self.rest: LinearRest = rest
        self.inputs: Array = inputs
        self.highest: float = highest
        count = self.laws.size
        modal = inputs @ rest.vectors
        self.law_modes, self.load_modes = modal[:count], modal[count:]
        self._hold(rest)
        forces = np.empty((self.reach + 1, rest.squares.size, count + 1), dtype=complex)
        forces[:, :, :count], forces[:, :, count] = self.law_modes.T, self._series.T @ self.load_modes
        answer = self.law_modes @ self._answer(forces)
        self.compliance, self.free = answer[:, :, :count], answer[:, :, count].T

    def _hold(self, rest: LinearRest) -> None:
        """Give a spring to each law that alone prevents a rigid motion; its force is subtracted from that of the law.

        The equations stay the same. Without it the compliance would be infinite at zero frequency.
        """
        self._held, self._rest_held = np.zeros(self.laws.size), rest
        if not np.any(rest.squares == 0.0) or not self.laws.size:
            return
        mobility = np.sum(self.law_modes**2, axis=1)
        self._held = held = self.loads.omega**2 / np.where(mobility > 0.0, mobility, 1.0)
        self._rest_held = rest.with_attached(Attached(all_rows(self.groups), lambda omega: held.astype(complex)))

    def _answer(self, forces: Complex) -> Complex:
        """Return modal displacements under modal forces of all harmonics from 0 on, both (reach + 1, m, n)."""
        omegas = np.asarray(self.omega * np.arange(self.reach + 1), dtype=float)
        try:
            return self._rest_held.response(omegas, forces)
        except SingularSystemError as error:
            raise SingularSystemError(f"{self.what}: harmonics of {self.omega:.9g} rad/s: {error}") from None

    # -- guesses --------------------------------------------------------------------------------------

    def from_rest(self) -> Array:
        """Return the linear response."""
        return to_real(self.free[:, : self.harmonics + 1].T).T.ravel()

    @cached_property
    def transient(self) -> Array:
        """The harmonics of the last periods of a run from rest."""
        period = self.loads.period
        count = self.periods * max(1, _TRANSIENT // self.periods)
        # Runs of large systems do not store every step.
        times = self._times((count - self.periods) * period, self.periods * period)
        try:
            run = simulate(
                self.scene, count * period, method=ENERGY_CONSERVING.name, dt=period / _STEPS, times=times, nearby=False
            )
        except Exception as error:
            raise ConvergenceError(
                f"{self.what}: harmonic balance does not converge from the linear response, and a transient from rest "
                f"fails: {error}. Give a guess="
            ) from error
        return self.from_orbit(run)

    def from_orbit(self, orbit: Any) -> Array:
        """Return the harmonics of an orbit, or of the last period of a `Result`, along the laws' coordinates."""
        if isinstance(orbit, PeriodicOrbit):
            known = orbit.unknowns
            same = orbit.method == "harmonic_balance" and orbit.periods == self.periods
            if same and known is not None and known.size == self.size:
                return np.array(known)
            result, repeats = orbit.result, max(1, round(self.periods / orbit.periods))
            start, duration = 0.0, orbit.period
        elif isinstance(orbit, Result):
            result, repeats = orbit, 1
            duration = self.periods * self.loads.period
            end = result.t_start + result.solution.t_end
            start = np.floor(end / duration * (1.0 + 1e-12)) * duration - duration - result.t_start
            if start < -1e-9 * duration:
                raise ArgumentError(
                    f"{self.what}: the guess is a run of {result.solution.t_end:g} s, which holds no whole "
                    f"{duration:g} s of the orbit; simulate longer"
                )
        else:
            raise ArgumentError(
                f"{self.what}: guess is {orbit!r}; harmonic balance takes a PeriodicOrbit, or a Result over at least "
                "one whole orbit"
            )
        if result.model.system.size != self.system.size:
            raise ArgumentError(
                f"{self.what}: the guess has {result.model.system.size} degrees of freedom, the scene "
                f"{self.system.size}; give an orbit on the same mesh"
            )
        rows = all_rows(self.groups)
        if rows is None:
            return np.zeros(0)
        times = self._times(max(start, 0.0), duration, repeats)
        order = np.argsort(times, kind="stable")
        u = np.empty((self.laws.size, times.size))
        u[:, order] = result.solution.sample(times[order]).along(rows, "q")
        angles = np.linspace(0.0, 2.0 * np.pi, times.size, endpoint=False)
        functions = basis(angles, self.harmonics) * (2.0 / times.size)
        functions[:, 0] *= 0.5
        return np.asarray(u @ functions).ravel()

    def _times(self, start: float, duration: float, repeats: int = 1) -> Array:
        """Return times in s from which harmonics are computed, at equal angles of an orbit that holds a motion."""
        count = 8 * (self.harmonics + 1)
        return np.asarray(start + np.mod(np.arange(count) * repeats / count, 1.0) * duration, dtype=float)

    # -- equations ------------------------------------------------------------------------------------

    def evaluate(self, unknowns: Array, *, derivative: bool = True) -> HarmonicEvaluation:
        """Return the balance of harmonics."""
        self.work.begin()
        self.work.flows += 1
        m, h = self.laws.size, self.harmonics
        u = unknowns.reshape(m, 2 * h + 1)
        if not np.all(np.isfinite(u)):
            raise ConvergenceError("the iteration diverged: a harmonic is not finite")
        forces, slopes, remarks = self.forces(u, h, derivative)
        jacobian = self.jacobian(slopes) if derivative else np.empty((0, 0))
        return HarmonicEvaluation(self, u.copy(), self.balanced(u, forces), remarks, jacobian)

    def balanced(self, u: Array, forces: Complex) -> Array:
        """Return what harmonics of coordinates (m, 2H + 1) lack under those of forces (m, H + 1), shape (n,)."""
        h = self.harmonics
        balance = self.free[:, : h + 1] - np.einsum("kij,jk->ik", self.compliance[: h + 1], forces)
        return np.asarray(u - to_real(balance.T).T).ravel()

    def forces(self, u: Array, wanted: int, derivative: bool = False) -> tuple[Complex, list[Array], list[str]]:
        """Return harmonics of the laws' forces (m, wanted + 1), their slopes, and remarks on internal variables.

        Coordinates u may have more harmonics than the unknowns where no slopes are wanted.
        """
        m, h = self.laws.size, self.harmonics
        forces = np.zeros((m, wanted + 1), dtype=complex)
        slopes, remarks = list[Array](), list[str]()
        for j in range(m):
            found = self.laws.along(j, u[j], self.omega, wanted, derivative=derivative)
            forces[j] = to_complex(found.force)
            remarks += [found.remark] if found.remark else []
            forces[j, : h + 1] -= self._held[j] * to_complex(u[j])[: h + 1]
            if derivative:
                slopes.append(found.slope - self._held[j] * np.eye(2 * h + 1))
        return forces, slopes, remarks

    def jacobian(self, slopes: list[Array]) -> Array:
        """Return the Jacobian matrix: the identity and the compliance times the laws' slopes."""
        m, h = self.laws.size, self.harmonics
        n = 2 * h + 1
        matrix = np.eye(m * n)
        g = self.compliance[: h + 1]
        for i in range(m):
            for j in range(m):
                real, imaginary = g[:, i, j].real[:, None], g[1:, i, j].imag[:, None]
                cosines, sines = slopes[j][: h + 1], slopes[j][h + 1 :]
                block = matrix[i * n : (i + 1) * n, j * n : (j + 1) * n]
                block[: h + 1] += real * cosines
                block[1 : h + 1] += imaginary * sines
                block[h + 1 :] += real[1:] * sines - imaginary * cosines[1:]
        return matrix

    # -- orbits ---------------------------------------------------------------------------------------

    def orbit(self, unknowns: Array, evaluation: HarmonicEvaluation) -> PeriodicOrbit:
        """Return the orbit of a solution."""
        remarks = list(evaluation.remarks)
        if self.undecided is not None and self.shooting is None:
            remarks.append(self.undecided)

        def result() -> Result:
            return harmonic_result(self.scene, evaluation.motion, (evaluation.truncation.what, *remarks))

        return PeriodicOrbit(
            OrbitSource(
                scene=lambda: self.scene,
                motion=lambda: evaluation.motion,
                result=result,
                multipliers=lambda: evaluation.multipliers,
                uncertainty=lambda: evaluation.uncertainty,
                truncation=lambda: evaluation.truncation,
            ),
            "harmonic_balance",
            self.loads.omega,
            self.periods,
            residual=evaluation.error,
            remarks=remarks,
            unknowns=np.array(unknowns),
        )

    def motion(self, forces: Complex) -> HarmonicMotion:
        """Return the motion of the whole structure under the laws' forces, with all their known harmonics."""
        right = self._series.T @ self.load_modes - forces.T @ self.law_modes
        modal = self._answer(right[:, :, None])[:, :, 0].T
        return HarmonicMotion(self.system, self.rest, self.laws, modal, self.omega)

    @cached_property
    def undecided(self) -> str | None:
        """Return why multipliers of the motions are not computed, or None."""
        with_past = [group for group in self.system.laws if group.linear]
        label = with_past[0].labels[0] if with_past else self.laws.with_past()
        if label is not None:
            return f"stability is not decided, because the force of {label} depends on the past of its motion"
        rest, system = self.rest, self.system
        lowest = float(np.sqrt(rest.squares.max(initial=0.0)))
        if rest.squares.size < system.size and slowest_decay(system, lowest) <= 0.0:
            return (
                f"stability is not decided, because vibrations above {lowest:.3g} rad/s are left out and do not decay"
            )
        return None

    def multipliers(self, motion: HarmonicMotion) -> Complex:
        """Return the Floquet multipliers of a motion."""
        rows = all_rows(self.groups)
        series = np.zeros((0, 1)) if rows is None else motion.along(rows)
        tangents = [self.laws.motion(j, series[j], self.omega) for j in range(self.laws.size)]
        return eigenvalues(monodromy(self.rest, self.law_modes, tangents, self.omega, self.harmonics))

    def change_after(self, count: int, unknowns: Array, evaluation: Any) -> float:
        """Return the largest harmonic that does not repeat after so many periods of the loads, over the largest one."""
        coefficients = np.abs(to_complex(unknowns.reshape(self.laws.size, 2 * self.harmonics + 1).T))
        other = np.arange(coefficients.shape[0]) % (self.periods // count) != 0
        size = float(coefficients.max(initial=0.0))
        return float(coefficients[other].max(initial=0.0)) / size if size > 0.0 else 0.0


def harmonics_in(scene: Scene, size: int) -> int | None:
    """Return the number of harmonics that belongs to a number of unknowns; None if the scene has no laws."""
    laws = sum(len(group) for group in nonlinear_groups(scene.model.system))
    return (size // laws - 1) // 2 if laws else None


def treated(what: str, system: System) -> System:
    """Return the system with sliders as springs; raise `MethodError` for laws that harmonic balance cannot treat."""
    refuse_travelling(what, system)
    for group in nonlinear_groups(system):
        reason = group.harmonic_refusal()
        if reason is not None:
            raise MethodError(f"{what}: {reason}")
    sliders = system.sliders
    if sliders is None:
        return system
    laws = tuple(sliders.as_springs() if group is sliders else group for group in system.laws)
    return system.with_laws("sliders as springs", laws)
