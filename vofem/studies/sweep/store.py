"""The store of a sweep: an HDF5 file with a row for every point, which xarray reads as it is.

While a sweep runs, new rows are kept by SQLite in a file beside the store. A process may end at any moment and loses
at most the batch that it was storing. The table is written whole at the end of the sweep, or when the store is opened
the next time.
"""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import filelock
import h5netcdf
import h5py
import numpy as np
from numpy.typing import NDArray

from vofem.errors import OutputError, StorageError
from vofem.files.hdf5 import FILTERS, SWEEP, checked_group, mark_format, reading, texts_of, writing
from vofem.files.whole import target, try_to_write
from vofem.studies.sweep.points import node_of, points_of, value_of
from vofem.studies.sweep.sweep import Sweep, agreeing, columns_of, sweep_of
from vofem.studies.sweep.worker import RESERVED, Row

_SUFFIXES = (".h5", ".hdf5", ".nc")

#: Version of the format. It is increased when this version could not read the new files.
FORMAT = 2

#: What is kept of every row beside its quantities.
_KEPT = ("key", "point", "failed", "error", "traceback", "seconds")

#: Longest time in s for which a batch that is stored waits until another process has read the rows.
_PATIENCE = 60.0

#: A key, a point and its row.
Entry = tuple[str, dict[str, Any], Row]


class SweepFile:
    """A store of rows; only one process opens it at a time.

    `path`: a new file or a store. Its name ends in .h5, .hdf5 or .nc.
    `identity`: identity of the function. A file with rows of another function is renamed and not used.
    `notes`: what was found when the file was opened.
    Raises `ArgumentError` for another suffix.
    Raises `OutputError` if the file cannot be written, or another process has it open.
    Raises `StorageError` if the file is no store, damaged, or of a newer vofem. It stays as it is.
    """

    def __init__(self, path: Any, identity: dict[str, str]) -> None:
        self.path = target(path, _SUFFIXES)
        self.notes: list[str] = []
        self._identity = identity
        self._entries: dict[str, Entry] = {}
        self._recent = _Recent(self.path)
        self._changed = False
        self._lock = _locked(self.path)
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        if self.path.exists():
            recent = self._recent.read()
            identity, self._entries = _read(self.path)
            self._entries |= recent
            if recent:
                self._write(identity)
            if identity != self._identity:
                self._set_aside(identity)
                self._entries = {}
        if not self.path.exists():
            self._write(self._identity)

    def _set_aside(self, identity: dict[str, str]) -> None:
        """Rename the file of another function."""
        number = 1
        while (aside := self.path.with_name(f"{self.path.stem}.before-{number}{self.path.suffix}")).exists():
            number += 1
        self.path.rename(aside)
        changed = [
            name for name in ("name", "source", "vofem", "kernels") if identity.get(name) != self._identity[name]
        ]
        reasons = {"name": "another function", "source": "a changed function", "vofem": "another version of vofem"}
        reasons["kernels"] = f"kernels in {identity.get('kernels')}"
        why = " and ".join(reasons[name] for name in changed) or "another function"
        self.notes.append(
            f"the store held rows of {why}, which were kept as {aside.name}; all points are computed anew"
        )

    def rows(self) -> dict[str, Row]:
        """Return the stored rows by key."""
        return {key: row for key, (_, _, row) in self._entries.items()}

    def forget_failed(self, keys: Sequence[str]) -> None:
        """From now on treat failed rows of these keys as missing."""
        lost = set(keys)
        kept = {k: entry for k, entry in self._entries.items() if entry[2].values is not None or k not in lost}
        self._changed |= len(kept) < len(self._entries)
        self._entries = kept

    def add(self, rows: Sequence[Entry]) -> None:
        """Store rows, so that they are still there if the process ends at once.

        Raises `OutputError` if they cannot be written. What was there stays.
        """
        self._recent.add(rows)
        self._entries.update((entry[0], entry) for entry in rows)
        self._changed = True

    def finish(self, keys: Sequence[str]) -> None:
        """Write the table whole, rows of these keys first and in their order.

        Raises `OutputError` if it cannot be written; the rows stay stored as they were added.
        """
        ordered = {key: self._entries[key] for key in keys if key in self._entries}
        changed = self._changed or list(ordered) != list(self._entries)[: len(ordered)]
        self._entries = ordered | self._entries
        if changed:
            self._write(self._identity)

    def _write(self, identity: dict[str, str]) -> None:
        """Write the table whole; from then on no row is kept beside it."""
        with writing(self.path, overwrite=True) as blocks:
            _write_table(blocks.file, identity, list(self._entries.values()))
        self._recent.remove()
        self._changed = False

    def close(self) -> None:
        """Let other processes open the file."""
        self._recent.close()
        # Windows does not remove open files; there the next process takes over the file that is left.
        with contextlib.suppress(OSError):
            os.unlink(self._lock.lock_file)
        self._lock.release()


class _Recent:
    """Rows that are not in the table of a store yet, in a database of SQLite; a batch is one transaction.

    `store`: the database has the name of the store and ".sqlite" behind it.
    """

    def __init__(self, store: Path) -> None:
        self._store = store
        self.path = store.with_name(store.name + ".sqlite")
        self._connection: sqlite3.Connection | None = None

    def add(self, entries: Sequence[Entry]) -> None:
        """Store entries, all of them or none; raise `OutputError` where they cannot be stored."""
        found = [[key, point, row.values, row.error, row.traceback, row.seconds] for key, point, row in entries]
        texts = [(_text(one),) for one in found]
        try:
            if self._connection is None:
                self._connection = sqlite3.connect(self.path, timeout=_PATIENCE)
                # With a log of changes a transaction need not wait for the disk; a crash of the machine may take the
                # last ones with it.
                self._connection.execute("PRAGMA journal_mode = WAL")
                self._connection.execute("PRAGMA synchronous = NORMAL")
                self._connection.execute("CREATE TABLE IF NOT EXISTS entries (entry TEXT)")
            with self._connection:
                self._connection.executemany("INSERT INTO entries VALUES (?)", texts)
        except sqlite3.Error as error:
            raise OutputError(
                f"{self._store} cannot be written: {error}; rows stored so far are kept. Make room in "
                f"{self._store.parent}, and run again"
            ) from error

    def read(self) -> dict[str, Entry]:
        """Return all entries by key."""
        if not self.path.exists():
            return {}
        try:
            with contextlib.closing(sqlite3.connect(self.path, timeout=_PATIENCE)) as connection:
                # A process that ended while it made the database has left no table.
                made = connection.execute("SELECT name FROM sqlite_master WHERE name = 'entries'").fetchone()
                texts = connection.execute("SELECT entry FROM entries ORDER BY rowid").fetchall() if made else []
        except sqlite3.Error as error:
            raise StorageError(
                f"{self.path}, which holds the rows that {self._store.name} does not hold yet, cannot be read: "
                f"{error}; remove it to compute them again"
            ) from error
        found = [value_of(json.loads(text)) for (text,) in texts]
        return {key: (key, point, Row(*row)) for key, point, *row in found}

    def remove(self) -> None:
        """Remove the database."""
        self.close()
        # A process that reads it may have it open, which Windows minds; its rows are in the table too.
        for end in ("", "-wal", "-shm"):
            with contextlib.suppress(OSError):
                self.path.with_name(self.path.name + end).unlink(missing_ok=True)

    def close(self) -> None:
        """Close the database."""
        if self._connection is not None:
            self._connection.close()
        self._connection = None


def _text(value: Any) -> str:
    return json.dumps(node_of(value))


def _locked(path: Path) -> filelock.BaseFileLock:
    """Return a lock on the file ``NAME.lock``, which names this process. The lock ends with the process."""
    try_to_write(path)
    lock = filelock.FileLock(path.with_name(path.name + ".lock"), thread_local=False)
    try:
        lock.acquire(blocking=False)
        Path(lock.lock_file).write_text(f"process {os.getpid()}")
    except filelock.Timeout:
        holder = Path(lock.lock_file).read_text()
        raise OutputError(
            f"{path} is being written by another process ({holder}); wait until that one has ended, or give another "
            "file"
        ) from None
    except OSError as error:
        raise OutputError(
            f"{path} cannot be written: {error.strerror or error}; check the folder {path.parent}"
        ) from error
    return lock


def _write_table(file: h5py.File, identity: dict[str, str], entries: Sequence[Entry]) -> None:
    """Write rows as variables over the dimension ``sweep_row``, by the conventions of netCDF and xarray."""
    file.attrs["kind"] = SWEEP
    file.attrs["function"] = json.dumps(identity)
    mark_format(file, FORMAT)
    if not entries:
        return
    rows = agreeing([row for _, _, row in entries])
    present = np.array([row.values is not None for row in rows])
    kept = {
        "key": np.array([key for key, _, _ in entries], dtype=str),
        "point": np.array([_text(point) for _, point, _ in entries], dtype=str),
        "failed": ~present,
        "error": np.array([row.error for row in rows], dtype=str),
        "traceback": np.array([row.traceback for row in rows], dtype=str),
        "seconds": np.array([row.seconds for row in rows], dtype=float),
    }
    names = dict.fromkeys(name for _, point, _ in entries for name in point)
    parameters = {name: _parameter([point.get(name) for _, point, _ in entries]) for name in names}
    found = columns_of([row for row in rows if row.values is not None])
    # netCDF knows no complex numbers; h5netcdf writes and reads them if it may.
    beyond = any(values.dtype.kind == "c" for values in found.values())
    with h5netcdf.File(file, "a", invalid_netcdf=beyond) as table:
        _write_variable(table, f"{RESERVED}row", np.arange(len(entries)), "")
        for name in _KEPT:
            _write_variable(table, f"{RESERVED}{name}", kept[name], "")
        for name, parameter in parameters.items():
            if parameter is not None:
                _write_variable(table, name, parameter, "parameter")
        for name, values in found.items():
            column = np.zeros((len(rows), *values.shape[1:]), dtype=values.dtype)
            if values.dtype.kind in "fc":
                column[~present] = np.nan
            column[present] = values
            _write_variable(table, name, column, "quantity")


def _write_variable(table: h5netcdf.File, name: str, values: NDArray, role: str) -> None:
    """Write one variable; its dimensions beyond the first are its own, which xarray needs too."""
    kind = values.dtype.kind
    sizes = {f"{name}_{axis}": size for axis, size in enumerate(values.shape[1:])}
    dimensions = {f"{RESERVED}row": len(values)} | sizes
    for dimension, size in dimensions.items():
        if dimension not in table.dimensions:
            table.dimensions[dimension] = size
    data = texts_of(values) if kind == "U" else values.astype(np.int8) if kind == "b" else values
    dtype = h5py.string_dtype() if kind == "U" else data.dtype
    filters = {} if kind == "U" else FILTERS
    written = table.create_variable(name, tuple(dimensions), dtype, data=data, **filters)
    written.attrs.update({"role": role} if role else {})
    written.attrs.update({"dtype": "bool"} if kind == "b" else {})


def _parameter(values: Sequence[Any]) -> NDArray | None:
    """Return a parameter as a column where all its values are numbers or all are texts, else None."""
    if all(isinstance(value, (bool, int, float)) for value in values) or all(isinstance(v, str) for v in values):
        column = np.asarray(values)
        return column if column.dtype.kind in "biufU" else None
    return None


def _read(path: Path) -> tuple[dict[str, str], dict[str, Entry]]:
    """Return the identity of the function and the rows of the table of a store, without those beside it."""
    with reading(path, "the store of a sweep") as file:
        checked_group(file, (SWEEP,), FORMAT, "the store of a sweep; give another name, or remove the file")
        identity = json.loads(file.attrs["function"])
        with h5netcdf.File(file, "r", decode_vlen_strings=True, invalid_netcdf=True) as table:
            if f"{RESERVED}key" not in table.variables:
                return identity, {}
            kept = {name: _values(table[f"{RESERVED}{name}"]) for name in _KEPT}
            roles = {name: variable.attrs.get("role") for name, variable in table.variables.items()}
            columns = {name: _values(table[name]) for name, role in roles.items() if role == "quantity"}
    entries: dict[str, Entry] = {}
    for k, (key, point, lost, error, traceback, seconds) in enumerate(zip(*kept.values(), strict=True)):
        values = None if lost else {name: column[k] for name, column in columns.items()}
        row = Row(values, str(error), str(traceback), float(seconds))
        entries[str(key)] = (str(key), value_of(json.loads(point)), row)
    return identity, entries


def stored_sweep(path: Path) -> Sweep:
    """Return the table of a store, which another process may be writing, without the function that computed it.

    Raises `StorageError` if the file is no store, or holds no row.
    """
    # In this order: a table that is written meanwhile holds the rows that were beside it.
    recent = _Recent(path).read()
    identity, known = _read(path)
    known |= recent
    if not known:
        raise StorageError(f"{path} holds no row yet; run the sweep of {identity['name']} with this store again")
    points = points_of([point for _, point, _ in known.values()])
    rows = [known[key][2] for key in points.keys]
    counters = {"computed": 0, "stored": len(rows), "batches": 0, "restarts": 0}
    return sweep_of(points, rows, counters)


def _values(variable: Any) -> NDArray:
    """Return the values of a variable with the type that they had."""
    values = np.asarray(variable[...])
    if values.dtype.kind == "O":
        return values.astype(str)
    return values.astype(bool) if variable.attrs.get("dtype") == "bool" else values
