"""What events and breakpoints cost in compiled runs of event_driven: ``python benchmarks/event_loop.py [million]``.

The first table gives microseconds an event, or a breakpoint of a load, of a whole run with the scene ready. The
second compares the paper's beam over 20 s with its bare arithmetic: a compiled loop that knows all events
beforehand, evaluates the gap function and its rate in all modes as often as the search does, and moves the state
from event to event. It has no bounds, no records, no checks. With "million" a mass between two stops hits them a
million times; time, memory and the balance of energy are printed.
"""

from __future__ import annotations

import resource
import sys
import time
from typing import Any

import numpy as np
from event_driven import paper_beam
from numpy.typing import NDArray

import vofem as vf
from vofem.kernels.jit import jit
from vofem.kernels.mode import kernels as running

Array = NDArray[np.float64]

REPEATS = 15


def rattling_mass() -> tuple[vf.Scene, float]:
    """Return a driven mass on a spring with a stop, and a time with some two thousand events."""
    mass = vf.Mass(1.0, stiffness=1.0)
    stop = vf.Contact(mass, gap=0.5, stiffness=100.0, side="above", acts_on="penetration")
    return vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, 1.3))]), 5000.0


def rattling_beam(damped: bool = False) -> tuple[vf.Scene, float]:
    """Return the paper's beam, damped or not, and a time with some hundred events."""
    if not damped:
        return paper_beam("displacement")[0], 400.0
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=25, supports={"left": "clamped"})
    tip = beam.at(1.0)
    stop = vf.Contact(tip, gap=0.03, stiffness=10.0, side="below", acts_on="penetration")
    return vf.Scene([beam], [stop, vf.PointLoad(tip, vf.Sine(0.05, 4.5)), vf.RayleighDamping(0.1, 1e-3)]), 100.0


def shaken_beam() -> tuple[vf.Scene, float]:
    """Return the paper's beam on a base that moves by a record of 20 s at 1 kHz, and 20 s."""
    times = np.arange(20_001) * 1e-3
    values = np.convolve(np.random.default_rng(0).normal(size=times.size), np.ones(20) / 20.0, "same")
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=25, supports={"left": "clamped"})
    stop = vf.Contact(beam.at(1.0), gap=0.03, stiffness=100.0, side="below", acts_on="penetration")
    return vf.Scene([beam], [stop, vf.BaseMotion(beam, vf.Tabulated(times, values))]), 20.0


CASES = {
    "mass with a stop, an event": (rattling_mass, "events"),
    "beam of 50 modes with a stop, an event": (rattling_beam, "events"),
    "the same, damped, an event": (lambda: rattling_beam(damped=True), "events"),
    "record at 1 kHz, 50 modes, a breakpoint": (shaken_beam, "steps"),
}


def best_of(call: Any, repeats: int = REPEATS) -> tuple[float, Any]:
    """Return the least processor time in s of some calls, after a first one, and the last outcome."""
    outcome, best = call(), np.inf
    for _ in range(repeats):
        begin = time.process_time()
        outcome = call()
        best = min(best, time.process_time() - begin)
    return best, outcome


def run(scene: vf.Scene, t_end: float) -> vf.Result:
    """Return a run without progress."""
    return vf.simulate(scene, t_end, method="event_driven", times=[t_end], progress=False)


@jit
def bare_loop(
    shapes: Array, squares: Array, rows: Array, static: Array, waves: Array, which: NDArray[np.int64],
    starts: Array, durations: Array, evaluations: int, omega: float, state: Array,
) -> float:  # fmt: skip
    """Move a modal state from event to event; return the sum of all gap functions, which is not needed.

    Parameters
    ----------
    shapes : ndarray, shape (2, n, n)
        Modes of both statuses.
    squares : ndarray, shape (2, n)
        Squared frequencies.
    rows, static, waves : ndarray, shape (2, n)
        In these modes: the row of the contact, the force of the spring of the stop, and the force of the load.
    which : ndarray of int, shape (k,)
        The status of every segment.
    starts, durations : ndarray, shape (k,)
        In s.
    evaluations : int
        How often the gap function is evaluated in a segment.
    omega : float
        Of the load ``sin(omega t)``, rad/s.
    state : ndarray, shape (2, n)
        Modal displacement and velocity, moved to the end.
    """
    n, total = state.shape[1], 0.0
    z, v, rest, amplitude, frequency = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for k in range(which.size):
        s, t = which[k], starts[k]
        z[:], v[:] = 0.0, 0.0
        for i in range(n):
            for j in range(n):
                z[j] += state[0, i] * shapes[s, i, j]
                v[j] += state[1, i] * shapes[s, i, j]
        for j in range(n):
            frequency[j] = np.sqrt(squares[s, j])
            rest[j] = static[s, j] / squares[s, j]
            amplitude[j] = waves[s, j] / (squares[s, j] - omega * omega)
            z[j] -= rest[j] + amplitude[j] * np.sin(omega * t)
            v[j] = (v[j] - amplitude[j] * omega * np.cos(omega * t)) / frequency[j]
        for e in range(evaluations):
            tau = durations[k] * (e + 1) / evaluations
            sine, cosine = np.sin(omega * (t + tau)), np.cos(omega * (t + tau))
            gap, rate = 0.0, 0.0
            for j in range(n):
                c, d = np.cos(frequency[j] * tau), np.sin(frequency[j] * tau)
                gap += rows[s, j] * (z[j] * c + v[j] * d + rest[j] + amplitude[j] * sine)
                rate += rows[s, j] * (frequency[j] * (v[j] * c - z[j] * d) + amplitude[j] * omega * cosine)
            total += gap + rate
        tau = durations[k]
        sine, cosine = np.sin(omega * (t + tau)), np.cos(omega * (t + tau))
        for j in range(n):
            c, d = np.cos(frequency[j] * tau), np.sin(frequency[j] * tau)
            z[j], v[j] = (
                z[j] * c + v[j] * d + rest[j] + amplitude[j] * sine,
                frequency[j] * (v[j] * c - z[j] * d) + amplitude[j] * omega * cosine,
            )
        state[:] = 0.0
        for i in range(n):
            for j in range(n):
                state[0, i] += z[j] * shapes[s, i, j]
                state[1, i] += v[j] * shapes[s, i, j]
    return total


def ratio() -> tuple[float, float, int]:
    """Return the seconds of a run of the paper's beam and of the bare loop, and the evaluations of a segment."""
    scene, t_end = paper_beam("displacement")
    seconds, result = best_of(lambda: run(scene, t_end), 60)
    solution = result.solution
    segments, laws, space = solution.segments, solution.system.contacts, solution.space
    spectra = [solution.linear.spectra[np.array([status])] for status in (0, 1)]
    shapes = np.stack([np.eye(space.size) if s.real.modes is None else s.real.modes for s in spectra])
    spring = laws.stiffness[0] * laws.offset[0] * space.contacts[0]
    rows = np.stack([space.contacts[0] @ shape for shape in shapes])
    static = np.stack([0.0 * spring, spring @ shapes[1]])
    # The load is `waves sin(t)`.
    waves = float(solution.load_functions[0](0.5 * np.pi)) * np.stack(
        [solution.load_vectors[0] @ shape for shape in shapes]
    )
    evaluations = round(result.counters.gap_evaluations / segments.starts.size)

    def bare() -> Array:
        state = np.stack([segments.displacement[0], segments.velocity[0]])
        bare_loop(
            shapes, np.stack([s.p for s in spectra]), rows, static, waves, segments.status[:, 0], segments.starts,
            segments.durations, evaluations, 1.0, state,
        )  # fmt: skip
        return state

    loop, state = best_of(bare, 60)
    end = np.stack([part[:, 0] for part in solution.modal(np.array([t_end]))])
    # The same motion, or the loop is no measure.
    assert np.allclose(state, end, rtol=1e-6, atol=1e-7 * np.abs(end).max())
    return seconds, loop, evaluations


def million() -> None:
    """Print what a million events cost."""
    mass = vf.Mass(1.0)
    stops = [vf.Contact(mass, gap=0.01, stiffness=1e6, side=side, acts_on="penetration") for side in ("above", "below")]
    scene = vf.Scene([mass], stops, initial={mass: (0.0, 1.0)})
    # A flight takes 0.02 s and a stay in a stop pi/1000 s: two events in 0.0231 s.
    t_end = 0.5e6 * (0.02 + np.pi * 1e-3)
    begin = time.process_time()
    result = vf.simulate(scene, t_end, method="event_driven", max_events=2_000_000, progress=False)
    seconds, memory = time.process_time() - begin, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    begin = time.process_time()
    balance = result.energy.balance_error
    print(
        f"{result.counters.events} events of one mass: {seconds:.1f} s, {memory:.0f} MB; "
        f"energy {time.process_time() - begin:.2f} s, balance {balance:.1e}"
    )


def main() -> None:
    """Print the tables."""
    print("| run | number | us each |")
    print("| --- | ---: | ---: |")
    for name, (build, of) in CASES.items():
        scene, t_end = build()
        seconds, result = best_of(lambda scene=scene, t_end=t_end: run(scene, t_end))
        count = getattr(result.counters, of)
        print(f"| {name} | {count} | {1e6 * seconds / count:.1f} |", flush=True)
    seconds, loop, evaluations = ratio()
    print(
        f"\npaper's beam, 20 s: run {1e3 * seconds:.3f} ms, bare loop ({evaluations} evaluations a segment) "
        f"{1e3 * loop:.3f} ms, ratio {seconds / loop:.2f}"
    )


if __name__ == "__main__":
    with running(compiled=True):
        million() if sys.argv[1:2] == ["million"] else main()
