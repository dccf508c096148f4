"""The command line: ``vofem run``, ``explain``, ``verify`` and more. Only this package prints and ends processes.

The first Ctrl-C ends the step that is being computed or the file that is being written. A command then writes what it
has, and returns 130. The second Ctrl-C ends the process. Python hears of Ctrl-C when machine code, such as that of a
compiler or an eigenproblem, has returned to it.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Sequence
from typing import Any

from vofem.cli.common import FAULT, FINE, INTERRUPTED
from vofem.errors import VofemError

__all__ = ["FAULT", "FINE", "INTERRUPTED", "main", "script"]


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code."""
    before, presses = signal.getsignal(signal.SIGINT), _Presses()
    # A process that was started in the background ignores Ctrl-C.
    handled = before is signal.default_int_handler and threading.current_thread() is threading.main_thread()
    if handled:
        signal.signal(signal.SIGINT, presses)
    try:
        return _code(argv, presses)
    finally:
        if handled:
            signal.signal(signal.SIGINT, before)


def script() -> int:
    """Run the command of this process and return its exit code."""
    code = main()
    # While the interpreter ends, Ctrl-C would only add a traceback.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    return code


class _Presses:
    """The handler of Ctrl-C in a command, which counts how often it was pressed.

    Runs and other loops defer the first press to the end of a step; see `vofem.integrators.observer`.
    """

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, number: int, frame: Any) -> None:
        """Interrupt the command, or end the process: no exception can get lost then."""
        self.count += 1
        if self.count == 1:
            raise KeyboardInterrupt
        whole = sys.modules.get("vofem.files.whole")
        if whole is not None:
            whole.remove_unfinished()
        # A bar of progress may have hidden the cursor.
        cursor = "\x1b[?25h\n" if sys.stderr.isatty() else ""
        with contextlib.suppress(OSError):
            os.write(2, f"{cursor}vofem: interrupted\n".encode())
        os._exit(INTERRUPTED)


def _code(argv: Sequence[str] | None, presses: _Presses) -> int:
    """Run a command, turn errors into messages, and return its exit code."""
    try:
        # Imported here: Ctrl-C while a command is imported ends it as later.
        from vofem.cli.program import run_command

        code = run_command(argv)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        pass
    except VofemError as error:
        print(f"vofem: {error}", file=sys.stderr)
        return FAULT
    except BrokenPipeError:
        # The program that reads the output has ended, as in `vofem explain ... | head`, so nothing more can be printed.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FINE
    except Exception:
        # Code in C, such as that of matplotlib, may turn a KeyboardInterrupt into another error.
        if not presses.count:
            raise
    print("vofem: interrupted", file=sys.stderr)
    return INTERRUPTED
