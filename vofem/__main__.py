"""``python -m vofem`` is ``vofem``."""

import sys

from vofem.cli import main

sys.exit(main())
