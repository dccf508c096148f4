"""Parameters of bodies, effects and functions: each is declared once, in the class that has it.

A class names its parameters as annotated fields of a dataclass, such as
``gap: Annotated[float, Real("m", "The gap.")]``. From this follow the checks of its
constructor, the section of its docstring, its table in scene files and their
schema, copies with changed values, and what is stored.
"""

from vofem.parameters.declared import (
    CHOSEN,
    Declaration,
    OneOf,
    automatic_name,
    content_of,
    declarations,
    declared,
    is_declared,
    label_of,
    rule,
    values_of,
)
from vofem.parameters.kinds import (
    Choice,
    Count,
    Flag,
    Function,
    Kind,
    Label,
    Name,
    Numbers,
    Real,
    RealOrArray,
    Unwritable,
)
from vofem.parameters.paths import changed, number_at, value_at

__all__ = [
    "CHOSEN",
    "Choice",
    "Count",
    "Declaration",
    "Flag",
    "Function",
    "Kind",
    "Label",
    "Name",
    "Numbers",
    "OneOf",
    "Real",
    "RealOrArray",
    "Unwritable",
    "automatic_name",
    "changed",
    "content_of",
    "declarations",
    "declared",
    "is_declared",
    "label_of",
    "number_at",
    "rule",
    "value_at",
    "values_of",
]
