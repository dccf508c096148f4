"""Assembly: the contributions of bodies and effects are gathered into one System.

Effects call the ``add_*`` methods of `SystemBuilder`. Parts that no effect asks for are never built.
"""

from vofem.assembly.bases import Base
from vofem.assembly.builder import SystemBuilder
from vofem.assembly.effect import Effect
from vofem.assembly.laws import ContactEntry
from vofem.assembly.model import Model

__all__ = ["Base", "ContactEntry", "Effect", "Model", "SystemBuilder"]
