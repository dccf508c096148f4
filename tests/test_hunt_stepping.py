"""Adversarial scenes for methods that step in time: right within what is stated, or a note or an error says why not.

`python tests/test_hunt_stepping.py FIRST LAST` runs the cases of many seeds and prints what it finds.
"""

import random
import re

import numpy as np
import pytest
from campaigns import campaign
from hunt_reference import HuntReference, SpringpotReference
from hunt_scenes import case as random_case
from hunt_scenes import decades
from scenes import cantilever

import vofem as vf

#: Notes that say what was chosen, and not that anything is wrong.
INFORMS = re.compile(
    r"^(step: dt = .* was chosen|step: the critical step of|storage:|chatter: under|contacts: .* never closed)"
)

#: Notes that excuse an error of runs with `tol`, and of runs with steps of a given or a chosen size.
EXCUSES = {True: re.compile(r"^tol:"), False: re.compile(r"^(load|step|steps|resolved?|chatter|energy|contacts)\b")}

#: Of the largest displacement, without `tol`.
ACCURATE = 0.02

#: Errors of beams at a stop by a given step, of the largest displacement: above the first at the tip there is a note,
#: and below the second anywhere there is none on errors of steps.
UNTOLD, NO_ALARM = 0.2, 0.005


def fault(case, budget=3_000):
    """Return what is wrong with the run of a case, or None."""
    try:
        result = vf.simulate(case.scene, case.t_end, method=case.method, **case.options)
    except vf.VofemError:
        return None
    told = [note for note in result.notes if not INFORMS.match(note)]
    if any(EXCUSES["tol" in case.options].match(note) for note in told):
        return None
    times, got = result.times, result.samples.q
    if case.laws["springpot"]:
        reference = SpringpotReference(case.scene, case.t_end)
        (coarse_t, coarse), (fine_t, fine) = reference.run(1000), reference.run(2000)
        size = float(np.max(np.abs(fine)))
        doubt = np.max(np.abs(coarse - fine[:, ::2]), axis=0)
        good = doubt <= 2e-3 * size
        until = case.t_end if np.all(good) else float(coarse_t[np.argmin(good)])
        kept = times <= until
        exact = np.array([np.interp(times[kept], fine_t, row) for row in fine])
        step = fine_t[1]
        quickest = np.max(np.abs(np.diff(fine, 2)), initial=0.0) / step**2
        fastest = np.max(np.abs(np.diff(fine)), initial=0.0) / step
    else:
        reference = HuntReference(case)
        exact = reference.run(times, budget)
        until, quickest, fastest = reference.until, reference.quickest, reference.fastest
        other = reference.run(times, budget, shift=1e-8 * max(fastest, 1e-3))
        count = min(exact.shape[1], other.shape[1])
        size = reference.largest
        apart = np.max(np.abs(exact[:, :count] - other[:, :count]), axis=0, initial=0.0)
        agree = np.maximum.accumulate(apart) <= 1e-4 * size
        exact, kept = exact[:, :count][:, agree], np.zeros(times.size, dtype=bool)
        kept[: int(np.sum(agree))] = True
    if not np.any(kept) or size == 0.0:
        return None if size or not np.any(np.abs(got[:, kept]) > 1e-12) else "moves where nothing does"
    error = float(np.max(np.abs(got[:, kept] - exact))) / size
    if "tol" in case.options:
        allowed = 10.0 * case.options["tol"] + (5e-3 if case.laws["springpot"] else 0.0)
        said = f"error {error:.2e} of {size:.2e} m by {until:.3g} s, tol {case.options['tol']:.0e}, notes {told}"
        return None if error <= allowed else said
    # A method of second order falls behind in phase: what that makes of the motion is no fault of one run.
    dt = getattr(result.solution, "dt", case.options.get("dt", 0.0))
    omega = quickest / max(fastest, 1e-300)
    lag = omega * min(until, float(times[kept][-1])) * (omega * dt) ** 2 / 6.0
    behind = lag * fastest / max(omega, 1e-300) / size
    allowed = ACCURATE + behind
    if error <= min(allowed, 1.0) or (allowed > 1.0 and error <= 2.5):
        return None
    said = f"error {error:.2e} of {size:.2e} m by {until:.3g} s, allowed {allowed:.1e}"
    return f"{said}, omega dt {omega * dt:.1e}, notes {told}"


# In 3041 the damper of a stop begins to act within a step.
@pytest.mark.parametrize("seed", [*range(14), 3041])
def test_right_or_told(seed):
    case = random_case(random.Random(seed))
    assert fault(case, budget=600) is None, " | ".join(case.words)


def beam_at_a_stop(rng):
    """Return a scene whose stop excites modes that are quicker than the load, its tip, and how it is run."""
    elements, gap = rng.randint(2, 6), decades(rng, -3, -1.3)
    beam = cantilever(elements, name="beam")
    tip = beam.at(1.0)
    stop = vf.Contact(tip, gap=gap, stiffness=decades(rng, 1, 3), side=rng.choice(["above", "below"]),
                      acts_on="penetration", name="stop")  # fmt: skip
    effects = [stop, vf.PointLoad(tip, vf.Sine(0.1, rng.uniform(1.0, 8.0)))]
    if rng.random() < 0.4:
        effects.append(vf.RayleighDamping(alpha=decades(rng, -2, 0)))
    t_end, method = decades(rng, 0.3, 0.9), rng.choice(["energy_conserving", "generalized_alpha"])
    return vf.Scene([beam], effects), tip, t_end, method, decades(rng, -3.5, -1.5)


def fault_at_a_stop(rng):
    """Return what is wrong with a run of such a scene beside the exact one, or None."""
    scene, tip, t_end, method, dt = beam_at_a_stop(rng)
    times = np.linspace(0.0, t_end, 401)
    exact = vf.simulate(scene, t_end, times=times)
    right = exact.displacement(tip)
    nearby = scene.replace("stop", gap=scene.contacts[0].gap * (1.0 + 1e-4))
    if np.abs(vf.simulate(nearby, t_end, times=times).displacement(tip) - right).max() > 0.02 * np.abs(right).max():
        return None  # chaotic: no run with steps is right until the end
    result = vf.simulate(scene, t_end, method=method, dt=dt, times=times)
    error = float(np.abs(result.displacement(tip) - right).max() / np.abs(right).max())
    # Rotations are compared with displacements by their arms, as the run does.
    scale = scene.model.system.scale[:, None]
    anywhere = np.abs(scale * (result.samples.q - exact.samples.q)).max() / np.abs(scale * exact.samples.q).max()
    told = [note for note in result.notes if not INFORMS.match(note)]
    alarm = any("add up to" in note or "lead to another motion" in note for note in told)
    said = f"{method} dt {dt:.2g} until {t_end:.3g} s: error {error:.2g}, anywhere {anywhere:.2g}, notes {told}"
    wrong = (error > UNTOLD and not told) or (max(error, anywhere) < NO_ALARM and alarm)
    return said if wrong else None


@pytest.mark.parametrize("seed", range(8))
def test_a_beam_at_a_stop_by_a_given_step(seed):
    assert fault_at_a_stop(random.Random(seed)) is None


def fault_of_seed(seed):
    case = random_case(random.Random(seed))
    found = fault(case)
    return found and f"{' | '.join(case.words)}\n    {found}"


def fault_of_seed_at_a_stop(seed):
    return fault_at_a_stop(random.Random(seed))


if __name__ == "__main__":
    campaign(fault_of_seed, fault_of_seed_at_a_stop)
