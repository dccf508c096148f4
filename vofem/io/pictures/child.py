"""A process of its own that draws pictures, one for every request."""

from __future__ import annotations

import contextlib
import pickle
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import IO, Any

from vofem.io.probe import child_code

#: What the process says when a picture is in its file.
DRAWN = "vofem-drawn"


class Child:
    """A process that calls a function of `vofem.io.pictures.trial`; it is started at once.

    Parameters
    ----------
    call : str
        The call, as it stands in a program.
    errors : file, optional
        A file for what the process writes on its standard error. By default it shares that of this process.
    """

    def __init__(self, call: str, errors: IO[bytes] | None = None) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="vofem-")
        self._asked = self._answered = 0
        self._process: subprocess.Popen[str] | None = None
        with contextlib.suppress(OSError):
            self._process = subprocess.Popen(
                [sys.executable or "python", "-c", child_code(call)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
            )

    def ask(self, what: Any) -> Path:
        """Request a picture of an object; return the file in which the picture will be."""
        self._asked += 1
        source = Path(self._folder.name) / f"{self._asked}.request"
        goal = source.with_suffix(".png")
        source.write_bytes(pickle.dumps(what))
        # If the process has ended, `answer` returns "" later.
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.write(f"{source}\t{goal}\n")
                self._process.stdin.flush()
        return goal

    def answer(self) -> str:
        """Return the next message of the process, which begins with ``vofem-``; "" if it has ended.

        A picture is in its file if the message is `DRAWN`.
        """
        if self._process is None or self._process.stdout is None:
            return ""
        for line in self._process.stdout:
            if line.startswith("vofem-"):
                self._answered += line.strip() == DRAWN
                return line.strip()
        return ""

    def exit_code(self) -> int | None:
        """Wait until the process has ended; return its exit code, or None if it was never started."""
        return None if self._process is None else self._process.wait()

    def end(self, *, at_once: bool) -> None:
        """End the process, either after its last picture or at once, and remove its files."""
        if self._process is not None:
            # If all pictures are there, or none was requested, the process would only import or clean up libraries.
            if at_once or self._answered == self._asked:
                self._process.kill()
            # A process whose pictures are done may crash as it ends.
            with contextlib.suppress(OSError), self._process:
                pass
        self._folder.cleanup()
