"""NLvib's example 03 by pyHarm-os, which knows harmonic balance without stability: a line of JSON.

    python benchmarks/peers/pyharm_nlvib_03.py [LARGEST STEP] [HARMONICS]

pyHarm-os brings some hundred packages along (jax, notebook), so that it goes into an environment of its own:
``python -m venv peer && peer/bin/pip install pyHarm-os``, and this file runs with the Python of that environment. It
does not import vofem. ``python benchmarks/steady_states.py --pyharm peer/bin/python`` runs it directly before vofem.

What it takes depends on the largest step along the branch. With long steps it follows the curve in about 150 points.
With short ones it turns around some hundred times near the upper fold.
"""

from __future__ import annotations

import json
import os
import sys
import time

import numpy as np

#: As of NLvib's example: harmonics, instants of a period, and the interval of angular frequencies in rad/s.
HARMONICS, INSTANTS, FROM, TO = 21, 1024, 0.8, 0.5

#: Largest step along the branch, in pyHarm's measure.
STEP = 0.05


def scene(harmonics: int, step: float) -> dict:
    """Return the input of pyHarm: two masses, springs of 1, dampers 0.03 times these, a stop of 100 at a gap of 1."""
    stiffness = np.array([[1.0, -1.0], [-1.0, 2.0]])
    matrices = {"M": np.eye(2), "C": 0.03 * stiffness, "K": stiffness}
    return {
        "analysis": {
            "FRF": {
                "study": "frf", "puls_inf": TO, "puls_sup": FROM, "sign_ds": -1,
                "ds0": min(step, 1e-2), "ds_max": step, "ds_min": 1e-9, "verbose": False,
            }
        },
        "system": {"type": "Base", "nh": harmonics, "nti": INSTANTS, "adim": {"status": False}},
        "substructures": {"masses": {"matrix": matrices, "ndofs": 1}},
        "connectors": {
            "stop": {"type": "PenaltyUnilateralGap", "connect": {"masses": [0]}, "dirs": [0], "g": 1.0, "k": 100.0},
            "load": {"type": "CosinusForcing", "connect": {"masses": [1]}, "dirs": [0], "amp": 0.1},
        },
    }  # fmt: skip


def main(step: float, harmonics: int) -> None:
    # What the program writes of its own accord shall not mix with what is read here.
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    from pyHarm.Maestro import Maestro

    study = Maestro(scene(harmonics, step))
    begun, used = time.perf_counter(), time.process_time()
    study.operate()
    seconds, used = time.perf_counter() - begun, time.process_time() - used
    tried = study.nls["FRF"].SolList
    points = [one.x for one in tried if one.flag_accepted]
    omega = np.array([x[-1] for x in points])
    index = study.system.expl_dofs
    mine = index[(index["node_num"] == 0)].index.to_numpy()
    series = np.array([x[mine] for x in points])
    # Half the mean square of all harmonics, as NLvib draws it.
    metric = np.sqrt((series[:, 0] ** 2 + np.sum(series[:, 1:] ** 2, axis=1)) / 2.0)
    peak = int(np.argmax(metric))
    turning = omega[1:-1][np.diff(np.sign(np.diff(omega))) != 0]
    turns = int(turning.size)
    told = {
        "step": step, "harmonics": harmonics, "seconds": seconds, "processor_seconds": used, "points": len(points),
        "tried": len(tried), "from": float(omega[0]), "to": float(omega[-1]), "turns": turns,
        "folds": [float(turning.min()), float(turning.max())] if turns else None,
        "peak": float(metric[peak]), "peak_omega": float(omega[peak]),
    }  # fmt: skip
    print(json.dumps(told), file=out, flush=True)


if __name__ == "__main__":
    main(
        float(sys.argv[1]) if len(sys.argv) > 1 else STEP,
        int(sys.argv[2]) if len(sys.argv) > 2 else HARMONICS,
    )
