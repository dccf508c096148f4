"""The data of a run or of an equilibrium at one time that a picture needs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vofem._validate import number
from vofem.bodies import Beam
from vofem.bodies.base import Body, Point
from vofem.bodies.path import place_at
from vofem.effects import (
    CrushingStop,
    Foundation,
    Joint,
    PointMass,
    RotationalSpring,
)
from vofem.effects.two_points import TwoPoints
from vofem.errors import ArgumentError
from vofem.io.pictures.pushes import Push, pushes
from vofem.result import Result
from vofem.scene import Scene
from vofem.statics import Equilibrium
from vofem.system import CLOSED, OPEN, PINNED

Array = NDArray[np.float64]

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
    """Return the data that a picture of one time needs.

    Ranges are those of the whole run, so that pictures of one run at several
    times have one magnification and one scale of colours.

    Parameters
    ----------
    outcome : Result or Equilibrium
    t : float
        Time in s, within the run; not used for an equilibrium.
    scene : Scene, optional
        The scene. It is needed for an equilibrium, which has no reference to its scene.
    """
    if isinstance(outcome, Equilibrium):
        if scene is None:
            raise ArgumentError("a picture of an equilibrium needs scene=, the Scene that it is the equilibrium of")
        states = {name: (c.status, c.force) for name, c in outcome.contacts.items()}
        bodies = tuple(_at_rest(outcome, body) for body in scene.bodies)
        peak = max((abs(force) for _, force in states.values()), default=0.0)
        return Snapshot(None, bodies, _links(scene, states), _joints(scene), peak, weights=_weights(scene))
    if not isinstance(outcome, Result):
        raise ArgumentError(f"expected the outcome of simulate or equilibrium, found {outcome!r}")
    return snapshots(outcome, np.array([number("the time of a picture", t)]))[0]


def snapshots(result: Result, times: Array) -> list[Snapshot]:
    """Return the data that pictures of a run at several times need, with the ranges of the whole run.

    `times` (shape (n_times,)): times in s, within the run.
    """
    bodies = [_in_motion(result, body, times) for body in result.scene.bodies]
    contacts, peak = _contact_states(result, times)
    scene, joints = result.scene, _joints(result.scene)
    loads = pushes(scene, result.t_start + times, result.t_start + _times_of_range(result))
    return [
        Snapshot(
            float(t), tuple(states[k] for states in bodies),
            _links(scene, contacts[k] | _crushed(result, float(t)), result.t_start + float(t)), joints, peak, "",
            loads[k], _weights(scene, result.t_start + float(t)),
        )
        for k, t in enumerate(times)
    ]  # fmt: skip


def fixed_parts(scene: Scene) -> Snapshot:
    """Return springs, dashpots, point masses and joints of a scene at rest, without bodies, contacts and loads."""
    laws = scene.model.system.contacts
    states = {} if laws is None else dict.fromkeys(laws.names, ("open", 0.0))
    links = tuple(link for link in _links(scene, states) if link.status in ("spring", "damper"))
    return Snapshot(None, (), links, _joints(scene), weights=_weights(scene))


def at_rest(scene: Scene) -> Snapshot:
    """Return a scene before anything has moved, contacts open."""
    laws = scene.model.system.contacts
    states = {} if laws is None else dict.fromkeys(laws.names, ("open", 0.0))
    bodies = []
    for body in scene.bodies:
        if isinstance(body, Beam):
            x = np.linspace(body.nodes[0], body.nodes[-1], _POINTS + 1)
            bodies += _beam(body, x, np.zeros((x.size, 1)), np.zeros((x.size, 1)))
        else:
            bodies += _plain(body, np.zeros((body.shape.x.size, 1)))
    return Snapshot(
        None, tuple(bodies), _links(scene, states), _joints(scene), title="at rest", weights=_weights(scene)
    )


def _weights(scene: Scene, t: float = 0.0) -> tuple[Point, ...]:
    points = (place_at(effect.point, t) for effect in scene.effects if isinstance(effect, PointMass))
    return tuple(point for point in points if point is not None)


def _crushed(result: Result, t: float) -> dict[str, tuple[str, float]]:
    """Return status and force of crushing stops at the stored time that is nearest to t."""
    nearest = int(np.argmin(np.abs(result.times - t)))
    forces = {
        effect.name: float(result.springs[effect.name].force[nearest])
        for effect in result.scene.effects
        if isinstance(effect, CrushingStop)
    }
    return {name: ("closed" if force > 0.0 else "open", force) for name, force in forces.items()}


def _joints(scene: Scene) -> tuple[Joint, ...]:
    return tuple(effect for effect in scene.effects if isinstance(effect, Joint))


def _contact_states(result: Result, times: Array) -> tuple[list[dict[str, tuple[str, float]]], float]:
    """Return status and force of all contacts at some times, and the largest force of the run."""
    laws = result.model.system.contacts
    if laws is None:
        return [{} for _ in times], 0.0
    every = np.concatenate([times, _times_of_range(result)])
    samples = result.solution.contacts(every)
    names = {OPEN: "open", CLOSED: "closed", PINNED: "pinned"}
    states = [
        {name: (names[int(samples.status[j, k])], float(samples.force[j, k])) for j, name in enumerate(laws.names)}
        for k in range(times.size)
    ]
    return states, float(np.max(np.abs(samples.force), initial=0.0))


def _links(scene: Scene, states: dict[str, tuple[str, float]], t: float = 0.0) -> tuple[Link, ...]:
    """Return contacts with their status and force, springs and dashpots; what travels is where it is at t in s."""
    stops = [*scene.contacts, *(effect for effect in scene.effects if isinstance(effect, CrushingStop))]
    links = []
    for s in stops:
        turns = s.of == "rotation"
        status = states.get(s.name, ("open", 0.0))
        links.append(Link(s.name, s.a, s.b, s.side or "below", 0.0 if turns else s.gap, *status, turns))
    beds = [effect for effect in scene.effects if isinstance(effect, Foundation)]
    links += [
        Link(name, bed.beam.at(float(x)), None, "below", bed.gap, *states[name])
        for bed in beds
        if bed.one_sided
        for node, x in enumerate(bed.beam.nodes)
        if (name := f"{bed.name}[{node}]") in states
    ]
    for effect in scene.effects:
        if isinstance(effect, TwoPoints) and effect.symbol in ("spring", "damper"):
            links.append(Link("", effect.a, effect.b, "below", 0.0, effect.symbol, 0.0, effect.of == "rotation"))
        elif isinstance(effect, RotationalSpring):
            links.append(Link("", effect.point, effect.other, "below", 0.0, "spring", 0.0, True))
    for bed in beds:
        if not bed.one_sided:
            nodes, held = bed.beam.nodes, [bed.beam.nodes[node] for node in bed.beam.supports]
            places = np.linspace(nodes[0], nodes[-1], min(nodes.size, _BED))
            points = [bed.beam.at(float(x)) for x in places if not np.any(np.isclose(x, held))]
            links += [Link("", point, None, "below", 0.0, "spring", 0.0) for point in points]
    placed = [replace(link, a=place_at(link.a, t), b=place_at(link.b, t)) for link in links]
    return tuple(
        new for new, old in zip(placed, links, strict=True) if new.a is not None and (new.b is None) is (old.b is None)
    )


def _at_rest(outcome: Equilibrium, body: Body) -> BodyState:
    if not isinstance(body, Beam):
        return _plain(body, np.asarray(body.shape.rows @ outcome.state_of(body.name)[0])[:, None])[0]
    x, eta, moment = _sampled(
        body, lambda x: outcome.deflection(x, body)[:, None], lambda x: outcome.bending_moment(x, body)[:, None]
    )
    return _beam(body, x, eta, moment)[0]


def _in_motion(result: Result, body: Body, times: Array) -> list[BodyState]:
    """Return a body at some times."""
    # The pictures' own times come first, then the run.
    every = np.concatenate([times, _times_of_range(result)])
    if not isinstance(body, Beam):
        return _plain(body, result.along_shape(body, every), times.size)
    x, eta, moment = _sampled(
        body, lambda x: result.deflection(x, every, body), lambda x: result.bending_moment(x, every, body)
    )
    return _beam(body, x, eta, moment, times.size)


def _times_of_range(result: Result) -> Array:
    """Return times spread over the run. A stepping method has results only at the times that it has stored."""
    # Its last step may reach beyond the end of the run, where there are no results.
    stored = result.times[result.times <= result.solution.t_end]
    if result.solution.continuous:
        return np.linspace(0.0, float(stored[-1]), _TIMES)
    return stored[np.unique(np.linspace(0, stored.size - 1, _TIMES).round().astype(int))]


def _sampled(
    beam: Beam, deflection: Callable[[Array], Array], bending_moment: Callable[[Array], Array]
) -> tuple[Array, Array, Array]:
    """Return x (k,), eta (k, n_times) and M (k, n_times) along a beam.

    The moment of cubic elements jumps from one to the next by the error of
    discretisation; at a node the mean of both sides is drawn. Where a support
    takes up a moment the jump is real: x occurs twice there.
    """
    count = beam.element_lengths.size
    if count > 2 * _POINTS:
        x = np.linspace(beam.nodes[0], beam.nodes[-1], _POINTS + 1)
        return x, deflection(x), bending_moment(x)
    each = max(4, -(-_POINTS // count))
    inside = np.arange(each) / each
    x = np.append((beam.nodes[:-1, None] + inside * beam.element_lengths[:, None]).ravel(), beam.nodes[-1])
    moment = bending_moment(x)
    inner = np.arange(1, count)
    before = bending_moment(x[inner * each] - 1e-6 * beam.element_lengths[:-1])
    jumps = np.array([beam.supports.get(node, "pinned") != "pinned" for node in inner.tolist()], dtype=bool)
    smooth = inner[~jumps] * each
    moment[smooth] = 0.5 * (moment[smooth] + before[~jumps])
    moment = np.insert(moment, inner[jumps] * each, before[jumps], axis=0)
    x = np.insert(x, inner[jumps] * each, x[inner[jumps] * each])
    return x, deflection(x), moment


def _beam(beam: Beam, x: Array, eta: Array, moment: Array, count: int = 1) -> list[BodyState]:
    """Return a beam at the first `count` of the times of eta and moment, each (k, n_times), with the ranges of all."""
    # A section of constant width has EI in proportion to the cube of its depth.
    depth = np.cbrt(beam.bending_stiffness(x)[0])
    depth = np.clip(depth / depth.max(), 0.3, 1.0)
    ranges = [float(of(part, initial=0.0)) for part in (eta, moment) for of in (np.min, np.max)]
    return [BodyState(beam, x, eta[:, k], moment[:, k], depth, *ranges) for k in range(count)]


def _plain(body: Body, u: Array, count: int = 1) -> list[BodyState]:
    """Return a body without bending moments, from the displacement of its places, shape (k, n_times)."""
    x, low, high = body.shape.x, float(np.min(u, initial=0.0)), float(np.max(u, initial=0.0))
    nothing, depth = np.zeros(x.size), np.ones(x.size)
    return [BodyState(body, x, u[:, k], nothing, depth, low, high, 0.0, 0.0) for k in range(count)]
