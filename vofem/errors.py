"""The errors that vofem raises: typed, and all derived from `VofemError`.

A message names the thing, says what was found and what was expected, and
where it helps the likely cause and the cure.
"""

from __future__ import annotations


class VofemError(Exception):
    """Base class of every error that vofem raises."""


class ArgumentError(VofemError, ValueError):
    """An argument has a wrong value: not finite, of the wrong sign, off the beam, of an unknown name."""


class MethodError(ArgumentError):
    """The chosen method cannot treat the scene; the message names one that can."""


class StepSizeError(ArgumentError):
    """The step size lies beyond the stability limit; the message says the limit."""


class MeshError(VofemError, ValueError):
    """A mesh file is missing, damaged, or not one straight chain of lines; the message names the file."""


class LoadError(VofemError, ValueError):
    """A load function returned something that is not a finite number."""


class SingularSystemError(VofemError):
    """The equations have no unique solution: a body is not held, or a mass is missing."""


class ConvergenceError(VofemError):
    """An iteration that should always end did not; the message says where and how far it came."""


class InstabilityError(VofemError):
    """The energy of a run grew beyond what its loads can have done, or a state became non-finite."""


class EventStormError(VofemError):
    """More contact events than the run was allowed to treat."""


class OutputError(VofemError, OSError):
    """A file could not be written; the message says which, why, and what to do."""
