"""Records at the end of an HDF5 file. Each is appended completely or not at all.

HDF5 ignores bytes that follow its data. The table of a store is written as a
whole from time to time, and single rows are appended behind it in between. A
process that is killed loses at most the record that it was writing.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vofem.errors import OutputError
from vofem.files.hdf5 import end_of_data
from vofem.studies.sweep.content import node_of, value_of
from vofem.studies.sweep.worker import Row

_MAGIC = b"vofem row:"
_HEAD = struct.Struct(f"<{len(_MAGIC)}sQI")

#: A key, a point and its row.
Entry = tuple[str, dict[str, Any], Row]


class Journal:
    """The records behind the data of a file.

    Parameters
    ----------
    path : Path
        Path of an HDF5 file that `vofem.files.hdf5.writing` has written.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("r+b", buffering=0)
        self._end = end_of_data(path)

    def read(self) -> list[Entry]:
        """Return the entries of all complete records; an incomplete record at the end is removed."""
        self._file.seek(self._end)
        entries, good = complete(self._file.read())
        self._end += good
        self._file.truncate(self._end)
        return entries

    def append(self, entries: Sequence[Entry]) -> None:
        """Add one record.

        Raises
        ------
        OutputError
            If it cannot be written. What was there stays.
        """
        payload = _encode(entries)
        record = memoryview(_HEAD.pack(_MAGIC, len(payload), zlib.crc32(payload)) + payload)
        try:
            self._file.seek(self._end)
            done = 0
            while done < len(record):
                done += self._file.write(record[done:])
            self._end += len(record)
        except OSError as error:
            self._file.truncate(self._end)
            raise OutputError(
                f"{self._path} cannot be written: {error.strerror or error}; rows stored so far are kept. Make room "
                f"in {self._path.parent}, and run again"
            ) from error
        except BaseException:
            self._file.truncate(self._end)
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def complete(data: bytes) -> tuple[list[Entry], int]:
    """Return the entries of all complete records, and the number of their bytes."""
    entries: list[Entry] = []
    good = 0
    for payload in _records(data):
        entries += _decode(payload)
        good += _HEAD.size + len(payload)
    return entries, good


def _records(data: bytes) -> Iterator[bytes]:
    """Yield the contents of whole records."""
    start = 0
    while start + _HEAD.size <= len(data):
        magic, length, checksum = _HEAD.unpack_from(data, start)
        payload = data[start + _HEAD.size : start + _HEAD.size + length]
        if magic != _MAGIC or len(payload) < length or zlib.crc32(payload) != checksum:
            return
        yield payload
        start += _HEAD.size + length


def _encode(entries: Sequence[Entry]) -> bytes:
    """Return entries as one text in JSON, its length before it, and the bytes of all arrays behind it."""
    described, blocks = [], []
    for key, point, row in entries:
        arrays = None
        if row.values is not None:
            arrays = [[name, value.dtype.str, list(value.shape)] for name, value in row.values.items()]
            blocks += [np.ascontiguousarray(value).tobytes() for value in row.values.values()]
        described.append([key, node_of(point), row.error, row.traceback, row.seconds, arrays])
    text = json.dumps(described).encode()
    return struct.pack("<Q", len(text)) + text + b"".join(blocks)


def _decode(payload: bytes) -> list[Entry]:
    (length,) = struct.unpack_from("<Q", payload)
    at = 8 + length
    entries: list[Entry] = []
    for key, point, error, traceback, seconds, arrays in json.loads(payload[8:at]):
        values = None
        if arrays is not None:
            values = {}
            for name, kind, shape in arrays:
                dtype = np.dtype(kind)
                count = int(np.prod(shape, dtype=int))
                values[name] = np.frombuffer(payload, dtype, count, at).reshape(shape).copy()
                at += count * dtype.itemsize
        entries.append((key, value_of(point), Row(values, error, traceback, seconds)))
    return entries
