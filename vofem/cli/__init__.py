"""The command line: ``vofem run``, ``explain``, ``verify`` and more. Only this package prints and ends processes."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from vofem.cli.common import FAULT, FINE, INTERRUPTED
from vofem.cli.prompt_end import prompt_end

__all__ = ["FAULT", "FINE", "INTERRUPTED", "main"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    code = _code(argv)
    if "vofem.linalg.aside" in sys.modules and sys.modules["vofem.linalg.aside"].left_behind():
        # The interpreter would wait for an eigenproblem that Ctrl-C has left behind.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


def _code(argv: Sequence[str] | None) -> int:
    """Run a command and return its exit code, that of Ctrl-C included."""
    try:
        # Imported here: Ctrl-C while a command is imported ends it as later.
        from vofem.cli import program

        with prompt_end():
            return program.main(argv)
    except KeyboardInterrupt:
        print("vofem: interrupted", file=sys.stderr)
        return INTERRUPTED
