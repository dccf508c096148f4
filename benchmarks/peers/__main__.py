"""Run one peer at all of its levels: ``python -m peers NAME``; a line of JSON per run on standard output.

Each peer runs in a process of its own, so that none spoils another's memory or
threads, and one that crashes takes only itself away.
"""

from __future__ import annotations

import json
import os
import sys
import time
from importlib import import_module

import numpy as np

from peers.problem import problem

#: Seconds after which no further level begins, and within which a level is repeated.
CAP, REPEAT = 30.0, 3.0


def main(name: str) -> None:
    # Programs that print of their own accord shall not mix with what is read here.
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    peer = import_module(f"peers.{name}")
    reason = peer.missing()
    if reason is not None:
        print(json.dumps({"name": peer.NAME, "missing": reason}), file=out, flush=True)
        return
    case = problem()
    truth, prepared = case.reference(), peer.prepare(case)
    scale, begin, seconds = float(np.max(np.abs(truth))), time.perf_counter(), 0.0
    for level in peer.LEVELS:
        # The next level takes some two to three times as long.
        if time.perf_counter() - begin + 2.0 * seconds > CAP and seconds > 0.0:
            break
        seconds, history = peer.run(case, prepared, level)
        spent, tries = seconds, 1
        while tries < (20 if spent < 0.1 else 3) and spent + seconds < REPEAT:
            again = peer.run(case, prepared, level)[0]
            seconds, spent, tries = min(seconds, again), spent + again, tries + 1
        error = float(np.max(np.abs(history - truth))) / scale
        found = {"name": peer.NAME, "level": level, "seconds": seconds, "error": error}
        print(json.dumps(found), file=out, flush=True)


main(sys.argv[1])
