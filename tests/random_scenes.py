"""Random scenes out of a `random.Random`."""

import itertools

import numpy as np

import vofem as vf


def decades(rng, low, high):
    """Return a log-uniform number."""
    return 10.0 ** rng.uniform(low, high)


def time_function(rng, t_end, depth=1):
    """Return one of the named time functions, or a sum or multiple of them."""
    size = rng.choice([1.0, -1.0]) * decades(rng, -2, 1)
    kind = rng.randint(0, 8 if depth else 6)
    if kind == 0:
        return vf.Constant(size)
    if kind == 1:
        return vf.Sine(size, decades(rng, -1, 2) / t_end, rng.uniform(0.0, 6.0))
    if kind == 2:
        return vf.Ramp(size / t_end, rng.uniform(-0.5, 1.0) * t_end)
    if kind == 3:
        start = rng.uniform(-0.5, 1.0) * t_end
        return vf.Ramp(size / t_end, start, start + rng.uniform(0.05, 1.0) * t_end)
    if kind == 4:
        return vf.Pulse(size, rng.choice([0.0, rng.uniform(-0.2, 1.0) * t_end]), rng.uniform(0.05, 1.0) * t_end)
    if kind == 5:
        t = sorted(rng.uniform(-0.2, 1.2) * t_end for _ in range(6))
        return vf.Tabulated(np.unique(t), [size * rng.uniform(-1.0, 1.0) for _ in np.unique(t)])
    if kind == 6:
        return vf.Sine(size, 0.0, rng.uniform(0.0, 6.0)) if depth else vf.Constant(size)
    if kind == 7:
        return time_function(rng, t_end, 0) + time_function(rng, t_end, 0)
    return rng.uniform(-2.0, 2.0) * time_function(rng, t_end, 0)


def masses(rng):
    """Return a chain of masses with springs between some of them."""
    count, alike = rng.randint(1, 6), rng.random() < 0.15
    values = [
        (decades(rng, -1.5, 1.5), rng.choice([0.0, decades(rng, -3, 3)]), rng.choice([0.0, 0.0, decades(rng, -3, 1)]))
        for _ in range(1 if alike else count)
    ]
    bodies = [
        vf.Mass(mass, stiffness=stiffness, damping=damping, name=f"m{i}")
        for i, (mass, stiffness, damping) in enumerate(values * count if alike else values)
    ]
    springs = [
        vf.Spring(a, b, stiffness=decades(rng, -3, 3)) for a, b in itertools.pairwise(bodies) if rng.random() < 0.5
    ]
    return bodies, bodies, springs


SUPPORTS = ({"left": "clamped"}, {"left": "pinned", "right": "pinned"}, {}, {"left": "pinned"}, {"left": "guided"})
#: Polynomials that respect the supports.
SHAPES = dict(
    zip(
        (tuple(supports.values()) for supports in SUPPORTS),
        (
            lambda length: (0.0, 0.0, 1.0 / length**2),
            lambda length: (0.0, 4.0 / length, -4.0 / length**2),
            lambda length: (1.0, -0.7 / length),
            lambda length: (0.0, 1.0 / length),
            lambda length: (1.0,),
        ),
        strict=True,
    )
)


def beam(rng):
    """Return a beam with three points on it, and sometimes a mass beside it."""
    supports = rng.choice(SUPPORTS)
    body = vf.Beam(decades(rng, -0.5, 0.5), decades(rng, -2, 1), 1.0, rng.randint(1, 6), supports, name="beam")
    points = [body.at(body.length * rng.uniform(*part)) for part in ((0.1, 0.4), (0.6, 0.95))]
    points.append(body.at(body.length * (0.5 if "right" in supports else 1.0)))
    if rng.random() < 0.5:
        return [body], points, []
    mass = vf.Mass(decades(rng, -1, 1), stiffness=rng.choice([0.0, 1.0]), name="m0")
    return [body, mass], [*points, mass], []


def scene(rng):
    """Return a scene and its end time.

    1 to 6 masses or beam elements, 0 to 5 contacts under either law, stiffness of contacts 1e-3 to 1e9, gaps of
    any sign and zero (not negative under the displacement law), all dampers, loads with all named time functions.
    """
    bodies, points, effects = (masses if rng.random() < 0.6 else beam)(rng)
    t_end = decades(rng, -1, 1)
    reach = decades(rng, -2, 0) * t_end

    def pair():
        if len(points) == 1 or rng.random() < 0.5:
            return rng.choice(points), None
        return tuple(rng.sample(points, 2))

    for _ in range(rng.randint(0, 2)):
        a, b = pair()
        effects.append(vf.Spring(a, b, stiffness=decades(rng, -3, 3)))
    for _ in range(rng.choice([0, 0, 1, 2])):
        a, b = pair()
        effects.append(vf.Dashpot(a, b, damping=decades(rng, -3, 1)))
    if rng.random() < 0.25:
        effects.append(vf.RayleighDamping(rng.choice([0.0, 0.2]), rng.choice([0.0, 1e-3])))
    if rng.random() < 0.2:
        effects.append(vf.ModalDamping(rng.choice([0.01, 0.3])))
    for k in range(rng.randint(0, 5)):
        a, b = pair()
        law = rng.choice(["penetration", "penetration", "displacement"])
        gap = rng.choice([0.0, rng.uniform(0.0, reach), -rng.uniform(0.0, reach)])
        effects.append(
            vf.Contact(
                a,
                b,
                gap=abs(gap) if law == "displacement" else gap,
                stiffness=decades(rng, -3, 9),
                damping=rng.choice([0.0, 0.0, 0.0, decades(rng, -3, 2)]),
                side=rng.choice(["above", "below"]) if b is None else None,
                acts_on=law,
                name=f"c{k}",
            )
        )
    for _ in range(rng.randint(0, 2)):
        effects.append(vf.PointLoad(rng.choice(points), time_function(rng, t_end)))
    if rng.random() < 0.2:
        effects.append(vf.Gravity(rng.choice([1.0, 9.81])))
    initial = {}
    together = rng.random() < 0.15
    for body in bodies:
        if together and isinstance(body, vf.Mass):
            continue  # all at rest: what moves at all may move alike
        displacement, velocity = rng.choice([0.0, rng.uniform(-reach, reach)]), rng.uniform(-1.0, 1.0)
        if isinstance(body, vf.Mass):
            initial[body] = (displacement, velocity)
        elif rng.random() < 0.7:
            shape = SHAPES[tuple(body.supports.values())](body.length)
            initial[body] = (0.0, vf.Polynomial([velocity * a for a in shape]))
    return vf.Scene(bodies, effects, initial), t_end
