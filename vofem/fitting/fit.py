"""Least squares for the numbers of a scene, with exact Jacobians of runs through impacts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from vofem._validate import listed, number, whole, wrong
from vofem.arrays import Array
from vofem.blas import one_thread
from vofem.bodies.beam import Beam
from vofem.cards import Saved
from vofem.errors import ArgumentError, ConvergenceError, VofemError
from vofem.fitting.measured import Data, Trial
from vofem.parameters.place import found
from vofem.scene import Scene, as_scene
from vofem.sensitivities import Parameter
from vofem.sensitivities.change import PLACES, path_of
from vofem.sensitivities.parameter import names_of, parameters_of

#: Relative changes of the sum of squares and of the unknowns at which a fit ends.
_TOLERANCE = 1e-12

#: Gradient, relative to that of a misfit as large as at the start, below which there is no direction to go.
_LEVEL = 1e-15

#: Shares of the data's duration over which windows grow.
_WINDOWS = (0.125, 0.25, 0.5, 1.0)

#: A window ends early: the next one starts from its result, which needs not be exact.
_ROUGH = 1e-4

#: Distance from a bound, as a share of the value or of what changes the residuals as a whole, that is none.
_AT_BOUND = 1e-9

#: Chance of a sum of squares, if model and noise are right, below which a note doubts them.
_BY_CHANCE = 1e-6

#: Singular values of the scaled Jacobian, relative to the largest one, below which a combination is not identifiable.
_SINGULAR = 1e-9

#: Trials that are kept: the optimiser comes back to the last good one when a step is rejected.
_KEPT = 4

#: Range of further starts around the scene's numbers where there are no bounds.
_SPREAD = 0.5


@dataclass(frozen=True)
class FitStart:
    """The outcome of a fit from one start.

    Attributes
    ----------
    start, values : ndarray, shape (p,)
        Values of the parameters at the begin and at the end.
    chi2 : float
        Sum of the squared residuals, each divided by the noise where this is given.
    """

    start: Array
    values: Array
    chi2: float


@dataclass(eq=False, repr=False)
class Fit(Saved):
    """The outcome of `fit`.

    Attributes
    ----------
    parameters : tuple of Parameter
        Of `scene`, in the order in which they were given.
    values, deviation : ndarray, shape (p,)
        Estimates, and their standard deviations; NaN for parameters that the data do not determine, and where there
        are no more data than unknowns, which do not tell their noise.
    covariance : ndarray, shape (p, p)
        NaN where `deviation` is.
    offsets : ndarray
        Estimated constants of the data with ``offset=True``, in their order.
    residuals : ndarray, shape (n,)
        Model less measurement, in the units of the data, in the order of the data.
    chi2 : float
        Sum of the squared residuals, each divided by the noise where this is given.
    not_identifiable : list of str
        Names of parameters on which the data do not depend, alone or in a combination; numbered where several have one.
    scene : Scene
        The scene with the estimates, ready to run.
    starts : tuple of FitStart
        The outcomes from all starts, the best one first.
    until : float
        End of the data that were used, s.
    runs : int
        Number of evaluations of the model, of the best start.
    data : tuple
        The data. Those of a fit from a file can be drawn, but not fitted again.
    notes : list of str
        Sentences that a user should read.
    """

    _saver = "fit"

    parameters: tuple[Parameter, ...]
    data: tuple[Data, ...]
    scene: Scene
    starts: tuple[FitStart, ...]
    values: Array
    offsets: Array
    covariance: Array
    not_identifiable: list[str]
    residuals: Array
    chi2: float
    until: float
    runs: int
    notes: list[str]

    @property
    def deviation(self) -> Array:
        """Standard deviations of the estimates, shape (p,)."""
        return np.sqrt(np.diag(self.covariance))

    def __repr__(self) -> str:
        parts = [f"{name} = {value:.6g}" for name, value in zip(names_of(self.parameters), self.values, strict=True)]
        return f"Fit({', '.join(parts)})"

    def report(self) -> str:
        """Return a table of estimates with their deviations and correlations, and the notes."""
        begun = "from one start" if len(self.starts) == 1 else f"from {len(self.starts)} starts"
        lines = [f"{self.residuals.size} data, chi2 = {self.chi2:.6g}, {self.runs} runs {begun}"]
        names = names_of(self.parameters)
        width = max(map(len, names))
        for name, parameter, value, deviation in zip(names, self.parameters, self.values, self.deviation, strict=True):
            spread = "of unknown deviation" if np.isnan(deviation) else f"+- {deviation:.3g}"
            spread = "not determined" if name in self.not_identifiable else spread
            lines.append(f"  {name:<{width}}  {value:.8g} {spread} {parameter.unit(self.scene)}".rstrip())
        for k in range(len(self.parameters)):
            for j in range(k):
                both = self.deviation[j] * self.deviation[k]
                share = self.covariance[j, k] / both if both > 0.0 else 0.0
                if abs(share) > 0.5:
                    lines.append(f"  correlation of {names[j]}, {names[k]}: {share:.3f}")
        return "\n".join([*lines, *self.notes])


def _outcome(data: tuple[Data, ...], problem: _Problem, starts: tuple[FitStart, ...], solved: _Solved) -> Fit:
    """Return the fit that a solution is, with notes about what the data do not determine."""
    scene, p = problem.scene_of(solved.x), len(problem.parameters)
    parameters = tuple(parameter.carried(problem.scene, scene) for parameter in problem.parameters)
    values, notes = solved.x[:p], list(solved.notes)
    covariance, poor = _covariance(solved, p, problem.noise_is_known)
    names = names_of(parameters)
    lost = [names[k] for k in poor]
    if lost:
        notes.append(
            f"not identifiable: the data do not determine {', '.join(lost)}; give other data, or leave these "
            "parameters out"
        )
    if len(lost) < p and np.all(np.isnan(covariance)):
        notes.append(
            f"no deviations: {solved.residuals.size} data determine as many numbers, so that they do not tell their "
            "noise; give noise=, or more data"
        )
    if problem.noise_is_known:
        notes += _doubts(solved)
    low, high = problem.bounds
    norms = np.linalg.norm(solved.jacobian, axis=0)[:p]
    for k, name in enumerate(names):
        # At the bound, or so near that the way to it changes the residuals by as little.
        little = max(abs(values[k]), np.sqrt(solved.chi2) / norms[k] if norms[k] > 0.0 else 0.0)
        if min(values[k] - low[k], high[k] - values[k]) <= _AT_BOUND * little:
            notes.append(f"bound: {name} lies at a bound, {values[k]:.6g}")
    return Fit(
        parameters, data, scene, starts, values, solved.x[p:], covariance, lost, solved.residuals, solved.chi2,
        solved.until, solved.runs, notes,
    )  # fmt: skip


def _doubts(solved: _Solved) -> list[str]:
    """Return a note if residuals are so much larger than the given noise that chance does not explain it."""
    from scipy.special import gammaincc

    spare = solved.residuals.size - np.linalg.matrix_rank(solved.jacobian)
    if spare == 0 or gammaincc(0.5 * spare, 0.5 * solved.chi2) >= _BY_CHANCE:
        return []
    return [
        f"misfit: chi2 = {solved.chi2:.3g}, expected about {spare}, the number of data less that of the unknowns. The "
        "fit has ended in a wrong minimum, the model lacks an effect, or the noise is larger than given. The "
        "deviations then mean nothing; try more starts, and look at the residuals"
    ]


@dataclass
class _Solved:
    """A solution of least squares: unknowns, residuals, scaled Jacobian (n, p + offsets), and the work."""

    x: Array
    residuals: Array
    jacobian: Array
    chi2: float
    runs: int
    notes: list[str]
    until: float


class _Problem:
    """Residuals and Jacobians over parameters and offsets."""

    def __init__(self, scene: Scene, parameters: tuple[Parameter, ...], data: tuple[Data, ...]) -> None:
        self.scene, self.parameters, self.data = scene, parameters, data
        self.first = np.array([parameter.value(scene) for parameter in parameters])
        self.with_offset = [k for k, one in enumerate(data) if one.offset]
        known = [one.noise is not None for one in data]
        if any(known) and not all(known):
            raise ArgumentError(
                "fit: some data have a noise and others have none; give it for all of them, or for none"
            )
        self.noise_is_known = all(known)
        units = sorted({one.unit for one in data})
        if len(units) > 1 and not self.noise_is_known:
            raise ArgumentError(
                f"fit: data are in {' and '.join(units)}, and only their noise says how to weigh these; give noise= "
                "for each"
            )
        self.end = float(max((one.times[-1] for one in data if one.times is not None), default=0.0))
        self.bounds = self._bounds()
        #: Numbers of pairs of parameters, a length and a place: a length moves all places on its beam.
        self._moved = [(k, j) for k, one in enumerate(parameters) for j, other in enumerate(parameters)
                       if one.field == "length" and other.field in PLACES]  # fmt: skip
        self.runs = 0
        self._known: dict[tuple[bytes, float], tuple[Trial, Array]] = {}

    def _bounds(self) -> tuple[Array, Array]:
        low, high = np.array([parameter.bounds for parameter in self.parameters]).T.copy()
        for k, (parameter, first) in enumerate(zip(self.parameters, self.first.tolist(), strict=True)):
            least, most = parameter.limits(self.scene)
            if parameter.field in PLACES and any(one.field == "length" for one in self.parameters):
                most = np.inf  # the end of the beam moves
            # A number stays away from its least value, such as no stiffness, where it would have no effect.
            least = least + 1e-6 * (first - least) if np.isfinite(least) else least
            low[k], high[k] = max(low[k], least), min(high[k], most)
        outside = (self.first < low) | (self.first > high)
        if np.any(outside):
            k = int(np.argmax(outside))
            raise ArgumentError(
                f"fit: {self.parameters[k].name} is {self.first[k]:g} in the scene, outside of its bounds "
                f"{self.parameters[k].bounds}; start from a scene within them"
            )
        return low, high

    def scene_of(self, x: Array) -> Scene:
        """Return the scene with trial values, lengths before the places that they move."""
        scene = self.scene
        for parameter, value in sorted(
            zip(self.parameters, x, strict=False), key=lambda pair: pair[0].field != "length"
        ):
            scene = parameter.carried(self.scene, scene).at(scene, float(value))
        return scene

    def trial(self, x: Array, until: float) -> tuple[Trial, Array]:
        """Return a trial and its residuals in the units of the data."""
        p = len(self.parameters)
        key = x[:p].tobytes(), until
        if key not in self._known:
            scene = self.scene_of(x)
            parameters = tuple(parameter.carried(self.scene, scene) for parameter in self.parameters)
            end = min(until, self.end)
            used = [one.times[one.times <= end] for one in self.data if one.times is not None]
            times = np.unique(np.concatenate([*used, [end]])) if used and end > 0.0 else np.zeros(1)
            trial = Trial(self.scene, scene, parameters, until, times)
            self.runs += 1
            parts = [one.model(trial) - one.values[one.used(until)] for one in self.data]
            if len(self._known) >= _KEPT:
                del self._known[next(iter(self._known))]
            self._known[key] = trial, np.concatenate(parts)
        trial, residuals = self._known[key]
        return trial, residuals + self.shifts(until) @ x[p:]

    def shifts(self, until: float) -> Array:
        """Return the derivatives of the residuals by the offsets, shape (n, offsets): 1 where an offset belongs to."""
        sizes = [int(one.used(until).sum()) for one in self.data]
        return np.repeat(np.eye(len(self.data))[:, self.with_offset], sizes, axis=0)

    def weights(self, until: float) -> Array:
        """Return the inverse of the noise of each residual."""
        parts = [np.ones(int(one.used(until).sum())) if one.noise is None else 1.0 / one.noise[one.used(until)]
                 for one in self.data]  # fmt: skip
        return np.concatenate(parts)

    def jacobian(self, x: Array, until: float) -> Array:
        """Return the derivatives of the weighted residuals, shape (n, p + offsets)."""
        trial, _ = self.trial(x, until)
        parts = [trial.once((one, "jacobian"), partial(one.jacobian, trial)) for one in self.data]
        found = np.concatenate([np.concatenate(parts), self.shifts(until)], axis=1)
        # The derivative by a length moves places on its beam; a place that is a parameter too keeps its value.
        for k, j in self._moved:
            place, length = trial.parameters[j], trial.parameters[k]
            longer = length.changed(trial.scene, x[k])
            moved = place.carried(trial.scene, longer).value(longer) - x[j]
            found[:, k] -= found[:, j] * moved / x[k]
        return found * self.weights(until)[:, None]

    def solve(self, x: Array, until: float, tolerance: float) -> _Solved:
        """Solve the least squares from a start over a window of time."""
        from scipy.optimize import least_squares

        weights = self.weights(until)
        if weights.size == 0:
            return _Solved(x, np.empty(0), np.empty((0, x.size)), 0.0, 0, [], until)
        free = np.full(len(self.with_offset), np.inf)
        low, high = np.append(self.bounds[0], -free), np.append(self.bounds[1], free)
        whole, before, notes = np.clip(x, low, high), self.runs, []
        # The residuals are linear in the offsets, so that the best ones for the start are known.
        columns = weights[:, None] * self.shifts(until)
        whole[len(self.parameters) :] -= np.linalg.lstsq(columns, weights * self.trial(whole, until)[1])[0]

        def at(y: Array) -> Array:
            z = whole.copy()
            z[moving] = y / unit
            return np.clip(z, low, high)

        def misfit(y: Array) -> Array:
            # The optimiser answers infinite residuals by a shorter step: a trial may buckle, or lose its branch.
            try:
                return np.asarray(weights * self.trial(at(y), until)[1]) / size
            except VofemError:
                return np.full(weights.size, np.inf)

        def slopes(y: Array) -> Array:
            return self.jacobian(at(y), until)[:, moving] / (size * unit)

        # A parameter on which the window does not depend keeps its value: with it, steps would have no length.
        moving = np.zeros(x.size, dtype=bool)
        while True:
            jacobian = self.jacobian(whole, until)
            scale = np.linalg.norm(jacobian, axis=0)
            if np.array_equal(moving, moving | (scale > 0.0)):
                break
            moving |= scale > 0.0
            # The optimiser sees no units: residuals are shares of the first misfit, and so are changes of the unknowns.
            size = np.linalg.norm(weights * self.trial(whole, until)[1]) or 1.0
            unit = np.where(scale > 0.0, scale, 1.0)[moving] / size
            found = least_squares(
                misfit, unit * whole[moving], jac=slopes, bounds=(unit * low[moving], unit * high[moving]),
                ftol=tolerance, xtol=tolerance, gtol=_LEVEL, max_nfev=100,
            )  # fmt: skip
            whole = at(found.x)
            notes = (
                [] if found.success else ["the fit did not converge in 100 steps; give a better start, or more starts"]
            )
        residuals = self.trial(whole, until)[1]
        chi2 = float(np.sum((weights * residuals) ** 2))
        return _Solved(whole, residuals, jacobian, chi2, self.runs - before, notes, until)


def _covariance(solved: _Solved, p: int, known: bool) -> tuple[Array, list[int]]:
    """Return the covariance (p, p), NaN where the data tell nothing, and the numbers of parameters that they miss.

    Unknown noise is estimated from the residuals; with no more data than what they determine all is NaN.
    """
    jacobian = solved.jacobian
    norms = np.linalg.norm(jacobian, axis=0)
    poor = set(np.flatnonzero(norms == 0.0).tolist())
    rest = np.flatnonzero(norms > 0.0)
    covariance = np.full((p, p), np.nan)
    if rest.size:
        # Fewer data than unknowns miss some directions: rows of zeros show them.
        missing = np.zeros((max(rest.size - jacobian.shape[0], 0), rest.size))
        _, s, vt = np.linalg.svd(np.concatenate([jacobian[:, rest] / norms[rest], missing]), full_matrices=False)
        weak = s <= _SINGULAR * s[0]
        for direction in vt[weak]:
            poor |= set(rest[np.abs(direction) > 0.1 * np.max(np.abs(direction))].tolist())
        kept = vt[~weak] / s[~weak, None]
        whole = (kept.T @ kept) / np.outer(norms[rest], norms[rest])
        if not known:
            spare = solved.residuals.size - len(kept)
            whole = whole * (solved.chi2 / spare if spare else np.nan)
        told = np.flatnonzero([k < p and k not in poor for k in rest.tolist()])
        covariance[np.ix_(rest[told], rest[told])] = whole[np.ix_(told, told)]
    return covariance, sorted(k for k in poor if k < p)


def _check_once(parameters: Sequence[Parameter], scene: Scene) -> None:
    """Raise where two parameters are one number."""
    seen: dict[Any, str] = {}
    for one in parameters:
        for thing in one.found(scene):
            every = range(thing.element_lengths.size) if isinstance(thing, Beam) else (None,)
            places = [(id(thing), path_of(thing, one.field), k) for k in one.elements or every]
            other = next((seen[place] for place in places if place in seen), None)
            if other is not None:
                also = "" if other == one.name else f", also within {other}"
                raise ArgumentError(
                    f"fit: parameters holds {one.name} more than once{also}, so that no data tell the two apart; give "
                    "it once"
                )
            seen.update(dict.fromkeys(places, one.name))


@one_thread
def fit(
    scene: Scene,
    parameters: Sequence[Parameter] | Parameter,
    data: Data | Sequence[Data],
    *,
    horizon: float | str | None = None,
    starts: int = 1,
) -> Fit:
    """Find numbers of a scene with which it explains measurements best, by least squares.

    Jacobians are exact, through impacts too (`vofem.sensitivities`), so that a fit needs few runs.

    Parameters
    ----------
    scene : Scene
        The fit starts from the numbers of the scene.
    parameters : list of Parameter
        What is unknown. Linked numbers are one parameter; what is not listed stays fixed.
    data : Measured, MeasuredCurve, MeasuredEvents, MeasuredFrequencies, MeasuredStatics, or a list of them
    horizon : float or "grow", optional
        The end of the data that are used, s. With "grow" the fit begins with an eighth of the duration, which it
        doubles three times: motions with impacts drift apart, so that over a long time the sum of squares has many
        minima. The default is all data.
    starts : int
        Number of starts. Further ones lie within the bounds of the parameters, or within half of their values.

    Returns
    -------
    Fit

    Raises
    ------
    ArgumentError
        If parameters or data do not fit to the scene, or its start lies outside of the bounds.
    ConvergenceError
        If no start leads to a solution.
    MethodError
        If the scene is not one for ``event_driven``; the message says why.

    Notes
    -----
    With noise given, the covariance is ``(J'J)^-1`` of the Jacobian over the noise. Otherwise the variance of the noise
    is estimated from the residuals. Data in several units, such as m and Hz, need their noise. A parameter on which the
    data do not depend keeps its value and is named in `Fit.not_identifiable`. Derivatives by the length of a beam move
    the places on it in proportion, except for those that are parameters too. The optimiser is
    `scipy.optimize.least_squares`.
    """
    as_scene("fit", scene)
    chosen = parameters_of("fit", parameters, scene)
    _check_once(chosen, scene)
    measured = tuple(listed(data))
    if not measured or not all(isinstance(one, Data) for one in measured):
        shown = repr(data) if len(measured) == 1 else found(list(measured)) if measured else "empty"
        raise wrong("fit: data", shown, "what vofem.Measured returns, or several of these")
    starts = whole("fit: starts", starts)
    problem = _Problem(scene, chosen, measured)
    if problem.end == 0.0 and any(one.times is not None for one in measured):
        raise ArgumentError("fit: all data lie at t = 0, where a run only begins; give data at later times")
    windows = _windows(horizon, problem.end)
    if not problem.weights(windows[-1]).size:
        raise ArgumentError(f"fit: horizon is {horizon!r} s, before the first of the data; give a later one")
    solutions: list[tuple[FitStart, _Solved]] = []
    failure: VofemError | None = None
    for begin in _begins(problem, starts):
        x = np.append(begin, np.zeros(len(problem.with_offset)))
        problem.runs, problem._known = 0, {}
        try:
            for until in windows[:-1]:
                x = problem.solve(x, until, _ROUGH).x
            solved = problem.solve(x, windows[-1], _TOLERANCE)
        except VofemError as error:
            failure = failure or error
            if starts == 1:
                raise
            continue
        solved.runs = problem.runs
        solutions.append((FitStart(begin, solved.x[: len(chosen)], solved.chi2), solved))
    if not solutions:
        raise ConvergenceError(f"fit: none of {starts} starts led to a solution; the first one ended with: {failure}")
    solutions.sort(key=lambda pair: pair[0].chi2)
    return _outcome(measured, problem, tuple(start for start, _ in solutions), solutions[0][1])


def _windows(horizon: Any, end: float) -> list[float]:
    """Return the ends of the windows of time, s."""
    if horizon is None:
        return [end]
    if isinstance(horizon, str):
        if horizon != "grow":
            raise ArgumentError(f"fit: horizon is {horizon!r}, expected a time in s or 'grow'")
        return [share * end for share in _WINDOWS]
    return [number("fit: horizon", horizon, positive=True)]


def _begins(problem: _Problem, count: int) -> list[Array]:
    """Return the starts: the numbers of the scene, and points of a Latin hypercube."""
    begins = [problem.first]
    if count > 1:
        from scipy.stats import qmc

        reach = _SPREAD * np.where(problem.first != 0.0, np.abs(problem.first), 1.0)
        low = np.where(np.isfinite(problem.bounds[0]), problem.bounds[0], problem.first - reach)
        high = np.where(np.isfinite(problem.bounds[1]), problem.bounds[1], problem.first + reach)
        own = np.isfinite([parameter.bounds for parameter in problem.parameters])
        low = np.where(own[:, 0], low, np.maximum(low, problem.first - reach))
        high = np.where(own[:, 1], high, np.minimum(high, problem.first + reach))
        points = qmc.LatinHypercube(d=problem.first.size, rng=np.random.default_rng(0)).random(count - 1)
        begins += [low + point * (high - low) for point in points]
    return begins
