"""Parameters of bodies, effects and functions: each is declared once, in the class that has it.

A class names its parameters as annotated fields of a dataclass: ``gap: Annotated[float, Real("m", "The gap.")]``.
From this follow the checks of its constructor, the section of its docstring, its table in scene files and their schema,
copies with changed values, and what is stored.
"""

from vofem.parameters.declared import CHOSEN as CHOSEN
from vofem.parameters.declared import Declaration as Declaration
from vofem.parameters.declared import OneOf as OneOf
from vofem.parameters.declared import content_of as content_of
from vofem.parameters.declared import declarations as declarations
from vofem.parameters.declared import declared as declared
from vofem.parameters.declared import is_declared as is_declared
from vofem.parameters.declared import label_of as label_of
from vofem.parameters.declared import rule as rule
from vofem.parameters.declared import values_of as values_of
from vofem.parameters.kinds import Choice as Choice
from vofem.parameters.kinds import Count as Count
from vofem.parameters.kinds import Flag as Flag
from vofem.parameters.kinds import Function as Function
from vofem.parameters.kinds import Kind as Kind
from vofem.parameters.kinds import Label as Label
from vofem.parameters.kinds import Name as Name
from vofem.parameters.kinds import Numbers as Numbers
from vofem.parameters.kinds import Real as Real
from vofem.parameters.kinds import RealOrArray as RealOrArray
from vofem.parameters.kinds import Unwritable as Unwritable
from vofem.parameters.paths import changed as changed
from vofem.parameters.paths import number_at as number_at
from vofem.parameters.paths import value_at as value_at
