"""What the commands share: exit codes, and a line on the method."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from vofem.io.scene_file import SceneFile

#: Where a command adds its parser.
Commands: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"

#: Exit codes of success and of an error that vofem has reported. argparse takes 2 for wrong usage.
FINE, FAULT, INTERRUPTED = 0, 1, 130


def print_method(file: SceneFile, wanted: str | None) -> None:
    """Say which method is used, where it is not the one that vofem would choose."""
    method = wanted or (file.run.method if file.run is not None else "auto")
    if method != "auto":
        print(f"This run: {method}, as the {'command line' if wanted else 'scene file'} says")


def limits(file: SceneFile) -> tuple[float | None, float | None]:
    """Return duration in s and tolerance that a file asks for, by which a method is chosen."""
    arguments = file.run.arguments() if file.run is not None else {}
    return arguments.get("t_end"), arguments.get("tol")
