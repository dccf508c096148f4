"""The course of a sweep: rows from the store, the rest from an engine, and all of them into a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from vofem.blas import blas_threads
from vofem.progress import SweepProgress, TerminalBar
from vofem.sharing import sharing_between_scenes
from vofem.studies.sweep.engines import Engine
from vofem.studies.sweep.points import Points
from vofem.studies.sweep.schedule import Schedule
from vofem.studies.sweep.sweep import NOT_REACHED, Sweep, SweepInterrupted, sweep_of
from vofem.studies.sweep.worker import Row, Task


class RowStore(Protocol):
    """Keeps rows by the key of their point.

    Attributes
    ----------
    path : path
        Where they are kept, for messages.
    """

    path: Any

    def rows(self) -> dict[str, Row]:
        """Return what is stored, by key."""

    def add(self, rows: Sequence[tuple[str, dict[str, Any], Row]]) -> None:
        """Store keys, points and rows, so that they are still there if the process ends at once."""


def run_sweep(task: Task, points: Points, engine: Engine, store: RowStore | None, progress: SweepProgress) -> Sweep:
    """Return the outcome of a sweep.

    Raises
    ------
    SweepInterrupted
        After Ctrl-C.
    """
    known = {} if store is None else store.rows()
    wanted: dict[str, int] = {}
    for k, key in enumerate(points.keys):
        if key not in known:
            wanted.setdefault(key, k)
    positions = list(wanted.values())
    stored = sum(key in known for key in points.keys)
    failures = sum(key in known and known[key].values is None for key in points.keys)
    done = stored

    def keep(batch: Sequence[int], rows: Sequence[Row]) -> None:
        nonlocal done, failures
        entries = [
            (points.keys[positions[k]], points.rows[positions[k]], row) for k, row in zip(batch, rows, strict=True)
        ]
        if store is not None:
            store.add(entries)
        known.update((key, row) for key, _, row in entries)
        done += len(entries)
        failures += sum(row.values is None for row in rows)

    def outcome(schedule: Schedule) -> Sweep:
        rows = [known.get(key, NOT_REACHED) for key in points.keys]
        counters = {"computed": done - stored, "stored": stored}
        counters |= {"batches": schedule.batches, "restarts": schedule.restarts}
        return _with_notes(sweep_of(points, rows, counters), schedule)

    label = "sweep", "the points done, all points and the points that failed"
    counting = "{task.completed:.0f} of {task.total:.0f} points"
    reported: tuple[int, ...] = ()
    with TerminalBar(label, progress, len(points.rows), counting, stored) as bar:

        def show() -> None:
            nonlocal reported
            now = done, len(points.rows), failures
            bar.update(done, f"{failures} failed" if failures else "", report=() if now == reported else now)
            reported = now

        schedule = Schedule(engine, task, [points.rows[k] for k in positions], keep, show)
        finished = False
        try:
            # Threads of an executor compute in this process: they all find the limit set.
            with blas_threads(0), sharing_between_scenes():
                schedule.run()
            finished = True
        except KeyboardInterrupt:
            raise SweepInterrupted(outcome(schedule), None if store is None else store.path) from None
        finally:
            engine.close(at_once=not finished)
            show()
    return outcome(schedule)


def _with_notes(table: Sweep, schedule: Schedule) -> Sweep:
    notes = []
    if table.failed:
        count, total, first = len(table.failed), len(table.points.rows), table.failed[0].error
        notes.append(f"{count} of {total} points failed, the first with {first!r}; see `failed`")
    if schedule.restarts:
        notes.append(f"workers had to be started anew {schedule.restarts} times; their points were computed again")
    return table.with_notes(notes)
