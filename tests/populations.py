"""Random but realistic scenes whose branches are followed from both ends, and what became of each branch.

`python tests/populations.py FIRST LAST` follows the branches of these seeds and prints a table. Every branch is to
reach the other end of its interval, to return to its own, or to close. Every orbit is to repeat under one ordinary run
over its period, and both directions are to list the same special points.
"""

import argparse
import collections
import itertools
import random
import re
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from random_scenes import decades

import vofem as vf
from vofem.errors import ConvergenceError, VofemError

#: Processor time of one branch, s.
PATIENCE = 60.0

#: Largest change of an orbit over its period, as a share of its motion, and largest difference of special points, as a
#: share of the larger end of the interval.
REPEATS = SAME = 1e-8

#: Orbits of a branch that are run.
SAMPLED = 8

#: Ends of beams: the supports, and where loads and stops may stand, as shares of the length.
FAMILIES = {
    "cantilever": ({"left": "clamped"}, (0.3, 1.0)),
    "simply supported": ({"left": "pinned", "right": "pinned"}, (0.15, 0.85)),
    "propped": ({"left": "clamped", "right": "pinned"}, (0.25, 0.85)),
    "built in": ({"left": "clamped", "right": "clamped"}, (0.25, 0.75)),
    "guided": ({"left": "clamped", "right": "guided"}, (0.3, 1.0)),
}


@dataclass
class Case:
    """A scene over the angular frequency of its load.

    Attributes
    ----------
    seed : int
    title : str
    law : str
        "penetration" or "displacement".
    beam : bool
        Whether the structure is a beam; otherwise it is a chain of masses.
    build : callable
        Returns the scene at an angular frequency, rad/s.
    start, stop : float
        Ends of the interval, rad/s.
    """

    seed: int
    title: str
    law: str
    beam: bool
    build: Callable[[float], vf.Scene]
    start: float
    stop: float

    @property
    def group(self):
        return f"{'beams' if self.beam else 'chains'}, {self.law}"


def strip(rng, units):
    """Return length, bending stiffness and mass per length of a beam in a system of units."""
    if units == "none":
        return 1.0, 1.0, 1.0
    long, wide, thick = rng.uniform(0.15, 0.6), rng.uniform(0.01, 0.04), rng.uniform(0.001, 0.006)
    stiffness, mass = 210e9 * wide * thick**3 / 12.0, 7850.0 * wide * thick
    # In mm, N and t the number of a bending stiffness is a million times as large, and that of rhoA a millionth.
    return (long, stiffness, mass) if units == "m" else (1e3 * long, 1e6 * stiffness, 1e-6 * mass)


def beam_of(rng):
    """Return a beam, its effects without stops and load, the points for load and stops, and a word for it."""
    family, units = rng.choice(list(FAMILIES)), rng.choice(["none", "m", "mm"])
    supports, (first, last) = FAMILIES[family]
    elements = rng.choice([1, 2, 3, 5, 10, 15, 20, 25])
    if family == "built in":
        elements = max(elements, 2)
    length, stiffness, mass = strip(rng, units)
    beam = vf.Beam(length, EI=stiffness, rhoA=mass, elements=elements, supports=supports, name="beam")
    free_end = last == 1.0
    load, *others = (
        beam.at(length * (1.0 if free_end and rng.random() < 0.5 else rng.uniform(first, last))) for _ in range(3)
    )
    points = [load if rng.random() < 0.5 else others[0], others[1]]
    return [beam], [], load, points, f"{family}, {elements} el., {units}"


def chain_of(rng):
    """Return the same for a chain of masses."""
    count = rng.randint(1, 5)
    size = decades(rng, -2, 2)
    masses = [vf.Mass(size * rng.uniform(0.5, 2.0), stiffness=0.0, name=f"m{k}") for k in range(count)]
    masses[0] = vf.Mass(size, stiffness=size * rng.uniform(0.5, 2.0), name="m0")
    springs = [vf.Spring(a, b, stiffness=size * rng.uniform(0.5, 2.0)) for a, b in itertools.pairwise(masses)]
    load, *points = (rng.choice(masses) for _ in range(3))
    return masses, springs, load, points, f"chain of {count}"


def compliance(bodies, effects, point, frequencies):
    """Return the modulus of the displacement of a point under the scene's load of 1, at angular frequencies."""
    found = vf.frequency_response(vf.Scene(bodies, effects), np.asarray(frequencies) / (2.0 * np.pi))
    return np.abs(found.displacement(point))


def drawn(seed):
    """Return the case of a seed."""
    rng = random.Random(seed)
    is_beam = rng.random() < 2.0 / 3.0
    bodies, effects, load, points, title = (beam_of if is_beam else chain_of)(rng)
    natural = vf.modes(vf.Scene(bodies, effects), 2).omega
    centre = float(natural[-1] if natural.size > 1 and rng.random() < 0.2 else natural[0])
    ratio = decades(rng, np.log10(0.005), np.log10(0.05))
    damping = vf.ModalDamping(ratio) if rng.random() < 0.6 else vf.RayleighDamping(ratio * centre, ratio / centre)
    start, stop = centre * rng.uniform(0.55, 0.85), centre * rng.uniform(1.2, 1.8)
    law = "displacement" if rng.random() < 1.0 / 6.0 else "penetration"
    two = rng.random() < 0.4
    symmetric = two and rng.random() < 0.5
    inside = np.append(np.linspace(start, stop, 801), natural[(natural > start) & (natural < stop)])
    unit = [*effects, damping, vf.PointLoad(load, vf.Sine(1.0, 1.0))]
    amplitude = decades(rng, -2, 2) / float(compliance(bodies, unit, load, [0.0])[0])
    if is_beam:
        amplitude *= 1e-3 * bodies[0].length

    def stop_at(point, side, name, share=None, times=None):
        share = decades(rng, -1, np.log10(0.95)) if share is None else share
        times = decades(rng, np.log10(0.5), 6) if times is None else times
        gap = share * amplitude * float(compliance(bodies, unit, point, inside).max())
        of_unit = [*effects, damping, vf.PointLoad(point, vf.Sine(1.0, 1.0))]
        static = 1.0 / float(compliance(bodies, of_unit, point, [0.0])[0])
        told = f"{side} at {share:.2f} peak, K0 {times:.2g} static"
        return (
            vf.Contact(point, gap=gap, stiffness=times * static, side=side, acts_on=law, name=name),
            share,
            times,
            told,
        )

    side, other = rng.sample(["above", "below"], 2)
    first, share, times, told = stop_at(points[0], side, "one")
    stops = [first]
    if symmetric:
        stops.append(stop_at(points[0], other, "two", share, times)[0])
        told += ", and its mirror image"
    elif two:
        stops.append(stop_at(rng.choice(points), other, "two")[0])
        told += ", and another"
    phase = rng.choice([0.0, 0.5 * np.pi])

    def build(omega):
        return vf.Scene(bodies, [*effects, damping, *stops, vf.PointLoad(load, vf.Sine(amplitude, omega, phase))])

    kind = "modal" if isinstance(damping, vf.ModalDamping) else "Rayleigh"
    title = f"{title}; {law}; {told}; {kind} {100 * ratio:.1f} %"
    return Case(seed, title, law, is_beam, build, start, stop)


def varied(seed):
    """Return a case with what `drawn` does not draw.

    These are rigid stops, contacts between bodies, contact dampers, preloads, friction, dashpots and several loads.
    """
    rng = random.Random(f"varied {seed}")
    is_beam = rng.random() < 0.5
    bodies, effects, load, points, title = (beam_of if is_beam else chain_of)(rng)
    omega = float(vf.modes(vf.Scene(bodies, effects), 1).omega[0])
    point = points[0]

    def stiffness_at(where):
        unit = [*effects, vf.PointLoad(where, vf.Sine(1.0, 1.0))]
        return 1.0 / float(compliance(bodies, unit, where, [0.0])[0])

    static, told = stiffness_at(point), []
    other = vf.Mass(rng.uniform(0.2, 2.0) * static / omega**2, stiffness=static * rng.uniform(0.1, 2.0), name="other")
    ratio, beside = decades(rng, np.log10(0.005), np.log10(0.05)), rng.random() < 0.6
    if beside:
        bodies = [*bodies, other]
    if beside and rng.random() < 0.5:
        effects.append(vf.Spring(point, other, stiffness=static * rng.uniform(0.05, 0.5)))
    if rng.random() < 0.3:
        effects.append(vf.Dashpot(point, damping=0.1 * static / omega * rng.random()))
        told.append("a dashpot")
    damping = vf.ModalDamping(ratio) if rng.random() < 0.5 else vf.RayleighDamping(ratio * omega, ratio / omega)
    unit = [*effects, damping, vf.PointLoad(load, vf.Sine(1.0, 1.0))]
    start, stop = omega * rng.uniform(0.55, 0.85), omega * rng.uniform(1.2, 1.8)
    size = decades(rng, -2, 2) * (1e-3 * bodies[0].length if is_beam else 1.0)
    amplitude = size / float(compliance(bodies, unit, load, [0.0])[0])
    inside = np.linspace(start, stop, 801)
    peak = amplitude * float(compliance(bodies, unit, point, inside).max())
    stops = []
    for name in rng.choice([("one",), ("one", "two")]):
        gap = peak * decades(rng, -1, np.log10(0.95))
        between = beside and rng.random() < 0.5
        pair = {"a": other, "b": point} if between else {"a": point, "side": rng.choice(["above", "below"])}
        if rng.random() < 0.35:
            stops.append(vf.RigidStop(**pair, gap=gap, restitution=rng.choice([0.0, 0.2, 0.5, 0.8]), name=name))
            told.append(f"{name} rigid, e {stops[-1].restitution:g}")
        else:
            gap *= rng.choice([1.0, 1.0, 1.0, -0.3])
            hard = static * decades(rng, np.log10(0.5), 4)
            lossy = rng.choice([0.0, 2.0 * rng.random() * ratio * hard / omega])
            one = vf.Contact(**pair, gap=gap, stiffness=hard, damping=lossy, acts_on="penetration", name=name)
            stops.append(one)
            told.append(f"{name} at {gap / peak:.2f} peak, K0 {hard / static:.2g} static{', lossy' if lossy else ''}")
        told[-1] += " between bodies" if between else ""
    if rng.random() < 0.25 and not any(isinstance(one, vf.RigidStop) for one in stops):
        stick = vf.Friction(
            point,
            coefficient=0.3,
            normal=amplitude * decades(rng, -1, 0.5),
            stiffness=static * decades(rng, 0, 2),
            name="slider",
        )
        stops.append(stick)
        told.append("a slider behind a spring")
    phase, more = rng.choice([0.0, 0.5 * np.pi]), list[tuple[float, int]]()
    if rng.random() < 0.4:
        more.append((amplitude * rng.uniform(0.1, 1.0), rng.choice([2, 3])))
        told.append(f"a load at {more[0][1]} times the frequency")
    if rng.random() < 0.4:
        stops.append(vf.PointLoad(load, vf.Constant(amplitude * rng.uniform(-1.0, 1.0)), name="weight"))
        told.append("a weight")

    def build(at):
        loads = [vf.PointLoad(load, vf.Sine(amplitude, at, phase), name="load")]
        loads += [vf.PointLoad(point, vf.Sine(f, times * at), name="fast") for f, times in more]
        return vf.Scene(bodies, [*effects, damping, *stops, *loads])

    kind = "modal" if isinstance(damping, vf.ModalDamping) else "Rayleigh"
    title = f"{title}{' and a mass' if beside else ''}; {', '.join(told)}; {kind} {100 * ratio:.1f} %"
    return Case(seed, title, "varied", is_beam, build, start, stop)


@dataclass
class Outcome:
    """What became of a branch.

    Attributes
    ----------
    end : str
        "other end", "own end", "closed", "limit" for one of time or points, "lost", "no start", "error".
    reason : str
        The last note or the error.
    orbits : int
    seconds : float
        Processor time.
    special : list of (str, float)
        Kinds and values of the special points.
    away : list of float
        Changes of sampled orbits over their period, in terms of the motion.
    """

    end: str
    reason: str = ""
    orbits: int = 0
    seconds: float = 0.0
    special: list[tuple[str, float]] = field(default_factory=list)
    away: list[float] = field(default_factory=list)

    @property
    def arrived(self):
        return self.end in ("other end", "own end", "closed")


class OutOfTimeError(Exception):
    """A branch did not even stop when it was asked to."""


def _pressed(limit):
    """Press Ctrl-C after some processor time, which ends a branch with a note, and raise where it does not end."""
    presses = itertools.count()

    def ring(*_: Any) -> None:
        if next(presses):
            raise OutOfTimeError
        signal.raise_signal(signal.SIGINT)

    signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, limit, 0.5 * limit)


def followed(case, start, stop, patience=PATIENCE):
    """Return the outcome of following a case from one value to another; `patience` in s of processor time."""
    begun = time.process_time()
    try:
        _pressed(patience)
        branch = vf.continuation(case.build, start, stop)
    except (OutOfTimeError, KeyboardInterrupt, SystemError) as error:
        # Where the clock rings while numba reads arguments, Python tells of a SystemError that it has caused.
        cause: BaseException | None = error
        while isinstance(cause, SystemError):
            cause = cause.__cause__
        if cause is None:
            raise
        return Outcome("limit", "time", seconds=time.process_time() - begun)
    except ConvergenceError as error:
        kind = "no start" if "no orbit was found" in str(error) else "error"
        return Outcome(kind, str(error), seconds=time.process_time() - begun)
    except (VofemError, ArithmeticError, ValueError, LookupError, AssertionError) as error:
        return Outcome("error", f"{type(error).__name__}: {error}", seconds=time.process_time() - begun)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    found = Outcome(*end_of(branch, start, stop), orbits=len(branch), seconds=time.process_time() - begun)
    found.special = [(point.kind, float(point.value)) for point in branch.special]
    which = np.unique(np.linspace(0, len(branch) - 1, SAMPLED).round().astype(int))
    # Harmonics miss a motion by more, and say by how much.
    found.away = [away(branch.orbits[k]) for k in which.tolist() if branch.orbits[k].method == "shooting"]
    return found


def end_of(branch, start, stop):
    """Return how a branch ended, and its last note."""
    note = branch.notes[-1] if branch.notes else ""
    last = float(branch.values[-1])
    if last == stop:
        return "other end", ""
    if last == start and len(branch) > 1:
        return ("lost", note) if "came back along its own orbits" in note else ("own end", "")
    if any("is closed: it has come back" in text for text in branch.notes):
        return "closed", ""
    limits = ("interrupted", "max_points", "limit")
    return "limit" if any(word in note for word in limits) else "lost", note


def away(orbit):
    """Return the change of an orbit's state over one ordinary run of its period, over the size of the motion."""
    scene, times = orbit.scene, np.linspace(0.0, orbit.period, 101)
    try:
        run = vf.simulate(scene, orbit.period, initial=orbit, times=times, method="event_driven", progress=False)
    except VofemError:
        return np.inf
    mass = scene.model.system.mass
    q, v = (run.solution.sample(times).along(_every(scene), kind) for kind in "qv")
    sizes = [np.sqrt(np.max(np.einsum("it,it->t", x, mass @ x))) for x in (q, v)]
    changes = [np.sqrt((x[:, -1] - x[:, 0]) @ (mass @ (x[:, -1] - x[:, 0]))) for x in (q, v)]
    return max(float(change / size) for change, size in zip(changes, sizes, strict=True))


def _every(scene):
    from scipy.sparse import identity

    return identity(scene.model.system.size, format="csr")


def differing(case, one, other):
    """Return the difference of the special points of two outcomes, over the end of the interval; inf without match."""
    size = max(abs(case.start), abs(case.stop))
    if collections.Counter(k for k, _ in one.special) != collections.Counter(k for k, _ in other.special):
        return np.inf
    pairs = zip(sorted(one.special), sorted(other.special), strict=True)
    return max((abs(a - b) / size for (_, a), (_, b) in pairs), default=0.0)


def both_ways(case, patience=PATIENCE):
    """Return the outcomes from the lower and from the upper end."""
    return followed(case, case.start, case.stop, patience), followed(case, case.stop, case.start, patience)


def told(found):
    """Return an outcome in a few words."""
    worst = max(found.away, default=0.0)
    return f"{found.end} ({found.orbits} orbits, {len(found.special)} special, {found.seconds:.1f} s, {worst:.0e})"


def campaign(first, last, patience=PATIENCE, draw=drawn):
    """Print a line for each seed, and the shares of branches that arrived, orbits that repeat and lists that agree."""
    ends: dict[str, collections.Counter[str]] = {}
    reasons: collections.Counter[str] = collections.Counter()
    totals: collections.Counter[str] = collections.Counter()
    print("| seed | scene | upwards | downwards | special points differ by |\n| --- | --- | --- | --- | --- |")
    for seed in range(first, last + 1):
        case = draw(seed)
        found = both_ways(case, patience)
        arrived = all(one.end == "other end" for one in found)
        apart = differing(case, *found) if arrived else None
        shown = "" if apart is None else f"{apart:.0e}"
        print(f"| {seed} | {case.title} | {' | '.join(map(told, found))} | {shown} |", flush=True)
        for one in found:
            ends.setdefault(case.group, collections.Counter())[one.end] += 1
            totals.update(orbits=len(one.away), false=sum(not change <= REPEATS for change in one.away))
            totals["seconds"] += one.seconds
            if one.reason:
                print(f"|  | {one.reason} |  |  |  |", flush=True)
                reasons[re.sub(r"[-+]?\d[\d.e+-]*", "#", one.reason)[:100]] += 1
        if apart is not None:
            totals.update(compared=1, unequal=int(not apart <= SAME))
    print("\n| branches | all | arrive | " + " | ".join(KINDS) + " |\n" + "| --- " * (3 + len(KINDS)) + "|")
    for group, count in sorted(ends.items()):
        good, every = sum(count[kind] for kind in KINDS[:3]), sum(count.values())
        print(f"| {group} | {every} | {100 * good / every:.0f} % | " + " | ".join(str(count[k]) for k in KINDS) + " |")
    print(
        f"\n{totals['false']} of {totals['orbits']} orbits do not repeat to {REPEATS:g}; {totals['unequal']} of ",
        end="",
    )
    print(f"{totals['compared']} scenes differ in their special points; {totals['seconds']:.0f} s of processor time")
    for reason, count in reasons.most_common():
        print(f"{count:4d}  {reason}")


#: How branches end: those that arrive first.
KINDS = ("other end", "own end", "closed", "limit", "lost", "no start", "error")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("last", type=int)
    parser.add_argument("--patience", type=float, default=PATIENCE, help="processor time of a branch in s")
    parser.add_argument("--varied", action="store_true", help="scenes with other stops, friction and loads")
    given = parser.parse_args()
    # Kernels are compiled before time counts.
    for case in map(drawn, (1, 31)):
        vf.continuation(case.build, case.start, case.stop, max_points=30)
    campaign(given.first, given.last, given.patience, varied if given.varied else drawn)


if __name__ == "__main__":
    main()
