"""The command line: ``vofem run``, ``explain``, ``verify`` and more. Only this package prints and ends processes."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from vofem.cli.common import FAULT, FINE, INTERRUPTED
from vofem.cli.prompt_end import prompt_end

__all__ = ["FAULT", "FINE", "INTERRUPTED", "main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    try:
        # Imported here: Ctrl-C while a command is imported ends it as later.
        from vofem.cli import program

        with prompt_end():
            return program.main(argv)
    except KeyboardInterrupt:
        print("vofem: interrupted", file=sys.stderr)
        return INTERRUPTED
