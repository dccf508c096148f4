"""Random scenes with sliders, rigid stops, contacts and belts in event_driven, against an integration written here.

`python tests/test_hunt_friction.py FIRST LAST` runs the scenes of many seeds and prints what it finds.
"""

from __future__ import annotations

import itertools
import random

import numpy as np
import pytest
from campaigns import campaign
from random_scenes import decades
from scipy.integrate import solve_ivp

import vofem as vf

#: Speeds below this share of the largest one so far are zero for the integration.
STILL = 1e-8


class LostError(Exception):
    """The integration cannot follow the motion."""


class Reference:
    """A plain integration from event to event, with statuses chosen by trying all of them.

    Statuses of contacts are 0 (open), 1 (closed) and 2 (pinned to a rigid stop), those of sliders 0 (stuck), 1 and -1.
    """

    def __init__(self, scene, shift=0.0, parts=100):
        self.parts = parts
        system = scene.model.system
        self.mass, self.stiffness = system.mass.toarray(), system.stiffness.toarray()
        self.damping = np.zeros_like(self.mass) if system.sparse_damping is None else system.sparse_damping.toarray()
        self.inverse, self.loads, self.laws = np.linalg.inv(self.mass), system.loads, system.contacts
        none = np.zeros((0, system.size))
        self.touches = none if self.laws is None else self.laws.rows.toarray()
        self.pads = () if system.sliders is None else system.sliders.laws
        self.slides = none if not self.pads else system.sliders.rows.toarray()
        start = scene.initial_state()
        self.n, self.t = system.size, 0.0
        self.q, self.v, self.z = start.q + shift, start.v.copy(), np.zeros(len(self.pads))
        self.touch, self.pad, self.fastest = np.zeros(len(self.touches), int), np.zeros(len(self.pads), int), 1e-3

    def slip(self, t, v):
        belts = [0.0 if pad.belt is None else float(pad.belt(t)) for pad in self.pads]
        return self.slides @ v - np.array(belts)

    def gap(self, q):
        return self.touches @ q - (0.0 if self.laws is None else self.laws.gap)

    def accelerations(self, t, q, v, z, touch, pad):
        """Return accelerations, and reactions of pinned stops and of rigidly stuck sliders (others are zero)."""
        force = -self.stiffness @ q - self.damping @ v
        for load in self.loads:
            force = force + load.vector * float(load.function(t))
        rows, wanted, who = [], [], []
        for j, row in enumerate(self.touches):
            if touch[j] == 1:
                depth = float(row @ q) - self.laws.gap[j]
                force = force - row * (self.laws.stiffness[j] * depth + self.laws.damping[j] * float(row @ v))
            elif touch[j] == 2:
                rows, wanted, who = [*rows, row], [*wanted, 0.0], [*who, j]
        for j, (row, law) in enumerate(zip(self.slides, self.pads, strict=True)):
            if pad[j]:
                force = force - row * pad[j] * law.limit
            elif np.isfinite(law.stiffness):
                force = force - row * law.stiffness * z[j]
            else:
                pull = 0.0 if law.belt is None else float(law.belt.derivative(t))
                rows, wanted, who = [*rows, row], [*wanted, pull], [*who, len(touch) + j]
        reactions = np.zeros(len(touch) + len(pad))
        if rows:
            held = np.array(rows)
            found = np.linalg.solve(held @ self.inverse @ held.T, held @ self.inverse @ force - np.array(wanted))
            reactions[who] = found
            force = force - held.T @ found
        return self.inverse @ force, reactions[: len(touch)], reactions[len(touch) :]

    def decide(self, known=None):
        """Choose statuses of what touches a rigid stop at rest and of rigid sliders at rest, given all others.

        `known` is the number of what leaves its stop or breaks away, and its status.
        """
        slip, rigid = self.slip(self.t, self.v), [j for j, law in enumerate(self.pads) if np.isinf(law.stiffness)]
        small = STILL * self.fastest
        choices = [[status] for status in (*self.touch, *self.pad)]
        rates = self.touches @ self.v
        for j in range(len(self.touch)):
            if self.laws.rigid[j]:
                at = abs(self.gap(self.q)[j]) <= STILL and abs(rates[j]) <= small
                choices[j] = [2, 0] if at else [0]
        for j in rigid:
            choices[len(self.touch) + j] = [0, 1, -1] if abs(slip[j]) <= small else [int(np.sign(slip[j]))]
        if known is not None:
            choices[known[0]] = [known[1]]
        best = None
        for trial in itertools.product(*choices):
            touch, pad = np.array(trial[: len(self.touch)], int), np.array(trial[len(self.touch) :], int)
            a, pushes, holds = self.accelerations(self.t, self.q, self.v, self.z, touch, pad)
            worst, scale = 0.0, 1e-9 * (1.0 + float(np.abs(a).max()))
            for j in range(len(self.touch)):
                if len(choices[j]) == 2:
                    worst = max(worst, -pushes[j] if touch[j] == 2 else float(self.touches[j] @ a))
            for j in rigid:
                law, options = self.pads[j], choices[len(self.touch) + j]
                if pad[j] == 0:
                    worst = max(worst, abs(holds[j]) - law.static)
                elif len(options) == 3:
                    pull = 0.0 if law.belt is None else float(law.belt.derivative(self.t))
                    worst = max(worst, -pad[j] * (float(self.slides[j] @ a) - pull))
            if worst <= scale:
                best = touch, pad
                break
            if best is None or worst < best[2]:
                best = touch, pad, worst
        if len(best) == 3 and best[2] > 1e-6:
            raise LostError("no status is admissible")
        self.touch, self.pad = best[0], best[1]

    def bounce(self):
        """Let impacts on rigid stops happen, the fastest first."""
        for _ in range(2000):
            rates = self.touches @ self.v
            at = [j for j in range(len(rates)) if self.laws.rigid[j] and abs(self.gap(self.q)[j]) <= STILL]
            hits = [j for j in at if rates[j] > STILL * self.fastest]
            if not hits:
                break
            j = max(hits, key=lambda k: rates[k])
            answer = self.inverse @ self.touches[j]
            back = self.laws.restitution[j] if rates[j] > 1e-7 * self.fastest else 0.0
            self.v = self.v - (1.0 + back) * rates[j] / (self.touches[j] @ answer) * answer
        else:
            raise LostError("impacts without end")
        for j in at:
            if abs(rates[j]) <= STILL * self.fastest:
                answer = self.inverse @ self.touches[j]
                self.v = self.v - rates[j] / (self.touches[j] @ answer) * answer

    def run(self, times, budget):
        """Return displacements at times, shape (n, k), as far as a number of segments reaches."""
        n, found = self.n, np.empty((self.n, 0))
        for j in range(len(self.touch)):
            if not self.laws.rigid[j]:
                self.touch[j] = int(self.gap(self.q)[j] > 0.0)
        self.bounce()
        self.decide()
        for _ in range(budget):
            touch, pad, events, kinds = self.touch.copy(), self.pad.copy(), [], []

            def rates(t, y, touch=touch, pad=pad):
                a, _, _ = self.accelerations(t, y[:n], y[n : 2 * n], y[2 * n :], touch, pad)
                soft = np.array([np.isfinite(law.stiffness) for law in self.pads], bool)
                free = np.where(soft & (pad == 0), self.slip(t, y[n : 2 * n]), 0.0) if len(pad) else np.zeros(0)
                return np.concatenate([y[n : 2 * n], a, free])

            def event(kind, j, value, direction, s=0, events=events, kinds=kinds):
                value.terminal, value.direction = True, direction
                events.append(value)
                kinds.append((kind, j, s))

            def holds(t, y, part, touch=touch, pad=pad):
                return self.accelerations(t, y[:n], y[n : 2 * n], y[2 * n :], touch, pad)[part]

            for j in range(len(touch)):
                if touch[j] == 2:
                    event("leave", j, lambda t, y, j=j: holds(t, y, 1)[j], -1)
                else:
                    event("touch", j, lambda t, y, j=j: self.gap(y[:n])[j], -1 if touch[j] else 1)
            for j, law in enumerate(self.pads):
                if pad[j]:
                    event("stop", j, lambda t, y, j=j, s=pad[j]: s * self.slip(t, y[n : 2 * n])[j], -1)
                    continue
                for s in (1, -1):
                    if np.isinf(law.stiffness):
                        event("break", j, lambda t, y, j=j, s=s: self.pads[j].static - s * holds(t, y, 2)[j], -1, s)
                    else:
                        spring = law.stiffness
                        event(
                            "yield", j, lambda t, y, j=j, s=s, k=spring: self.pads[j].static / k - s * y[2 * n + j], -1
                        )
            later = times[times > self.t] if self.t else times
            step = solve_ivp(
                rates, (self.t, times[-1]), np.concatenate([self.q, self.v, self.z]), method="DOP853", rtol=1e-11,
                atol=1e-13, events=events, t_eval=later, max_step=times[-1] / self.parts,
            )  # fmt: skip
            if len(step.t):
                found = np.concatenate([found, step.y[:n]], axis=1)
                self.fastest = max(self.fastest, float(np.abs(step.y[n : 2 * n]).max()))
            hits = [(at[0], k) for k, at in enumerate(step.t_events) if at.size]
            if not hits:
                break
            self.t, k = min(hits)
            y = step.y_events[k][0]
            self.q, self.v, self.z = y[:n].copy(), y[n : 2 * n].copy(), y[2 * n :].copy()
            self.fastest = max(self.fastest, float(np.abs(self.v).max()))
            kind, j, s = kinds[k]
            if kind == "touch" and not self.laws.rigid[j]:
                self.touch[j] = 1 - touch[j]
            elif kind == "touch":
                self.bounce()
                for i, law in enumerate(self.pads):
                    if np.isfinite(law.stiffness) and self.pad[i] * self.slip(self.t, self.v)[i] < 0.0:
                        self.pad[i] = 0
            elif kind == "yield":
                self.pad[j] = int(np.sign(self.z[j]))
                self.z[j] = self.pad[j] * self.pads[j].limit / self.pads[j].stiffness
            elif kind == "stop" and np.isfinite(self.pads[j].stiffness):
                self.pad[j] = 0
            self.decide({"break": (len(touch) + j, s), "leave": (j, 0)}.get(kind))
        return found


def scene_of(seed):
    """Return a random scene and the end of its run."""
    rng = random.Random(seed)
    if rng.random() < 0.8:
        bodies = [
            vf.Mass(
                decades(rng, -0.5, 0.5), stiffness=decades(rng, 0.5, 2), damping=rng.choice([0.0, 0.2]), name=f"m{k}"
            )
            for k in range(rng.choice([1, 2, 2, 3]))
        ]
        points, start = list(bodies), {body: (rng.uniform(-0.05, 0.05), rng.uniform(-1.0, 1.0)) for body in bodies}
        effects = [vf.Spring(a, b, stiffness=decades(rng, 0, 2)) for a, b in itertools.pairwise(bodies)]
    else:
        beam = vf.Beam(1.0, 1.0, 1.0, 2, {"left": "clamped"}, name="beam")
        bodies, points, start = [beam], [beam.at(1.0), beam.at(0.5)], None
        effects = [vf.RayleighDamping(0.1, 1e-3)] if rng.random() < 0.5 else []
    effects += [
        vf.PointLoad(rng.choice(points), vf.Sine(decades(rng, 0, 1), decades(rng, 0, 1), rng.uniform(0.0, 6.0)))
    ]
    for k, point in enumerate(rng.sample(points, rng.randint(0, len(points)))):
        normal, belt = decades(rng, -1, 0.7), rng.choice([None, None, 0.2, vf.Sine(0.3, 2.0), vf.Sine(0.2, 3.0) + 0.1])
        spring = rng.choice([None, None, decades(rng, 1.5, 3)])
        static = rng.choice([None, None, 0.7])
        effects.append(vf.Friction(point, coefficient=0.5, static=static, normal=normal, stiffness=spring, belt=belt,
                                   name=f"pad {k}"))  # fmt: skip
    for k, point in enumerate(rng.sample(points, rng.randint(0, min(2, len(points))))):
        gap, side = rng.uniform(0.05, 0.2), rng.choice(["above", "below"])
        if rng.random() < 0.6:
            effects.append(vf.RigidStop(point, gap=gap, side=side, restitution=rng.choice([0.0, 0.3, 0.7, 1.0]),
                                        name=f"stop {k}"))  # fmt: skip
        else:
            effects.append(vf.Contact(point, gap=gap, side=side, stiffness=decades(rng, 2, 4), name=f"stop {k}",
                                      damping=rng.choice([0.0, 2.0]), acts_on="penetration"))  # fmt: skip
    if len(points) > 1 and isinstance(bodies[0], vf.Mass) and rng.random() < 0.4:
        between = {"gap": 0.1, "restitution": rng.choice([0.0, 0.5, 1.0]), "name": "between"}
        effects.append(vf.RigidStop(points[0], points[1], **between))
    return vf.Scene(bodies, effects, initial=start), decades(rng, 0.3, 1.0)


def fault(seed, budget=250):
    """Return what is wrong with the run of a seed, or None."""
    scene, t_end = scene_of(seed)
    times = np.linspace(0.0, t_end, 61)
    result = vf.simulate(scene, t_end, method="event_driven", times=times)
    energy, faults, effects = result.energy, [], {effect.name: effect for effect in scene.effects}
    total = energy.kinetic + energy.strain + energy.contact + energy.dissipated - energy.work
    size = max(energy.kinetic.max(), energy.strain.max(), np.abs(energy.work).max(), 1e-300)
    off = float(np.abs(total - energy.start).max() / size)
    if off > 1e-10:
        faults.append(f"energies miss their balance by {off:.1e}")
    for name, pad in result.frictions.items():
        most = effects[name].normal.value * (effects[name].static or effects[name].coefficient)
        if np.abs(pad.force).max() > most * (1.0 + 1e-9):
            faults.append(f"{name} holds {np.abs(pad.force).max():g} N, more than {most:g} N")
        if np.diff(pad.dissipated).min() < -1e-10 * size:
            faults.append(f"{name} gives energy back")
    q = result.samples.q
    for name, contact in result.contacts.items():
        if isinstance(effects[name], vf.RigidStop) and contact.gap_function.max() > 1e-9:
            faults.append(f"{name} is {contact.gap_function.max():.1e} m deep")
    # What looks wrong is looked at again with steps between which less can be missed.
    off = difference(scene, times, q, budget, 100)
    if off and difference(scene, times, q, 10 * budget, 3000):
        faults.append(off)
    return faults or None


def difference(scene, times, q, budget, parts):
    """Return in words how a run differs from the integration; empty where it does not."""
    try:
        exact, other = (Reference(scene, shift, parts).run(times, budget) for shift in (0.0, 1e-9))
    except (LostError, np.linalg.LinAlgError):
        return ""
    count = min(exact.shape[1], other.shape[1])
    apart = np.abs(exact[:, :count] - other[:, :count]).max(axis=0, initial=0.0)
    good = np.maximum.accumulate(apart) <= 1e-6
    error = np.abs(exact[:, :count] - q[:, :count]).max(axis=0)
    allowed = 1e-7 * np.abs(q).max() + 100.0 * np.maximum.accumulate(apart)
    wrong = np.flatnonzero(good & (error > allowed))
    if not wrong.size:
        return ""
    k = int(wrong[0])
    return f"off by {error[k]:.1e} m at {times[k]:.4g} s, allowed {allowed[k]:.1e}, then {error[good][-1]:.1e}"


def look(seed):
    """Return what is wrong with a seed, and its effects."""
    found = fault(seed)
    return [*found, *(effect.describe() for effect in scene_of(seed)[0].effects)] if found else None


# Of the first seeds, those whose integration is quick; two are beams.
@pytest.mark.parametrize("seed", [1, 3, 5, 8, 10, 11, 16, 20, 21, 22, 27, 58, 63, 73045])
def test_random_scenes_with_sliders_and_stops(seed):
    assert not fault(seed)


if __name__ == "__main__":
    campaign(look)


@pytest.mark.parametrize("u0", [0.0, -1e-9])
def test_an_impact_at_the_start_turns_the_slider(u0: float) -> None:
    """A body that strikes its stop at t = 0 slides back at once, as it does if it strikes a moment later."""
    mass = vf.Mass(1.0, name="mass")
    stop = vf.RigidStop(mass, gap=0.0, restitution=0.5, side="above", name="stop")
    pad = vf.Friction(mass, coefficient=0.25, normal=1.0, name="pad")
    scene = vf.Scene([mass], [stop, pad], initial={mass: (u0, 1.0)})
    result = vf.simulate(scene, 3.0, times=[0.0, 1.0, 2.0, 3.0], method="event_driven")
    np.testing.assert_allclose(result.displacement(mass)[1:], [-0.375, -0.5, -0.5], atol=1e-8)
    assert result.energy.balance_error < 1e-12


def test_energies_where_a_stuck_slider_leaves_equal_frequencies_without_damping() -> None:
    """While the damped mass sticks, the others are equal oscillators, which lose nothing but by rounding."""
    first, damped, last = vf.Mass(1.0, stiffness=4.0), vf.Mass(1.0, damping=2.0), vf.Mass(1.0, stiffness=4.0)
    springs = [vf.Spring(first, damped, stiffness=4.0), vf.Spring(damped, last, stiffness=4.0)]
    pad = vf.Friction(damped, coefficient=0.25, normal=1.0, name="pad")
    scene = vf.Scene([first, damped, last], [*springs, pad], {first: (-1.0, -1.0), damped: (0.0, 1.0)})
    result = vf.simulate(scene, 20.0, method="event_driven")
    assert result.frictions["pad"].breaks.size > 2
    assert result.energy.balance_error < 1e-12


@pytest.mark.parametrize("gap", [0.0, 1e-9])
def test_a_slider_breaks_away_from_a_stop_at_which_the_bodies_rest_without_force(gap: float) -> None:
    """It holds the bodies at the stop until it breaks; the stop, which never pressed, has no part in that."""
    upper, lower = vf.Mass(1.0, stiffness=4.0, damping=4.0), vf.Mass(1.0, stiffness=1.0)
    stop = vf.RigidStop(lower, upper, gap=gap, restitution=0.0, name="stop")
    pad = vf.Friction(lower, upper, coefficient=0.25, static=0.5, normal=1.0, name="pad")
    scene = vf.Scene([lower, upper], [stop, pad, vf.PointLoad(lower, vf.Ramp(-1.0, 0.0, 2.0))])
    result = vf.simulate(scene, 3.0, times=[0.0, 2.0, 3.0], method="event_driven", max_events=100)
    np.testing.assert_allclose(result.frictions["pad"].breaks, 0.67045882, atol=1e-7)
    np.testing.assert_allclose(result.displacement(lower)[1:], [-0.74987784, -2.19311665], atol=1e-7)
    assert result.energy.balance_error < 1e-12


def test_a_slider_that_stops_pulls_a_body_off_its_stop_although_the_load_grows() -> None:
    """It pressed the body on the stop while it slid; once it sticks, both bodies move away together."""
    body, slide = vf.Mass(1.0, name="body"), vf.Mass(1.0, name="slide")
    stop = vf.RigidStop(body, gap=0.0, restitution=0.0, side="above", name="stop")
    pad = vf.Friction(body, slide, coefficient=0.5, normal=4.0, name="pad")
    loads = [vf.PointLoad(body, vf.Ramp(2.0, 0.0, 10.0)), vf.PointLoad(slide, vf.Constant(-1.0))]
    scene = vf.Scene([body, slide], [stop, pad, *loads], initial={slide: (0.0, 1.0)})
    t = np.array([0.0, 1.0 / 3.0, 0.5, 0.75])
    result = vf.simulate(scene, 0.8, times=t, method="event_driven")
    tau = np.maximum(t - 1.0 / 3.0, 0.0)
    np.testing.assert_allclose(result.displacement(body), -(tau**2) / 12.0 + tau**3 / 6.0, atol=1e-14)
    np.testing.assert_allclose(result.displacement(slide)[1:], 1.0 / 6.0 + result.displacement(body)[1:], atol=1e-14)
    assert result.energy.balance_error < 1e-13


@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_sliders_hold_bodies_beside_their_stops_until_these_must(restitution: float) -> None:
    """Two alike bodies touch their stops: the load is taken by friction up to 0.25 N, and by the stop beyond."""
    bodies = [vf.Mass(2.0, stiffness=4.0, name=f"body {k}") for k in range(2)]
    effects = [vf.Spring(*bodies, stiffness=4.0)]
    for k, body in enumerate(bodies):
        effects += [
            vf.Friction(body, coefficient=0.5, normal=0.5, name=f"pad {k}"),
            vf.RigidStop(body, gap=0.0, restitution=restitution, side="above", name=f"stop {k}"),
            vf.PointLoad(body, vf.Ramp(1.0, 0.0, 1.0)),
        ]
    result = vf.simulate(vf.Scene(bodies, effects), 2.0, times=[0.0, 0.125, 0.5, 2.0], method="event_driven")
    for k, body in enumerate(bodies):
        np.testing.assert_allclose(result.displacement(body), 0.0, atol=1e-15)
        np.testing.assert_allclose(result.frictions[f"pad {k}"].force, [0.0, 0.125, 0.25, 0.25], atol=1e-14)
        np.testing.assert_allclose(result.contacts[f"stop {k}"].force, [0.0, 0.0, 0.25, 0.75], atol=1e-14)


def test_bodies_that_sliders_stop_at_each_other_rest() -> None:
    """The stop between them is not needed, and its force not determined, where friction holds both bodies."""
    first, second = vf.Mass(2.0, name="first"), vf.Mass(1.0, name="second")
    stop = vf.RigidStop(first, second, gap=0.0, restitution=0.0, name="stop")
    pads = [vf.Friction(body, coefficient=0.5, normal=2.0, name=f"pad of {body.name}") for body in (first, second)]
    loads = [vf.PointLoad(first, vf.Ramp(-1.0, 0.0, 1.0) + vf.Constant(1.5))]
    scene = vf.Scene([first, second], [stop, *pads, *loads], initial={first: (0.0, 1.0), second: (0.0, 1.0)})
    result = vf.simulate(scene, 4.0, method="event_driven")
    np.testing.assert_allclose(result.displacement(first), result.displacement(second), atol=1e-14)
    assert result.velocity(second)[-1] == 0.0
    assert result.energy.dissipated[-1] == pytest.approx(result.energy.start + result.energy.work[-1], rel=1e-12)
