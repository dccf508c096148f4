"""vofem: finite elements for beams and masses that hit, rattle and yield.

Beams and masses hit stops, rattle in loose supports, and yield. Describe them by a
`Scene`, run it with `simulate`, and ask the `Result`. See the README for a first
scene.
"""

import lazy_loader

# Before the first import that another thread may be in at a fork.
import vofem.locks  # noqa: F401

# The names are those of `__init__.pyi`, which editors and type checkers read.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
