"""The interface to the store of runs and branches, and the choice of that store.

Results, simulations and studies know no file format. `vofem/__init__.py` names the
store. It is imported when something is to be saved.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from vofem.errors import StorageError


class SaveRun(Protocol):
    """Writes a whole run to one file; see `vofem.Result.save`."""

    def __call__(
        self, result: Any, path: str | os.PathLike[str], *, overwrite: bool, frames: Any, magnification: float
    ) -> Path:
        """Return the path of the file."""


class SaveBranch(Protocol):
    """Writes a branch of orbits to one file; see `vofem.Branch.save`."""

    def __call__(self, branch: Any, path: str | os.PathLike[str], *, overwrite: bool) -> Path:
        """Return the path of the file."""


class KeepSnapshots(Protocol):
    """Prepares a file for the snapshots of a run that is about to begin."""

    def __call__(self, path: str | os.PathLike[str], scene: Any) -> Callable[[Any], Callable[[dict[str, Any]], None]]:
        """Return a function of the run's plan, which returns one that writes a snapshot in place of the one before."""


@dataclass(frozen=True)
class Store:
    """Functions that save runs, snapshots and branches.

    Attributes
    ----------
    save : SaveRun
    snapshots : KeepSnapshots
    save_branch : SaveBranch
    """

    save: SaveRun
    snapshots: KeepSnapshots
    save_branch: SaveBranch


_openers: list[Callable[[], Store]] = []


def use_store(opener: Callable[[], Store]) -> None:
    """Name the store from now on by a function that opens it; it is called when something is to be kept."""
    _openers[:] = [opener]


def store() -> Store:
    """Return the store.

    Raises
    ------
    StorageError
        If none was named.
    """
    if not _openers:
        raise StorageError("there is no store to keep runs in; name one with vofem.persistence.use_store")
    return _openers[0]()
