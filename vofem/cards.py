"""How notebooks show runs, orbits, branches and scenes, and how files hold branches and fits."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any


class Shown:
    """What notebooks show as a card."""

    def _repr_html_(self) -> str:
        # Late, because results, studies and scenes know no pictures and no HTML.
        from vofem.io.cards import card_of

        return card_of(self)


class Saved(Shown):
    """What is also kept in one file, whose writer it names."""

    def _writer(self) -> Callable[..., Path]:
        raise NotImplementedError

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
        writer: Any = self._writer()
        return Path(writer(self, path, overwrite=overwrite))
