"""``python -m vofem`` is ``vofem``."""

import sys

from vofem.cli import script

sys.exit(script())
