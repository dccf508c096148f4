"""Kinds of laws in compiled loops, those of contacts first."""

PENETRATION, JUMP, RESOLVED = 0, 1, 2

#: Number of laws from which on a step may be solved on the unknowns in place of the laws.
FEWEST_IN_BAND = 16

#: A law whose force is affine in its coordinate. Over a step a springpot is such a law, with numbers of the step.
AFFINE = 3

#: A law written in Python, called through its address.
CALLED = 4

#: Laws with internal variables: two backbones of cyclic laws, and Jenkins elements.
HYPERBOLIC, TABULATED, JENKINS = 5, 6, 7

#: A law with internal variables that is one function, called through its address.
CALLED_WITH_PAST = 8
