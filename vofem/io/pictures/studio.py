"""Processes that draw with VTK and with matplotlib while this one does other work.

VTK and matplotlib take a while to be imported. Without a working graphics driver VTK ends its process with a
segmentation fault. Both therefore run in processes of their own.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

from vofem.io.pictures.child import DRAWN, Child
from vofem.io.pictures.drawing import Drawing
from vofem.io.pictures.history_figure import RunView
from vofem.io.probe import Probe, forget, prepare_environment, remember, remembered, verdict


class Studio:
    """Draws pictures in two processes of its own, which are started at once; a context manager.

    Attributes
    ----------
    found : Probe or None
        Whether VTK works. If it is stored that VTK does not work on this machine, this is known at once. Otherwise it
        is None until the first side view has been drawn.
    """

    def __init__(self) -> None:
        prepare_environment()
        known = remembered()
        # If VTK is known not to work on this machine, no process is started for it.
        self.found: Probe | None = known if known is not None and not known.works else None
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115
        self._side_views: Child | None = None
        if self.found is None:
            self._side_views = Child(f"serve({known.detail if known is not None else ''!r})", self._errors)
        self._histories = Child("plot()")

    def ask(self, drawing: Drawing) -> Path | None:
        """Request a side view; return its file. `wait` returns side views in the order of the requests."""
        return None if self._side_views is None else self._side_views.ask(drawing)

    def ask_history(self, views: Sequence[RunView]) -> Path:
        """Request histories; return their file. `wait_for_history` returns them in the order of the requests."""
        return self._histories.ask(views)

    def wait(self) -> bool:
        """Wait for the next side view; return whether it was drawn."""
        if self.found is None:
            self.found = self._greeting()
        if not self.found.works:
            return False
        if self._line() == DRAWN:
            return True
        self.found = self._failure("")
        # The next process draws a trial picture again, and the outcome is stored.
        forget()
        return False

    def wait_for_history(self) -> bool:
        """Wait for the next histories; return whether they were drawn."""
        return self._histories.answer() == DRAWN

    def _line(self) -> str:
        return "" if self._side_views is None else self._side_views.answer()

    def _greeting(self) -> Probe:
        """Return the first message of the process: the outcome of its trial picture, or what is known already."""
        line = self._line()
        found = verdict(0, line, "") if line else self._failure(line)
        remember(found)
        return found

    def _failure(self, output: str) -> Probe:
        code = None if self._side_views is None else self._side_views.exit_code()
        if code is None:
            return Probe(False, "a trial process could not be started")
        self._errors.seek(0)
        return verdict(code or 1, output, self._errors.read().decode(errors="replace"))

    def __enter__(self) -> Studio:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for child in (self._side_views, self._histories):
            if child is not None:
                child.end(at_once=kind is not None)
        self._errors.close()
