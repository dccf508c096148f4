"""Scalar laws on rows: contacts, smooth and hysteretic springs, springpots, the law that the paper prints.

Each module states one law: its force, its mean force over a step, its tangent,
its stored energy, its dissipation, its internal variables, and what it requires
of a method. Compiled loops call the functions of `evaluate`. All other code
calls `group.LawGroup`.
"""

from vofem.laws.contact import ContactLaws, initial_status
from vofem.laws.group import CLOSED, OPEN, PINNED, LawGroup, gathered_past, past_of
from vofem.laws.hysteretic import HystereticLaw, HystereticLaws
from vofem.laws.kinds import HYPERBOLIC, JENKINS, TABULATED
from vofem.laws.paper import LinearLevel, PrintedLaw, PrintedLaws
from vofem.laws.smooth import ScalarLaw, SmoothLaw, SmoothLaws
from vofem.laws.springpot import SpringpotLaw, SpringpotLaws

#: Names of the kinds of laws for messages, in the order of the kinds.
KINDS = tuple(dict.fromkeys(group.kind for group in (ContactLaws, SmoothLaws, HystereticLaws, SpringpotLaws)))

__all__ = [
    "CLOSED",
    "HYPERBOLIC",
    "JENKINS",
    "KINDS",
    "OPEN",
    "PINNED",
    "TABULATED",
    "ContactLaws",
    "HystereticLaw",
    "HystereticLaws",
    "LawGroup",
    "LinearLevel",
    "PrintedLaw",
    "PrintedLaws",
    "ScalarLaw",
    "SmoothLaw",
    "SmoothLaws",
    "SpringpotLaw",
    "SpringpotLaws",
    "gathered_past",
    "initial_status",
    "past_of",
]
