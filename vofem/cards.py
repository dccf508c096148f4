"""What methods of results, studies and scenes have from `vofem.io`: cards for notebooks, frames, and files."""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar

#: Where the functions are. Each is imported when a method needs it: nothing below `vofem.io` knows pictures or files,
#: and those who neither draw nor save do not wait for them.
_PLACES = {
    "card": "vofem.io.cards:card_of",
    "checkpoint": "vofem.io.storage.checkpoint:checkpoint_writer",
    "curve": "vofem.io.storage.branch_file:save",
    "fit": "vofem.io.storage.fit_file:save",
    "frames": "vofem.io.frames:Frames",
    "run": "vofem.io.storage.run_file:save",
}


def from_io(name: str) -> Any:
    """Return one of the functions and classes of `_PLACES`."""
    return imported(_PLACES[name])


def imported(place: str) -> Any:
    """Return what a place such as ``"vofem.io.frames:Frames"`` names, imported now."""
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


class Shown:
    """What notebooks show as a card."""

    def _repr_html_(self) -> str:
        return str(from_io("card")(self))


class Saved(Shown):
    """What is also kept in one file."""

    #: Name of the function that writes it.
    _saver: ClassVar[str]

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> Path:
        """Write all of it to one file, from which `vofem.load` restores it.

        Parameters
        ----------
        path : path
            Name of the file; it ends in .h5 or .hdf.
        overwrite : bool
            Whether an existing file of that name is replaced.

        Raises
        ------
        ArgumentError
            If the suffix is another one.
        OutputError
            If the file exists and is not to be overwritten, or cannot be written.
        """
        return Path(from_io(self._saver)(self, path, overwrite=overwrite))
