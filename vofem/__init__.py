"""vofem: finite elements for beams and masses that hit, rattle and yield.

Beams and masses hit stops, rattle in loose supports, and yield. Describe them by a
`Scene`, run it with `simulate`, and ask the `Result`. See the README for a first
scene.
"""

import lazy_loader

# The names are those of `__init__.pyi`, which editors and type checkers read.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
