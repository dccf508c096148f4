"""Scalar laws on rows: contacts, smooth and hysteretic springs, springpots, the law that the paper prints.

A law is one function and its numbers (`law.Law`). Each other module states laws of one kind, and the group that
gathers them says which methods can treat them.
"""

from vofem.laws.contact import ContactLaws, initial_status
from vofem.laws.friction import FrictionLaw, FrictionLaws
from vofem.laws.group import LawGroup, gathered_past, past_of
from vofem.laws.hysteretic import HystereticLaws
from vofem.laws.law import CLOSED, OPEN, PINNED, Law, LawSet
from vofem.laws.paper import LinearLevel, PrintedLaw, PrintedLaws
from vofem.laws.smooth import Smooth, SmoothLaws
from vofem.laws.springpot import SpringpotLaw, SpringpotLaws

#: Names of the kinds of laws for messages, in the order of the kinds.
KINDS = tuple(
    dict.fromkeys(group.kind for group in (ContactLaws, SmoothLaws, HystereticLaws, SpringpotLaws, FrictionLaws))
)

__all__ = [
    "CLOSED",
    "KINDS",
    "OPEN",
    "PINNED",
    "ContactLaws",
    "FrictionLaw",
    "FrictionLaws",
    "HystereticLaws",
    "Law",
    "LawGroup",
    "LawSet",
    "LinearLevel",
    "PrintedLaw",
    "PrintedLaws",
    "Smooth",
    "SmoothLaws",
    "SpringpotLaw",
    "SpringpotLaws",
    "gathered_past",
    "initial_status",
    "past_of",
]
