"""Random scenes against an independent integration: nothing missed, nothing found that is not there.

`python tests/test_random_scenes.py FIRST LAST` checks the scenes of many seeds and prints what it finds.
"""

import random

import numpy as np
import pytest
from campaigns import campaign
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from random_scenes import scene as random_scene
from reference_integration import Reference

import vofem as vf

#: Beyond so many events a run is cut short.
MOST_EVENTS = 2_000


def faults(scene, t_end, budget=40_000):
    """Return what is wrong with the event-driven run of a scene, as a list of strings.

    Energy balances to 1e-10, whatever the number of events, the force that
    jumps at them and the energy that pinning takes. Where dampers couple the
    modes it is 1e-9: roots of such a status are known to the rounding of its
    quickest rate, which beside a slow decay (a free mass on a weak dashpot) is
    more. One scene in 1500 needs it.
    """
    for _ in range(8):
        try:
            result = vf.simulate(scene, t_end, times=np.linspace(0.0, t_end, 201), max_events=MOST_EVENTS)
            break
        except vf.EventStormError:
            t_end /= 4.0  # a stiff contact that rattles all the time
    else:
        return ["storm of events"]
    found = []
    pins = [c.pinned[0, 0] for c in result.contacts.values() if c.pinned.size]
    laws = scene.model.system.contacts
    largest = np.max(np.abs(result.samples.q), axis=1)
    system = scene.model.system
    # Damping that is diagonal in the modes of the open structure couples those of closed contacts.
    uniform = system.modal_damping is None and (system.rayleigh is None or not system.rayleigh[1])
    coupled = system.damping is not None or (laws is not None and (bool(np.any(laws.damping > 0)) or not uniform))
    allowed = 1e-9 if coupled else 1e-10
    if not result.energy.balance_error <= allowed:
        found.append(f"energy balance {result.energy.balance_error:.1e}, allowed {allowed:.1e}")
    for contact in result.contacts.values():
        law = laws.names.index(contact.name)
        if np.any(contact.force[~contact.closed & ~np.isnan(contact.order)] != 0.0):
            found.append(f"force of {contact.name} while open")
        size = (abs(laws.rows) @ largest)[law] + abs(laws.gap[law])
        # Where the rest moves quickly, a slow motion is known to the rounding of that only.
        rounding = 1e-13 * t_end * np.max(np.abs(result.samples.v))
        if not laws.damping[law] and np.min(contact.force) < -(1e-12 * size + rounding) * laws.stiffness[law]:
            found.append(f"force of {contact.name} is {np.min(contact.force):.1e}")
        wrong = np.where(contact.closed, -contact.gap_function, contact.gap_function)[~np.isnan(contact.order)]
        if wrong.size and np.max(wrong) > 1e-11 * size + rounding:
            found.append(f"gap of {contact.name} by {np.max(wrong) / size:.1e}")
    reference = Reference(scene, t_end).run(budget=budget)
    # Rounding of both runs, amplified: M^-1 K alone spoils the velocity by eps omega^2 q a step.
    # Every event adds the rounding of the matrices again, since its time depends on it.
    error = 1e-11 * max(1.0, reference.quickest * t_end / 1e4, len(result.solution.events.time) / 20.0)
    limit = min([reference.until, *pins, result.solution.sensitivity.horizon(1e-7, error)])
    kept = np.array(reference.times) <= limit
    if np.any(kept):
        times = np.array(reference.times)[kept]
        # Many of these times are events, where velocities may change by all of their size within 1e-6 s. So a value
        # counts as right if the run takes it within a small uncertainty of the time: where a contact closes slowly,
        # that is the time in which it moves by rounding.
        doubt = np.full(times.size, 1e-10 * t_end)
        for event in reference.events:
            moved = 1e-10 * (np.sum(np.abs(laws.rows[event.contact]) @ largest) + abs(laws.gap[event.contact]))
            doubt[times == event.time] += moved / event.rate
        around = [result.solution.sample(np.clip(times + s * doubt, 0.0, t_end)) for s in (-1.0, 0.0, 1.0)]
        swing = largest.max() + 1e-30
        for name, got, exact, size in (
            ("displacement", [s.q for s in around], reference.q, swing),
            (
                "velocity", [s.v for s in around], reference.v,
                np.max(np.abs(result.samples.v)) + 1e-6 * reference.quickest * swing,
            ),
        ):  # fmt: skip
            exact = np.array(exact)[kept].T
            worst = max(np.max(np.min(got, axis=0) - exact), np.max(exact - np.max(got, axis=0))) / size
            if worst > 1e-6:
                found.append(f"{name} off by {worst:.1e}")
    fast = np.max(np.abs(result.samples.v), axis=1)
    for j, name in enumerate(() if laws is None else laws.names):
        contact = result.contacts[name]
        ours = np.sort(np.concatenate([contact.closings[contact.closings > 0], contact.openings]))
        # Events at a speed that is rounding are no matter, also of what moves more quickly: their forces are too.
        fastest = max((abs(laws.rows) @ fast)[j], np.max(fast)) + 1e-300
        speeds = np.abs((laws.rows @ result.solution.sample(ours).v)[j]) if ours.size else ours
        theirs = [event for event in reference.events if event.contact == j and event.rate > 1e-11 * fastest]
        size = np.max(np.abs(result.samples.q)) + abs(laws.gap[j])
        slack = [1e-8 * t_end + 1e-9 * size / max(event.rate, 1e-300) for event in theirs]
        # From rest at the gap a contact closes without speed; the reference sees it later, at some speed.
        met = [np.any(np.abs(time - np.array([e.time for e in theirs])) <= np.array(slack)) for time in ours]
        matters = speeds > 1e-11 * fastest
        # Neither are a closing and an opening between which the contact moves by rounding.
        brief = np.flatnonzero(np.diff(ours) * np.maximum(speeds[1:], speeds[:-1]) <= 1e-15 * size)
        matters[brief] = matters[brief + 1] = False
        ours = ours[matters | np.array(met, dtype=bool)]
        clear = [event.time for event, s in zip(theirs, slack, strict=True) if event.time + s < limit]
        count = int(np.sum(ours < limit))
        if len(clear) > count or int(np.sum(ours < limit - max(slack, default=0.0) - 1e-8 * t_end)) > len(theirs):
            found.append(f"{name}: {count} events, expected {len(clear)}, until {limit:.6g} s")
            continue
        for time, event, s in zip(ours, theirs, slack, strict=False):
            if event.time < limit - s and abs(time - event.time) > s:
                found.append(f"{name}: event at {time!r}, expected {event.time!r}")
                break
    return found


# A seed says everything and does not shrink; the campaign below runs through many.
@settings(max_examples=24, phases=[Phase.explicit, Phase.generate])
@given(st.integers(0, 2**32 - 1))
def test_random_scenes_against_an_independent_integration(seed):
    scene, t_end = random_scene(random.Random(seed))
    assert not faults(scene, t_end, budget=8_000), vf.explain(scene)


# What campaigns have found: rounding in one part that set off events in another (6317, 1500), rattling on rounding
# (100536, 101044), masses that begin to move together and took millions of steps (100559, 101131), rigid motions on
# weak dashpots that were refused (100065, 100898, 101378), equal decays that divided by zero (100283), work of a
# jumping force in the rounding of its gap (101344, 100844), energy lost in pinning (100601), many events (5772), and
# openings of a contact between two points of a beam that drifts on dashpots, all missed: 4e-13 m deep they were taken
# for rounding of the drift (300139). A mode whose decay rate is rounding, beside what a damper takes from it (34).
# A load that begins to grow on bodies at rest that touch, whose search did not end (9300146). A mass that was pinned
# beside a damper, when no motion is left (20003579).
# Of the reference: a soft mode that it took for a rigid motion (7000545), and a closing from rest (7000465); a contact
# that closed again soon after it had opened (20000033), and one that closed from rest and opened (20000564).
# Of the comparison: velocities at an impact whose time is uncertain (20000103), and a contact that closed and opened
# within 3e-17 m (20001422), and a slow motion beside a mass that is thrown (20002741).
@pytest.mark.parametrize(
    "seed",
    [
        5772, 6317, 1500, 100536, 101044, 100559, 101131, 100065, 100898, 101378, 100283, 101344, 100844, 100601,
        300139, 34, 9300146, 20003579, 7000545, 7000465, 20000033, 20000564, 20000103, 20001422,
        20002741,
    ],
)  # fmt: skip
def test_scenes_that_once_went_wrong(seed):
    scene, t_end = random_scene(random.Random(seed))
    assert not faults(scene, t_end, budget=8_000), vf.explain(scene)


if __name__ == "__main__":
    campaign(lambda seed: faults(*random_scene(random.Random(seed))))
