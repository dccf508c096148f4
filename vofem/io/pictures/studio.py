"""A separate process that draws with VTK while this one does other work.

VTK takes a while to be imported. Without a working graphics driver it ends its process with a segmentation fault. It
therefore runs in a process of its own.
"""

from __future__ import annotations

import contextlib
import pickle
import subprocess
import sys
import tempfile
from pathlib import Path
from types import TracebackType

from vofem.io.pictures.drawing import Drawing
from vofem.io.probe import Probe, child_code, forget, prepare_environment, remember, remembered, verdict


class Studio:
    """Draws pictures in a process of its own, which is started at once; a context manager.

    Attributes
    ----------
    found : Probe or None
        Whether VTK works. If it is stored that VTK does not work on this machine, this is known at once. Otherwise it
        is None until the first picture has been drawn.
    """

    def __init__(self) -> None:
        prepare_environment()
        known = remembered()
        # If VTK is known not to work on this machine, no process is started.
        self.found: Probe | None = known if known is not None and not known.works else None
        self._folder = tempfile.TemporaryDirectory(prefix="vofem-")
        self._asked = 0
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115
        self._child: subprocess.Popen[str] | None = None
        if self.found is not None:
            return
        window = known.detail if known is not None else ""
        with contextlib.suppress(OSError):
            self._child = subprocess.Popen(
                [sys.executable or "python", "-c", child_code(f"serve({window!r})")],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                text=True,
            )

    def ask(self, drawing: Drawing) -> Path:
        """Request a picture; return its file. `wait` returns pictures in the order of the requests."""
        self._asked += 1
        source = Path(self._folder.name) / f"{self._asked}.drawing"
        goal = source.with_suffix(".png")
        source.write_bytes(pickle.dumps(drawing))
        # If the process has ended, `wait` notices it later.
        if self._child is not None and self._child.stdin is not None:
            with contextlib.suppress(OSError):
                self._child.stdin.write(f"{source}\t{goal}\n")
                self._child.stdin.flush()
        return goal

    def wait(self) -> bool:
        """Wait for the next picture; return whether it was drawn."""
        if self.found is None:
            self.found = self._greeting()
        if not self.found.works:
            return False
        if self._line() == "vofem-drawn":
            return True
        self.found = self._failure("")
        # The next process draws a trial picture again, and the outcome is stored.
        forget()
        return False

    def _line(self) -> str:
        if self._child is None or self._child.stdout is None:
            return ""
        for line in self._child.stdout:
            if line.startswith("vofem-"):
                return line.strip()
        return ""

    def _greeting(self) -> Probe:
        """Return the first message of the process: the outcome of its trial picture, or what is known already."""
        line = self._line()
        found = verdict(0, line, "") if line else self._failure(line)
        remember(found)
        return found

    def _failure(self, output: str) -> Probe:
        if self._child is None:
            return Probe(False, "a trial process could not be started")
        code = self._child.wait()
        self._errors.seek(0)
        return verdict(code or 1, output, self._errors.read().decode(errors="replace"))

    def __enter__(self) -> Studio:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._child is not None:
            # If no picture was requested, the process need not be ready.
            if kind is not None or not self._asked:
                self._child.kill()
            # A process whose pictures are done may crash as it ends.
            with contextlib.suppress(OSError), self._child:
                pass
        self._errors.close()
        self._folder.cleanup()
