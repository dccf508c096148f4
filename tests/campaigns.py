"""Campaigns: checks of random scenes run over many seeds, from the command line."""

import sys
import traceback


def campaign(*checks):
    """Print what checks find for the seeds from FIRST to below LAST, the arguments of the command line.

    A check takes a seed and returns what is wrong: a text, a list of texts, or nothing. An error is what it found.
    """
    for seed in range(int(sys.argv[1]), int(sys.argv[2])):
        for check in checks:
            try:
                found = check(seed)
            except Exception:
                found = traceback.format_exc(limit=-3)
            if found:
                print(seed, check.__name__, *([found] if isinstance(found, str) else found), sep="\n    ", flush=True)
