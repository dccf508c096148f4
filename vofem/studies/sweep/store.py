"""The store of a sweep: one HDF5 file with a row for every point, which xarray reads as it is."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import filelock
import h5py
import numpy as np
from numpy.typing import NDArray

from vofem.errors import OutputError, StorageError
from vofem.files.hdf5 import FILTERS, end_of_data, writing
from vofem.files.whole import target, try_to_write
from vofem.studies.sweep.content import node_of, value_of
from vofem.studies.sweep.journal import Entry, Journal, complete
from vofem.studies.sweep.points import points_of
from vofem.studies.sweep.sweep import Sweep, agreeing, columns_of, sweep_of
from vofem.studies.sweep.worker import RESERVED, Row

_SUFFIXES = (".h5", ".hdf5", ".nc")

#: Version of the format. It is increased when this version could not read the new files.
FORMAT = 1

#: Shortest time in s between two writings of the whole table, and largest share of the time that they may take.
_INTERVAL, _SHARE = 30.0, 0.05


class SweepFile:
    """A store of rows in one file; only one process opens it at a time.

    Parameters
    ----------
    path : path
        A new file or a store. Its name ends in .h5, .hdf5 or .nc.
    identity : dict
        Identity of the function. A file with rows of another function is renamed and not used.

    Attributes
    ----------
    notes : list of str
        What was found when the file was opened.

    Raises
    ------
    ArgumentError
        For another suffix.
    OutputError
        If the file cannot be written, or another process has it open.
    StorageError
        If the file is no store, damaged, or of a newer vofem. It stays as it is.
    """

    def __init__(self, path: Any, identity: dict[str, str]) -> None:
        self.path = target(path, _SUFFIXES)
        self.notes: list[str] = []
        self._identity = identity
        self._entries: dict[str, Entry] = {}
        self._journal: Journal | None = None
        self._pending = 0
        self._lock = _locked(self.path)
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def _open(self) -> None:
        if self.path.exists():
            identity, entries = _read(self.path)
            if identity == self._identity:
                self._entries = {entry[0]: entry for entry in entries}
            else:
                self._set_aside(identity)
        if not self.path.exists():
            self._write()
        self._journal = Journal(self.path)
        recent = self._journal.read()
        self._entries.update((entry[0], entry) for entry in recent)
        self._pending = len(recent)
        self._written, self._cost = time.monotonic(), 0.0

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

    def forget_failed(self) -> None:
        """From now on treat failed rows as missing."""
        kept = {key: entry for key, entry in self._entries.items() if entry[2].values is not None}
        self._pending += len(self._entries) - len(kept)
        self._entries = kept

    def add(self, rows: Sequence[Entry]) -> None:
        """Store rows, so that they are still there if the process ends at once."""
        assert self._journal is not None
        self._journal.append(rows)
        self._entries.update((entry[0], entry) for entry in rows)
        self._pending += len(rows)
        waited = time.monotonic() - self._written
        if waited > _INTERVAL and waited > self._cost / _SHARE:
            self._fold()

    def _fold(self) -> None:
        """Write the table whole, the records of the journal included."""
        begun = time.monotonic()
        self._write()
        if self._journal is not None:
            self._journal.close()
        self._journal = Journal(self.path)
        self._pending = 0
        self._written = time.monotonic()
        self._cost = self._written - begun

    def _write(self) -> None:
        with writing(self.path, overwrite=True) as blocks:
            _write_table(blocks.file, self._identity, list(self._entries.values()))

    def finish(self, keys: Sequence[str]) -> None:
        """Write the table whole, rows of these keys first and in their order.

        Raises
        ------
        OutputError
            If it cannot be written; the rows stay in the file as they were added.
        """
        ordered = {key: self._entries[key] for key in keys if key in self._entries}
        changed = self._pending or list(ordered) != list(self._entries)[: len(ordered)]
        self._entries = ordered | self._entries
        if changed:
            self._fold()

    def close(self) -> None:
        """Let other processes open the file."""
        if self._journal is not None:
            self._journal.close()
        # Windows does not remove open files; there the next process takes over the file that is left.
        with contextlib.suppress(OSError):
            os.unlink(self._lock.lock_file)
        self._lock.release()


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
    file.attrs["vofem_kind"] = "sweep"
    file.attrs["vofem_format"] = FORMAT
    file.attrs["vofem_function"] = json.dumps(identity)
    rows = agreeing([row for _, _, row in entries])
    scale = _variable(file, "sweep_row", np.arange(len(entries)), None)
    scale.make_scale("sweep_row")
    present = np.array([row.values is not None for row in rows], dtype=bool)
    _variable(file, "sweep_key", np.array([key for key, _, _ in entries], dtype=str), scale)
    _variable(file, "sweep_point", np.array([json.dumps(node_of(point)) for _, point, _ in entries], dtype=str), scale)
    _variable(file, "sweep_failed", ~present, scale)
    _variable(file, "sweep_error", np.array([row.error for row in rows], dtype=str), scale)
    _variable(file, "sweep_traceback", np.array([row.traceback for row in rows], dtype=str), scale)
    _variable(file, "sweep_seconds", np.array([row.seconds for row in rows], dtype=float), scale)
    names = list(dict.fromkeys(name for _, point, _ in entries for name in point))
    for name in names:
        column = _parameter([point.get(name) for _, point, _ in entries])
        if column is not None:
            _variable(file, name, column, scale).attrs["vofem_role"] = "parameter"
    for name, values in columns_of([row for row in rows if row.values is not None]).items():
        column = np.zeros((len(rows), *values.shape[1:]), dtype=values.dtype)
        if values.dtype.kind in "fc":
            column[~present] = np.nan
        column[present] = values
        _variable(file, name, column, scale).attrs["vofem_role"] = "quantity"


def _variable(file: h5py.File, name: str, values: NDArray, scale: h5py.Dataset | None) -> h5py.Dataset:
    """Write one variable; its dimensions beyond the first get scales of their own."""
    kind = values.dtype.kind
    options = FILTERS if values.size else {}
    if kind == "U":
        data = values.astype(object)
        dataset = file.create_dataset(name, data=data, dtype=h5py.string_dtype(), shape=values.shape)
    else:
        dataset = file.create_dataset(name, data=values.astype(np.int8) if kind == "b" else values, **options)
    if kind == "b":
        dataset.attrs["dtype"] = "bool"
    for axis in range(values.ndim) if scale is not None else ():
        if axis > 0:
            inner = file.create_dataset(f"{name}_{axis - 1}", data=np.arange(values.shape[axis]))
            inner.make_scale(f"{name}_{axis - 1}")
            inner.attrs["vofem_role"] = "dimension"
        dataset.dims[axis].attach_scale(scale if axis == 0 else inner)
    return dataset


def _parameter(values: Sequence[Any]) -> NDArray | None:
    """Return a parameter as a column where all its values are numbers or all are texts, else None."""
    if all(isinstance(value, (bool, int, float)) for value in values) or all(isinstance(v, str) for v in values):
        column = np.asarray(values)
        return column if column.dtype.kind in "biufU" else None
    return None


def _read(path: Path) -> tuple[dict[str, str], list[Entry]]:
    """Return the identity of the function and the rows of the table of a store, without those of its journal."""
    if not path.is_file():
        raise StorageError(f"{path} is no regular file, expected the store of a sweep; give another name")
    end_of_data(path)  # compares the checksum before HDF5 opens the file
    with h5py.File(path, "r") as file:
        if file.attrs.get("vofem_kind") != "sweep":
            raise StorageError(f"{path} is no store of a sweep; give another name, or remove the file")
        if int(file.attrs["vofem_format"]) > FORMAT:
            raise StorageError(f"{path} was written by a newer vofem; update vofem, or give another name")
        identity = json.loads(file.attrs["vofem_function"])
        named = {name: file[name] for name in file if file[name].attrs.get("vofem_role") == "quantity"}
        columns = {name: _values(dataset) for name, dataset in named.items()}
        texts = {name: file[f"{RESERVED}{name}"].asstr()[()] for name in ("key", "point", "error", "traceback")}
        lost = file[f"{RESERVED}failed"][()].astype(bool)
        seconds = file[f"{RESERVED}seconds"][()]
    entries: list[Entry] = []
    for k, key in enumerate(texts["key"]):
        values = None if lost[k] else {name: column[k] for name, column in columns.items()}
        row = Row(values, texts["error"][k], texts["traceback"][k], float(seconds[k]))
        entries.append((key, value_of(json.loads(texts["point"][k])), row))
    return identity, entries


def holds_sweep(path: Any) -> bool:
    """Return whether a file is the store of a sweep that can be read."""
    with contextlib.suppress(OSError, StorageError, TypeError, ValueError):
        if not Path(path).is_file():
            # To open a pipe would wait for its other end.
            return False
        end_of_data(Path(path))  # compares the checksum before HDF5 opens the file
        with h5py.File(path, "r") as file:
            return bool(file.attrs.get("vofem_kind") == "sweep")
    return False


def stored_sweep(path: Path) -> Sweep:
    """Return the table of a store, which another process may be writing, without the function that computed it.

    Raises
    ------
    StorageError
        If the file is no store, or holds no row.
    """
    identity, entries = _read(path)
    with path.open("rb") as file:
        file.seek(end_of_data(path))
        recent, _ = complete(file.read())
    known = {entry[0]: entry for entry in [*entries, *recent]}
    if not known:
        raise StorageError(f"{path} holds no row yet; run the sweep of {identity['name']} with this store again")
    points = points_of([point for _, point, _ in known.values()])
    rows = [known[key][2] for key in points.keys]
    counters = {"computed": 0, "stored": len(rows), "batches": 0, "restarts": 0}
    return sweep_of(points, rows, counters)


def _values(dataset: h5py.Dataset) -> NDArray:
    """Return the values of a variable with the type that they had."""
    if h5py.check_string_dtype(dataset.dtype) is not None:
        return np.asarray(dataset.asstr()[()]).astype(str)
    values = np.asarray(dataset[()])
    return values.astype(bool) if dataset.attrs.get("dtype") == "bool" else values
