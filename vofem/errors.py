"""The errors that vofem raises: typed, and all derived from `VofemError`.

A message names the thing at fault, and says what was found and what was expected.
Where it helps, it also names the likely cause and the cure.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


class VofemError(Exception):
    """Base class of every error that vofem raises."""


class ArgumentError(VofemError, ValueError):
    """An argument has a wrong value, such as a number that is not finite, a point off the beam or an unknown name."""

    #: What was found, what was expected, and a hint, where the message is made of these.
    parts: tuple[str, str, str] | None = None

    def in_a_file(self) -> str:
        """Return the message of a key of a scene file, made of the parts."""
        found, expected, hint = self.parts or ("", "", "")
        return f"expected {expected}, found {found}{hint}" if found else f"missing, expected {expected}{hint}"


class MissingPackageError(VofemError, ImportError):
    """A package that only some functions need is not installed; the message says how to install it."""


class MethodError(ArgumentError):
    """The chosen method cannot treat the scene; the message names one that can."""


class StepSizeError(ArgumentError):
    """The step size is larger than the critical step, which the message gives."""


class MeshError(VofemError, ValueError):
    """A mesh file is missing, damaged, or not one straight chain of lines; the message names the file."""


class LoadError(VofemError, ValueError):
    """A load function returned something that is not a finite number."""


class SingularSystemError(VofemError):
    """The equations have no unique solution: a body is not held, or a mass is missing."""


class ConvergenceError(VofemError):
    """An iteration did not converge; the message says where, and how far it came."""


class InstabilityError(VofemError):
    """The energy of a run grew by more than the work of its loads, or a state became infinite or NaN."""


class LimitLoadError(VofemError):
    """A load reached the limit load of a softening spring, beyond which there is no equilibrium.

    Attributes
    ----------
    load : float
        The load in N.
    time : float
        Time in s; on a quasi-static path the load factor.
    limit : float
        The limit load in N.
    """

    def __init__(self, message: str, load: float, time: float, limit: float) -> None:
        super().__init__(message)
        self.load, self.time, self.limit = load, time, limit

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.load, self.time, self.limit)


class EventStormError(VofemError):
    """A run had more contact events than ``max_events``."""


class ExecutorError(VofemError):
    """The executor that was given to a sweep takes no more work; the message says why and what to do."""


class OutputError(VofemError, OSError):
    """A file could not be written; the message says which, why, and what to do."""


class StorageError(VofemError, ValueError):
    """A file is not a saved run, is damaged, or is of a newer vofem; the message says which, and what to do."""


class MissingCallableError(VofemError):
    """An object that was read from a file needs a Python function, which files cannot hold; the message names it."""


class SceneFileError(VofemError, ValueError):
    """A scene file, or a scene that is to be written to one, has faults. The message lists all of them.

    Attributes
    ----------
    source : str
        Name of the file, or of the scene that was to be written.
    problems : tuple of (str, str)
        Pairs of the path of a key, such as ``"contact[2].stiffness"``, and what is
        wrong with it. The path is empty for faults of the whole file.
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
