"""The data of a run or of an equilibrium at one time that a picture needs."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vofem._validate import number
from vofem.arrays import Array
from vofem.bodies import Beam
from vofem.bodies.base import Body, Point
from vofem.bodies.path import place_at
from vofem.effects import CrushingStop, Foundation, Joint
from vofem.errors import ArgumentError, VofemError
from vofem.io.pictures.places import all_contacts
from vofem.result import Result
from vofem.scene import Scene
from vofem.statics import Equilibrium
from vofem.system import CLOSED, OPEN, PINNED
from vofem.time_functions import as_time_function

#: Arrows of a distributed load.
_ARROWS = 9


@dataclass(frozen=True)
class Push:
    """A load at the time of a picture."""

    kind: str  #: "force", "moment", "line" (a load along a beam), or "weight".
    points: tuple[Point, ...]  #: Points on which the load acts; empty for the weight.
    #: Values in N, N m or N/m, positive upward. For the weight it is g in m/s^2, positive downward. Shape (n_points,).
    values: Array
    largest: float  #: Largest magnitude over the run, of all points.


def pushes(scene: Scene, times: Array, run: Array) -> list[tuple[Push, ...]]:
    """Return the loads at some times of the loads, with their largest values over the times of the run.

    A load whose values at these times are not known, which may occur for a run from a file, is left out.
    """
    found: list[list[Push]] = [[] for _ in times]
    for effect in scene.effects:
        try:
            parts = _of(effect, times, run)
        except VofemError:
            continue
        for k, push in enumerate(parts):
            if push is not None:
                found[k].append(push)
    return [tuple(some) for some in found]


def _symbol(effect: Any) -> str:
    """Return how an effect is shown, as its class says; empty for one of another package."""
    return str(getattr(effect, "symbol", ""))


def _of(effect: Any, times: Array, run: Array) -> list[Push | None]:
    """Return the loads of an effect at some times, None where they are not on the beam; nothing if it is no load."""
    symbol = _symbol(effect)
    if symbol == "weight":
        return [Push("weight", (), np.array([effect.g]), abs(effect.g)) for _ in times]
    if symbol not in ("force", "moment", "line"):
        return []
    f = as_time_function(effect.f)
    now = np.array(f(times), dtype=float)
    most = float(np.max(np.abs(np.append(np.asarray(f(run), dtype=float), now)), initial=0.0))
    # What rounding leaves of a sine is no load.
    now[np.abs(now) < 1e-12 * most] = 0.0
    if symbol == "line":
        beam: Beam = effect.beam
        x = np.linspace(beam.nodes[0], beam.nodes[-1], _ARROWS)
        p = effect.along(x)
        points = tuple(beam.at(float(place)) for place in x)
        return [Push("line", points, p * value, most * float(np.max(np.abs(p), initial=0.0))) for value in now]
    places = [place_at(effect.point, t) for t in times.tolist()]
    return [
        None if place is None else Push(symbol, (place,), np.array([value]), most)
        for place, value in zip(places, now, strict=True)
    ]


#: A field along a beam, of x.
Field = Callable[[Array, Beam], Array]

#: A beam is drawn through about this many points, and the range of a run is taken from as many times.
_POINTS, _TIMES = 240, 240

#: A two-sided foundation is drawn as this many springs, or one at each node.
_BED = 41


@dataclass(frozen=True)
class BodyState:
    """A body at the time of the picture."""

    body: Body
    x: Array  #: Places along the axis in m; 0 for a mass. Shape (k,).
    eta: Array  #: Displacement in m, shape (k,).
    moment: Array  #: Bending moment in N m; 0 for a mass. Shape (k,).
    depth: Array  #: Depth of the section, 1 where it is largest, shape (k,).
    #: `low`, `high`: range of the displacement over the whole run, in m, with 0 in it.
    low: float
    high: float
    #: `moment_low`, `moment_high`: range of the bending moment over the whole run, in N m, with 0 in it.
    moment_low: float
    moment_high: float


@dataclass(frozen=True)
class Link:
    """A contact or a spring at the time of the picture."""

    name: str
    #: `a`, `b`: the two points; b is None for a link to ground.
    a: Point
    b: Point | None
    side: str  #: "below" or "above": where ground is.
    gap: float  #: Gap in m.
    status: str  #: "open", "closed", "pinned", "spring" or "damper".
    force: float  #: Force in N, or moment in N m for a link on rotations; positive pushes the bodies apart.
    rotation: bool = False  #: Whether the link acts on rotations. In that case gaps are not drawn.


@dataclass(frozen=True)
class Snapshot:
    """A scene at one time."""

    time: float | None  #: Time in s; None for an equilibrium and for a mode shape.
    bodies: tuple[BodyState, ...]
    links: tuple[Link, ...]
    joints: tuple[Joint, ...] = ()
    peak: float = 0.0  #: The largest contact force of the run, N.
    title: str = ""  #: Text that stands in place of the time.
    pushes: tuple[Push, ...] = ()  #: Loads.
    weights: tuple[Point, ...] = ()  #: Points at which there are point masses.

    @property
    def bending(self) -> bool:
        """Whether the bending moments of a beam are known."""
        return not self.title and any(isinstance(state.body, Beam) for state in self.bodies)


def snapshot(outcome: Result | Equilibrium, t: float | None, scene: Scene | None = None) -> Snapshot:
    """Return the data that a picture of one time in s needs; an equilibrium has no time, and needs its scene."""
    if isinstance(outcome, Equilibrium):
        if scene is None:
            raise ArgumentError("a picture of an equilibrium needs scene=, the Scene that it is the equilibrium of")
        states = {name: (c.status, c.force) for name, c in outcome.contacts.items()}
        found = _states(
            scene.bodies,
            lambda body: np.asarray(body.shape.rows @ outcome.state_of(body.name)[0])[:, None],
            lambda x, beam: outcome.deflection(x, beam)[:, None],
            lambda x, beam: outcome.bending_moment(x, beam)[:, None],
        )
        return _view(scene, found[0], states, peak=max((abs(force) for _, force in states.values()), default=0.0))
    if not isinstance(outcome, Result):
        raise ArgumentError(f"expected the outcome of simulate or equilibrium, found {outcome!r}")
    return snapshots(outcome, np.array([number("the time of a picture", t)]))[0]


def snapshots(result: Result, times: Array) -> list[Snapshot]:
    """Return the data that pictures of a run need at some times within it, s, shape (n_times,).

    Ranges are those of the whole run, so that all of its pictures have one magnification and one scale of colours.
    """
    run, scene = _times_of_range(result), result.scene
    # The pictures' own times come first, then the run.
    every = np.concatenate([times, run])
    bodies = _states(
        scene.bodies,
        lambda body: result.along_shape(body, every),
        lambda x, beam: result.deflection(x, every, beam),
        lambda x, beam: result.bending_moment(x, every, beam),
        times.size,
    )
    contacts, peak = _contact_states(result, every, times.size)
    loads = pushes(scene, result.t_start + times, result.t_start + run)
    return [
        _view(
            scene, bodies[k], contacts[k] | _crushed(result, t), result.t_start + t, time=t,
            peak=peak, pushes=loads[k],
        )
        for k, t in enumerate(times.tolist())
    ]  # fmt: skip


def fixed_parts(scene: Scene) -> Snapshot:
    """Return springs, dashpots, point masses and joints of a scene at rest, without bodies, contacts and loads."""
    view = _view(scene, [], _all_open(scene))
    return replace(view, links=tuple(link for link in view.links if link.status in ("spring", "damper")))


def at_rest(scene: Scene) -> Snapshot:
    """Return a scene before anything has moved, contacts open."""
    bodies = _states(scene.bodies, lambda body: np.zeros((body.shape.x.size, 1)), _nothing, _nothing)
    return _view(scene, bodies[0], _all_open(scene), title="at rest")


def _view(
    scene: Scene, bodies: Iterable[BodyState], states: dict[str, tuple[str, float]], t: float = 0.0, *,
    time: float | None = None, **parts: Any,
) -> Snapshot:  # fmt: skip
    """Return bodies with contacts, whose status and force are given, and all else at the time t of the loads in s."""
    effects: tuple[Any, ...] = scene.effects
    joints = tuple(effect for effect in effects if isinstance(effect, Joint))
    weights = (place_at(effect.point, t) for effect in effects if _symbol(effect) == "mass")
    there = tuple(point for point in weights if point is not None)
    return Snapshot(time, tuple(bodies), _links(scene, states, t), joints, weights=there, **parts)


def _all_open(scene: Scene) -> dict[str, tuple[str, float]]:
    laws = scene.model.system.contacts
    return {} if laws is None else dict.fromkeys(laws.names, ("open", 0.0))


def _crushed(result: Result, t: float) -> dict[str, tuple[str, float]]:
    """Return status and force of crushing stops at the stored time that is nearest to t."""
    nearest = int(np.argmin(np.abs(result.times - t)))
    forces = {
        effect.name: float(result.springs[effect.name].force[nearest])
        for effect in result.scene.effects
        if isinstance(effect, CrushingStop)
    }
    return {name: ("closed" if force > 0.0 else "open", force) for name, force in forces.items()}


def _contact_states(result: Result, every: Array, count: int) -> tuple[list[dict[str, tuple[str, float]]], float]:
    """Return status and force of all contacts at the first `count` of some times, and the largest force at all."""
    laws = result.model.system.contacts
    if laws is None:
        return [{} for _ in range(count)], 0.0
    samples = result.solution.contacts(every)
    names = {OPEN: "open", CLOSED: "closed", PINNED: "pinned"}
    states = [
        {name: (names[int(samples.status[j, k])], float(samples.force[j, k])) for j, name in enumerate(laws.names)}
        for k in range(count)
    ]
    return states, float(np.max(np.abs(samples.force), initial=0.0))


def _links(scene: Scene, states: dict[str, tuple[str, float]], t: float = 0.0) -> tuple[Link, ...]:
    """Return contacts with their status and force, springs and dashpots; what travels is where it is at t in s."""
    stops = [*all_contacts(scene), *(effect for effect in scene.effects if isinstance(effect, CrushingStop))]
    links = []
    for s in stops:
        turns = s.of == "rotation"
        status = states.get(s.name, ("open", 0.0))
        links.append(Link(s.name, s.a, s.b, s.side or "below", 0.0 if turns else s.gap, *status, turns))
    effects: tuple[Any, ...] = scene.effects
    for effect in effects:
        if _symbol(effect) in ("spring", "damper"):
            a, b = (*effect.points(), None)[:2]
            links.append(Link("", a, b, "below", 0.0, effect.symbol, 0.0, effect.of == "rotation"))
    for bed in scene.effects:
        if isinstance(bed, Foundation) and not bed.one_sided:
            nodes, held = bed.beam.nodes, [bed.beam.nodes[node] for node in bed.beam.supports]
            places = np.linspace(nodes[0], nodes[-1], min(nodes.size, _BED))
            points = [bed.beam.at(float(x)) for x in places if not np.any(np.isclose(x, held))]
            links += [Link("", point, None, "below", 0.0, "spring", 0.0) for point in points]
    placed = [replace(link, a=place_at(link.a, t), b=place_at(link.b, t)) for link in links]
    return tuple(
        new for new, old in zip(placed, links, strict=True) if new.a is not None and (new.b is None) is (old.b is None)
    )


def _times_of_range(result: Result) -> Array:
    """Return times spread over the run. A stepping method has results only at the times that it has stored."""
    # Its last step may reach beyond the end of the run, where there are no results.
    stored = result.times[result.times <= result.solution.t_end]
    if result.solution.continuous:
        return np.linspace(0.0, float(stored[-1]), _TIMES)
    return stored[np.unique(np.linspace(0, stored.size - 1, _TIMES).round().astype(int))]


def _sampled(beam: Beam, deflection: Field, bending_moment: Field) -> tuple[Array, Array, Array]:
    """Return x (k,), eta (k, n_times) and M (k, n_times) along a beam.

    The moment of cubic elements jumps from one to the next by the error of discretisation; at a node the mean of both
    sides is drawn. Where a support takes up a moment the jump is real: x occurs twice there.
    """
    count = beam.element_lengths.size
    if count > 2 * _POINTS:
        x = np.linspace(beam.nodes[0], beam.nodes[-1], _POINTS + 1)
        return x, deflection(x, beam), bending_moment(x, beam)
    each = max(4, -(-_POINTS // count))
    inside = np.arange(each) / each
    x = np.append((beam.nodes[:-1, None] + inside * beam.element_lengths[:, None]).ravel(), beam.nodes[-1])
    moment = bending_moment(x, beam)
    inner = np.arange(1, count)
    before = bending_moment(x[inner * each] - 1e-6 * beam.element_lengths[:-1], beam)
    jumps = np.array([beam.supports.get(node, "pinned") != "pinned" for node in inner.tolist()], dtype=bool)
    smooth = inner[~jumps] * each
    moment[smooth] = 0.5 * (moment[smooth] + before[~jumps])
    moment = np.insert(moment, inner[jumps] * each, before[jumps], axis=0)
    x = np.insert(x, inner[jumps] * each, x[inner[jumps] * each])
    return x, deflection(x, beam), moment


def _nothing(x: Array, beam: Beam) -> Array:
    return np.zeros((x.size, 1))


def _states(
    bodies: Iterable[Body], plain: Callable[[Body], Array], deflection: Field, bending_moment: Field, count: int = 1
) -> list[list[BodyState]]:
    """Return all bodies at each of the first `count` of some times, with the ranges of all times.

    `plain` returns the displacement of the places of a body, the others fields of a beam at x, each (k, n_times).
    """
    found = []
    for body in bodies:
        if isinstance(body, Beam):
            x, eta, moment = _sampled(body, deflection, bending_moment)
            # A section of constant width has EI in proportion to the cube of its depth.
            depth = np.cbrt(body.bending_stiffness(x)[0])
            depth = np.clip(depth / depth.max(), 0.3, 1.0)
        else:
            x, eta = body.shape.x, plain(body)
            moment, depth = np.zeros(eta.shape), np.ones(x.size)
        ranges = [float(of(part, initial=0.0)) for part in (eta, moment) for of in (np.min, np.max)]
        found.append([BodyState(body, x, eta[:, k], moment[:, k], depth, *ranges) for k in range(count)])
    return [list(states) for states in zip(*found, strict=True)]
