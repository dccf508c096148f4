"""``python -m vofem`` is ``vofem``."""

import sys

from vofem.cli import script

if __name__ == "__main__":  # sweeps start processes
    sys.exit(script())
