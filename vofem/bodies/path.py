"""Points that travel along a beam, and loads at such points as functions of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any, Literal, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from vofem.bodies.base import Array, IntArray, Point
from vofem.bodies.cubics import hermite
from vofem.bodies.kinds import Along
from vofem.errors import ArgumentError
from vofem.parameters import Choice, Real, declared
from vofem.time_functions import Constant, Piece, Pulse, TimeFunction, parts_of
from vofem.time_functions.moments import sampled

#: Distance to a node, over the length of an element, below which a point is at the node.
_AT = 1e-9


@declared(frozen=True)
class Path:
    """How a point travels along a beam: ``x = start + speed (t - begin) + acceleration (t - begin)^2/2``.

    The point does not exist before `begin`. Both ends of the beam belong to the path.
    """

    speed: Annotated[float, Real("m/s", "Speed at the time `begin`; a negative one leads to the left.")]
    start: Annotated[
        float, Real("m", "Place at the time `begin`, an x of the beam, which may lie beyond its ends.")
    ] = 0.0
    begin: Annotated[float, Real("s", "Time at which the point begins to exist.", least=0)] = 0.0
    acceleration: Annotated[float, Real("m/s^2", "Acceleration along the beam.")] = 0.0
    profile: Annotated[
        float | Callable[[Any], Any] | None,
        Along(
            "m",
            "Height of the road above the axis of the beam, of which contacts, springs and dashpots know. Without it "
            "the road is flat.",
        ),
    ] = None
    ends: Annotated[
        Literal["free", "rigid"],
        Choice(
            ("free", "rigid"),
            'What contacts, springs and dashpots find beyond the ends of the beam: nothing ("free"), or a rigid road '
            'at the height of the profile ("rigid"). An end that no support holds is then a step of the road: what is '
            "stored changes there at once, and dampers do not feel the step.",
        ),
    ] = "free"

    def position(self, t: ArrayLike) -> Array:
        """Return x at times t, m; before `begin` as if the point had come along the same way."""
        late = np.asarray(t, dtype=float) - self.begin
        return np.asarray(self.start + late * (self.speed + 0.5 * self.acceleration * late))

    def velocity(self, t: ArrayLike) -> Array:
        """Return the speed along the beam at times t, m/s."""
        return np.asarray(self.speed + self.acceleration * (np.asarray(t, dtype=float) - self.begin))

    def times_at(self, x: ArrayLike) -> Array:
        """Return the times from `begin` on at which the point passes some places, sorted, s."""
        way = np.asarray(x, dtype=float).ravel() - self.start
        with np.errstate(all="ignore"):
            root = np.sqrt(self.speed**2 + 2.0 * self.acceleration * way)
            far = self.speed + (root if self.speed >= 0.0 else -root)
            late = np.concatenate([2.0 * way / far, far / -self.acceleration if self.acceleration else way * np.nan])
        return np.unique(self.begin + late[np.isfinite(late) & (late >= 0.0)])

    def height(self, x: Array) -> Array:
        """Return the height of the road at x, m, shape (k,)."""
        if self.profile is None:
            return np.zeros(x.shape)
        try:
            values = np.asarray(self.profile(x) if callable(self.profile) else self.profile, dtype=float)
            values = np.broadcast_to(values, x.shape)
        except (TypeError, ValueError, ArithmeticError, LookupError) as error:
            raise ArgumentError(
                f"Path: profile failed ({type(error).__name__}: {error}); expected a function of places in m, "
                "an array, that returns the height of the road at each of them"
            ) from error
        if not np.all(np.isfinite(values)):
            raise ArgumentError(f"Path: profile is not finite at x = {x[int(np.argmin(np.isfinite(values)))]:g} m")
        return values

    def describe(self) -> str:
        """Return speed, acceleration and start."""
        grows = f", {self.acceleration:g} m/s^2" if self.acceleration else ""
        begin = f" at t = {self.begin:g} s" if self.begin else ""
        return f"at {self.speed:g} m/s{grows} from x = {self.start:g} m{begin}"


class TravellingPoint(Point):
    """A point that travels along a beam; made by `Beam.along`.

    `x`: where it begins, or the end of the beam that is nearest to that place.
    """

    def __init__(self, body: Any, path: Path) -> None:
        super().__init__(body, float(np.clip(path.start, body.nodes[0], body.nodes[-1])))
        self.path = path

    @property
    def name(self) -> str:
        """Body and path, for texts."""
        return f"{self.body.name}@{self.path.describe()}"

    def __repr__(self) -> str:
        return f"{self.body!r}.along({self.path!r})"

    def describe(self) -> str:
        """Return body and path."""
        return f"{self.body.label} {self.path.describe()}"

    def row(self) -> NoReturn:
        """Raise an error, because the row depends on time."""
        raise ArgumentError(
            f"a point of {self.describe()} travels, and what is asked for knows points at rest only; give "
            f"{self.body.name}.at(x), or simulate with a stepping method and ask at the points of interest"
        )

    def slope_row(self) -> NoReturn:
        """Raise an error, because the row depends on time."""
        self.row()

    def inside(self, t: Array) -> Any:
        """Return whether the point is on the beam at times t, ndarray of bool."""
        x, nodes = self.path.position(t), self.body.nodes
        slack = _AT * self.body.element_lengths.min()
        return (t >= self.path.begin) & (x >= nodes[0] - slack) & (x <= nodes[-1] + slack)

    def place(self, t: float) -> Point | None:
        """Return the point of the beam at a time in s; None where the point is not on it."""
        nodes = self.body.nodes
        if not bool(self.inside(np.array([t]))[0]):
            return None
        return self.body.at(float(np.clip(self.path.position(t), nodes[0], nodes[-1])))

    def present(self, t: Array) -> Any:
        """Return whether there is anything below the point at times t: the beam, or a rigid road beyond its ends."""
        if self.path.ends == "rigid":
            return t >= self.path.begin
        return self.inside(t)

    def velocity(self, t: Array) -> Array:
        """Return the speed along the beam at times t, m/s."""
        return self.path.velocity(t)

    def road(self, t: Array) -> Array:
        """Return the height of the road above the axis at times t, m."""
        return self.path.height(self.path.position(t))

    def road_rate(self, t: Array) -> Array:
        """Return the rate at which this height changes, m/s, by a difference over a millionth of the beam."""
        if self.path.profile is None:
            return np.zeros(t.shape)
        x, step = self.path.position(t), 1e-6 * self.body.length
        slope = (self.path.height(x + step) - self.path.height(x - step)) / (2.0 * step)
        return slope * self.path.velocity(t)

    def crossings(self, t_end: float) -> Array:
        """Return the times in (0, t_end) at which the point appears, or passes a node, sorted, s."""
        times = np.unique(np.append(self.path.times_at(self.body.nodes), self.path.begin))
        return times[(times > 0.0) & (times < t_end)]

    def jumps(self, start: float, stop: float) -> Array:
        """Return the times after a start, up to a stop, at which the point steps onto the beam, or off it, in s.

        Where a support holds the beam there is no step.
        """
        nodes, slack = self.body.nodes, _AT * self.body.element_lengths.min()
        held = nodes[[node for node, kind in self.body.supports.items() if kind != "guided"]]
        times = np.unique(np.append(self.path.times_at(nodes[[0, -1]]), self.path.begin))
        far = np.abs(self.path.position(times)[:, None] - held) > slack
        return times[self.inside(times) & np.all(far, axis=1) & (times > start) & (times <= stop)]

    def cubics(self, t: Array, derivative: int = 0, *, ahead: bool = False) -> tuple[IntArray, Array]:
        """Return degrees of freedom and weights of a derivative of eta by x at times t, each of shape (k, 4).

        At a node the element that lies ahead is taken. Weights are zero where the point is not on the beam, and with
        `ahead` also where it is just about to leave.
        """
        nodes, lengths = self.body.nodes, self.body.element_lengths
        x, way = self.path.position(t), self.path.velocity(t)
        way = np.where(way == 0.0, self.path.acceleration, way)
        element = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, lengths.size - 1)
        xi = (x - nodes[element]) / lengths[element]
        back = (way < 0.0) & (xi < _AT) & (element > 0)
        on = (way >= 0.0) & (xi > 1.0 - _AT) & (element < lengths.size - 1)
        element = element - back + on
        xi = np.where(back, 1.0, np.where(on, 0.0, np.clip(xi, 0.0, 1.0)))
        weights = np.stack([hermite(i, xi, lengths[element], derivative) for i in range(4)], axis=1)
        there = self.inside(t)
        if ahead:
            slack = _AT * lengths.min()
            there &= ~(((way > 0.0) & (x >= nodes[-1] - slack)) | ((way < 0.0) & (x <= nodes[0] + slack)))
        weights[~there] = 0.0
        return 2 * element[:, None] + np.arange(4), weights


def place_at(point: Any, t: float) -> Any:
    """Return a point as it lies at a time in s: the point itself if it rests, None where it is not on its beam."""
    return point.place(t) if isinstance(point, TravellingPoint) else point


#: Samples in the shortest time of a load.
_FINE = 0.2


class TravellingLoad(TimeFunction):
    """The share of loads that travel along one beam in the force on one of its degrees of freedom.

    The shape functions of an element are cubics of x, so at constant speed the share of a constant force is a cubic of
    time between two nodes.

    `dof`: number of the degree of freedom among those of the beam.
    `riders`: the places of the loads, and their forces in N.
    """

    written_out = False
    travels = True
    obstacle = "it travels with an acceleration, or with a force that varies other than by pulses"

    def __init__(self, dof: int, riders: Sequence[tuple[TravellingPoint, TimeFunction]]) -> None:
        self.dof, self.riders = dof, tuple(riders)

    def __repr__(self) -> str:
        return f"{len(self.riders)} travelling loads"

    @property
    def closed_form(self) -> bool:  # type: ignore[override]
        """Whether all speeds are constant, and all forces constant or pulses."""
        return all(
            point.path.acceleration == 0.0 and all(isinstance(part, (Constant, Pulse)) for part in parts_of(force))
            for point, force in self.riders
        )

    def _weights(self, point: TravellingPoint, t: Array, derivative: int) -> Array:
        """Return the weights of the degree of freedom at times t, shape (k,)."""
        dofs, weights = point.cubics(t, derivative, ahead=True)
        return np.asarray(np.sum(np.where(dofs == self.dof, weights, 0.0), axis=1))

    def __call__(self, t: ArrayLike) -> Array:
        """Return the values at times t."""
        times = np.asarray(t, dtype=float)
        flat = times.ravel()
        total = np.zeros(flat.size)
        for point, force in self.riders:
            weights = self._weights(point, flat, 0)
            mine = np.flatnonzero(weights)
            if mine.size:
                total[mine] += force(flat[mine]) * weights[mine]
        return total.reshape(times.shape)

    def derivative(self, t: ArrayLike, order: int = 1) -> Array:
        """Return a derivative of the polynomials."""
        times = np.asarray(t, dtype=float)
        known = self.polynomials(times.ravel())
        return known[order].reshape(times.shape) if order < 4 else np.zeros(times.shape)

    def polynomials(self, t0: Array) -> Array:
        """Return value and derivatives of the cubics from many times on, shape (4, k)."""
        found = np.zeros((4, t0.size))
        for point, force in self.riders:
            values = force(t0)
            for order, row in enumerate(found):
                row += values * point.path.speed**order * self._weights(point, t0, order)
        return found

    def piece(self, t0: float) -> Piece:
        """Return the cubic that holds from t0 on."""
        return Piece((), *self.polynomials(np.array([t0]))[:, 0].tolist())

    def breakpoints(self, t_end: float) -> Array:
        """Return the times at which a load appears, passes a node, or its force changes its course."""
        known = [point.crossings(t_end) for point, _ in self.riders]
        return np.unique(np.concatenate([*known, *(force.breakpoints(t_end) for _, force in self.riders)]))

    def shortest(self, t_end: float) -> float:
        """Return the shortest time in which a load passes an element, or its force changes."""
        found = []
        for point, force in self.riders:
            fastest = float(
                np.max(np.abs(point.path.velocity(np.array([point.path.begin, max(t_end, point.path.begin)]))))
            )
            passed = float(point.body.element_lengths.min()) / fastest if fastest > 0.0 else np.inf
            found += [passed, force.shortest(t_end)]
        return min(found)

    def smooth_moments(self, left: Array, right: Array, width: float) -> Array:
        """Return the moments by quadrature that is exact for constant forces."""
        if not left.size:
            return np.empty((3, 0))
        changes = min(force.shortest(float(np.max(right))) for _, force in self.riders)
        return sampled(self, left, right, min(width, _FINE * changes))
