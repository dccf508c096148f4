"""Functions for sweeps; in a module of their own, so that other processes can import them."""

import os
import signal
import time
from pathlib import Path

import numpy as np

import vofem as vf

OFFSET = 1.5

#: What slept to its end.
SLEPT: list[str] = []


def amplitude(omega, gap):
    """Run an oscillator against a stop; larger matrix products show the number of threads in their last bits."""
    mass = vf.Mass(1.0, 1.0, 0.1, name="m")
    stop = vf.Contact(mass, gap=gap, stiffness=8.0, side="above", acts_on="penetration", name="stop")
    result = vf.simulate(vf.Scene([mass], [stop, vf.PointLoad(mass, vf.Sine(1.0, omega))]), 30.0)
    rng = np.random.default_rng(int(1e6 * omega))
    matrix = rng.normal(size=(300, 300))
    return {
        "u": np.abs(result.displacement(mass)).max(),
        "closings": result.contacts["stop"].closings.size,
        "trace": np.trace(matrix @ matrix @ matrix),
    }


def beam_at_stop(length, gap, omega):
    """Make a scene with a beam anew, and say what was solved for it."""
    beam = vf.Beam(length, 1.0, 1.0, 4, supports={"left": "clamped"}, name="beam")
    tip = beam.at(length)
    stop = vf.Contact(tip, gap=gap, stiffness=10.0, side="below", acts_on="penetration", name="stop")
    result = vf.simulate(vf.Scene([beam], [stop, vf.PointLoad(tip, vf.Sine(1.0, omega))]), 5.0)
    counters = result.counters
    return {
        "tip": result.displacement(tip)[-1],
        "eigensolves": counters.eigensolves,
        "updates": counters.rank_one_updates,
    }


def square(x):
    return {"y": x * x + shifted(x), "series": np.arange(3) * x, "large": x > 2, "label": f"p{x}"}


def shifted(x):
    return x + OFFSET


def shifted_square(x):
    return square(x + 1)


def square_on_a_full_disk(x, limited):
    """Limit the size of files at one point, once: to less than the rows take, more than what SQLite writes first."""
    if x == 2000 and not Path(limited).exists():
        import resource

        Path(limited).touch()
        resource.setrlimit(resource.RLIMIT_FSIZE, (2**14, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
    return square(x)


def slow_square(x, folder, seconds):
    Path(folder, f"{x}-{os.getpid()}-{time.monotonic_ns()}").touch()
    time.sleep(seconds)
    return {"y": x / 3.0, "series": np.sin(np.arange(4.0) + x)}


def odd_at_two(x, odd):
    return {"y": odd if x == 2 else x / 2}


def stops_at(x, folder):
    """Be stopped at the thirteenth point, until there is a file."""
    if x == 12 and not Path(folder, "go").exists():
        raise KeyboardInterrupt
    return {"y": x}


def ratio(x, n):
    if x == 2:
        raise ValueError("no such x")
    return {"y": x / n, "label": f"{x} of {n}"}


def trouble(kind):
    """Do what a function of a user may do."""
    if kind == "raise":
        raise ValueError("no such gap")
    if kind == "exit":
        raise SystemExit(3)
    if kind == "nan":
        return {"y": float("nan")}
    if kind == "sleep":
        time.sleep(60.0)
        SLEPT.append(kind)
    if kind == "loop":
        while True:
            pass
    if kind == "deaf":
        signal.signal(signal.SIGALRM, signal.SIG_IGN)
        time.sleep(60.0)
    if kind == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "number":
        return 3.0
    if kind == "object":
        return {"y": object()}
    if kind == "large":
        return {"y": 10**30}
    if kind == "shape":
        return {"y": [1.0, 2.0]}
    if kind == "clash":
        return {"kind": 1.0}
    return {"y": 1.0}
