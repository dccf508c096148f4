"""Where bodies and effects are gathered into one System.

Effects call the ``add_*`` methods; what none of them calls is never built.
"""

from vofem.assembly.builder import SystemBuilder
from vofem.assembly.effect import Effect
from vofem.assembly.laws import ContactEntry
from vofem.assembly.model import Model

__all__ = ["ContactEntry", "Effect", "Model", "SystemBuilder"]
