"""The command line: ``vofem run``, ``explain``, ``verify`` and more. Only this package prints and ends processes."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence

from vofem.cli.common import FAULT, FINE, INTERRUPTED
from vofem.cli.prompt_end import end_now, pressed, prompt_end

__all__ = ["FAULT", "FINE", "INTERRUPTED", "main", "script"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    with prompt_end():
        code = _code(argv)
    if "vofem.linalg.aside" in sys.modules and sys.modules["vofem.linalg.aside"].left_behind():
        # The interpreter would wait for work that Ctrl-C has left behind.
        sys.stdout.flush()
        sys.stderr.flush()
        end_now(code)
    return code


def script() -> int:
    """Run the command of this process and return its exit code."""
    code = main()
    # While the interpreter ends, Ctrl-C would only add a traceback.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return code


def _code(argv: Sequence[str] | None) -> int:
    """Run a command and return its exit code, that of Ctrl-C included."""
    try:
        # Imported here: Ctrl-C while a command is imported ends it as later.
        from vofem.cli import program

        return program.main(argv)
    except KeyboardInterrupt:
        pass
    except Exception:
        if not pressed():
            raise
    print("vofem: interrupted", file=sys.stderr)
    return INTERRUPTED
