"""The errors that vofem raises: typed, and all derived from `VofemError`.

A message names the thing, says what was found and what was expected, and
where it helps the likely cause and the cure.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


class VofemError(Exception):
    """Base class of every error that vofem raises."""


class ArgumentError(VofemError, ValueError):
    """An argument has a wrong value: not finite, of the wrong sign, off the beam, of an unknown name."""


class MissingPackageError(VofemError, ImportError):
    """A package that only some functions need is not installed; the message says how to install it."""


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


class LimitLoadError(VofemError):
    """A load reached what a spring that softens can carry: beyond it there is no equilibrium.

    Attributes
    ----------
    load : float
        In N.
    time : float
        In s; of a quasi-static path the load factor.
    limit : float
        In N.
    """

    def __init__(self, message: str, load: float, time: float, limit: float) -> None:
        super().__init__(message)
        self.load, self.time, self.limit = load, time, limit

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.load, self.time, self.limit)


class EventStormError(VofemError):
    """More contact events than the run was allowed to treat."""


class ExecutorError(VofemError):
    """The executor that was given to a sweep takes no more work; the message says why and what to do."""


class OutputError(VofemError, OSError):
    """A file could not be written; the message says which, why, and what to do."""


class StorageError(VofemError, ValueError):
    """A file is no saved run, or a damaged one, or of a newer vofem; the message says which and what to do."""


class MissingCallableError(VofemError):
    """Something that was read from a file needs a Python callable, which no file holds; the message names it."""


class SceneFileError(VofemError, ValueError):
    """A scene file, or a scene to be written to one, has problems; all of them are listed, one a line.

    Attributes
    ----------
    source : str
        The file, or what was to be written.
    problems : tuple of (str, str)
        The path of the key, such as ``"contact[2].stiffness"``, and what is
        wrong. The path is empty where the file as a whole is meant.
    """

    def __init__(self, source: str, problems: Iterable[tuple[str, str]]) -> None:
        self.source = source
        self.problems = tuple(problems)
        lines = [f"{path}: {message}" if path else message for path, message in self.problems]
        if len(lines) == 1 and not self.problems[0][0]:
            super().__init__(f"{source}: {lines[0]}")
        else:
            count = f"{len(lines)} problems" if len(lines) > 1 else "1 problem"
            super().__init__("\n  ".join([f"{source}: {count}", *lines]))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.source, self.problems)
