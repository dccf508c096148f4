"""HDF5 files, written whole or not at all, and read with errors that say what is wrong.

A trailer of `_MAGIC` and a CRC-32 of all that stands before it follows the
data. It is compared before HDF5 opens the file, because HDF5 may end the
process where it meets a damaged one. HDF5 ignores what follows its data, and
removes the trailer when another program changes the file, which is then read
without the comparison.
"""

from __future__ import annotations

import contextlib
import io
import os
import stat
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from vofem._version import __version__
from vofem.errors import StorageError, VofemError
from vofem.files.whole import path_of, replacing

#: Object headers of this and later versions carry checksums. VTK and netCDF read them.
_VERSIONS = ("v108", "v110")

#: How every dataset with elements is compressed: quickly.
FILTERS: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}

_MAGIC = b"vofem crc32:"
_TRAILER = struct.Struct(f"<{len(_MAGIC)}sI")

#: The first bytes of a file of HDF5 1.8 and later, and where these state the size of the data.
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_SUPERBLOCK = struct.Struct("<8sBBBBQQQ")

#: Names of the groups by which files are known, and what these hold. The store of a sweep has no such group.
RUN, CHECKPOINT, BRANCH, LOCUS, FIT = "vofem", "vofem_checkpoint", "vofem_branch", "vofem_locus", "vofem_fit"
SWEEP = "sweep"
KINDS = {
    RUN: "a saved run, which vofem.load reads",
    CHECKPOINT: "a checkpoint, from which vofem.resume goes on",
    BRANCH: "a branch of steady states, which vofem.load reads",
    LOCUS: "a locus of special points, which vofem.load reads",
    FIT: "a fit, which vofem.load reads",
    SWEEP: "the store of a sweep, which vofem.load reads",
}

#: What `vofem.load` expects.
SAVED = "a file that Result.save, Branch.save, Locus.save, Fit.save or vofem.sweep has written"

#: Size in bytes of a chunk, which is read or compressed as a whole, and of a block, after which the file is flushed.
_CHUNK, _BLOCK = 1 << 20, 1 << 23


class GuardedFile(io.RawIOBase):
    """A file object that hides the errors of writing from h5py, and keeps the first one in `error` for the caller.

    h5py crashes when a disk is full: HDF5 can then neither finish nor close its file. So h5py is told that all went
    well, and whatever it writes after the error is dropped.

    `path`: path of a file that exists.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("r+b", buffering=0)
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of the bytes."""
        view = memoryview(data).cast("B")
        done = 0
        while done < len(view) and self.error is None:
            try:
                done += self._file.write(view[done:])
            except OSError as error:
                self.error = error
        return len(view)

    def readinto(self, buffer: Any) -> int:
        """Read into a buffer; zeros where an error has kept bytes from being written."""
        view = memoryview(buffer).cast("B")
        count = self._file.readinto(view) or 0
        view[count:] = bytes(len(view) - count)
        return len(view)

    def seek(self, offset: int, whence: int = 0) -> int:
        """Move to a place."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Return the place."""
        return self._file.tell()

    def truncate(self, size: int | None = None) -> int:
        """Change the size."""
        if self.error is None:
            try:
                return self._file.truncate(size)
            except OSError as error:
                self.error = error
        return size or 0

    def seal(self) -> None:
        """Write the trailer behind what is there."""
        checksum = _checksum(self._file, self._file.seek(0, os.SEEK_END))
        self.write(_TRAILER.pack(_MAGIC, checksum))

    def check(self) -> None:
        """Raise the error that was met, if any."""
        if self.error is not None:
            raise self.error

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()


class Blocks:
    """An HDF5 file that is being written."""

    def __init__(self, file: h5py.File, guard: GuardedFile) -> None:
        self.file = file
        self._guard = guard

    def flush(self) -> None:
        """Hand what was written so far to the system; raise the error met on the way, if any."""
        self.file.flush()
        self._guard.check()


@contextlib.contextmanager
def writing(path: Path, *, overwrite: bool = False) -> Iterator[Blocks]:
    """Give a new HDF5 file, which takes the name `path` once the block has succeeded.

    Raises `OutputError` if the file exists and is not to be overwritten, or cannot be written. What was there stays.
    """
    with replacing(path, overwrite=overwrite) as temporary:
        guard = GuardedFile(temporary)
        try:
            with h5py.File(guard, "w", libver=_VERSIONS, track_order=True) as file:
                yield Blocks(file, guard)
            guard.check()
            guard.seal()
        except Exception:
            # What HDF5 complains of after a failed write is a consequence.
            guard.check()
            raise
        finally:
            guard.close()
        guard.check()


@contextlib.contextmanager
def reading(path: str | os.PathLike[str], expected: str = SAVED) -> Iterator[h5py.File]:
    """Give an HDF5 file that is open for reading; whatever fails in the block becomes a `StorageError`.

    `expected`: what messages say was expected.
    Raises `ArgumentError` if no file can have that name.
    Raises `StorageError` if the file is missing, no HDF5 file, or damaged.
    """
    place = path_of(path, expected)
    try:
        if not stat.S_ISREG(os.stat(place).st_mode):
            what = "is a folder" if place.is_dir() else "is no regular file"
            raise StorageError(f"{place} {what}, expected {expected}; check the path")
        _verify(place)
        with h5py.File(place, "r") as file:
            yield file
    except VofemError:
        raise
    except (FileNotFoundError, NotADirectoryError):
        raise StorageError(f"{place} does not exist, expected {expected}; check the path") from None
    except Exception as error:
        raise StorageError(f"{place} {_complaint(place, error, expected)}") from error


def _checksum(file: Any, size: int) -> int:
    """Return the CRC-32 of the first `size` bytes of a file; afterwards its place is behind them."""
    file.seek(0)
    checksum = 0
    while size > 0:
        data = file.read(min(size, _CHUNK))
        if not data:
            break
        checksum = zlib.crc32(data, checksum)
        size -= len(data)
    return checksum


def _verify(place: Path) -> None:
    """Raise `StorageError` where a file has a trailer that does not fit its data, or remains of a trailer."""
    with place.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        if size < _SUPERBLOCK.size + _TRAILER.size:
            return
        file.seek(size - _TRAILER.size)
        magic, checksum = _TRAILER.unpack(file.read(_TRAILER.size))
        if magic == _MAGIC:
            sound = _checksum(file, size - _TRAILER.size) == checksum
        else:
            # A file without a trailer, which another program has written or changed, ends with its data.
            file.seek(0)
            signature, version, width, _, _, base, _, end = _SUPERBLOCK.unpack(file.read(_SUPERBLOCK.size))
            sound = signature != _SIGNATURE or version not in (2, 3) or width != 8 or base + end >= size
    if not sound:
        raise StorageError(
            f"{place} is damaged: its checksum is not that of the data, so bytes have changed since it was written; "
            "take an undamaged copy, or run and write it again"
        )


def _complaint(place: Path, error: Exception, expected: str) -> str:
    text = str(error)
    # Errors of the system itself name the file, and those of the library do not.
    if isinstance(error, OSError) and (isinstance(error, PermissionError) or error.filename is not None):
        return f"may not be read: {error.strerror}; check the path and its permissions"
    if "signature" in text or not h5py.is_hdf5(place):
        return f"is no HDF5 file, expected {expected}"
    if "truncated" in text:
        return "is cut off: it was copied in part; copy or save it again"
    return f"is damaged ({type(error).__name__}: {text.strip()[:200]}); take a copy, or save the run again"


def mark_format(group: h5py.Group, version: int) -> None:
    """Write the version of the format of a group, and that of vofem."""
    group.attrs["format"] = version
    group.attrs["written_by"] = __version__


def kind_of(file: h5py.File) -> str:
    """Return which of `KINDS` a file that is open holds; "" where it is none of them."""
    return SWEEP if file.attrs.get("kind") == SWEEP else next((name for name in KINDS if name in file), "")


def checked_group(file: h5py.File, kinds: Sequence[str], known: int, expected: str) -> h5py.Group:
    """Return the group of a file that holds one of some kinds, in the format that is known.

    `expected`: what messages say was expected.
    Raises `StorageError` if the file holds something else, or was written in another format.
    """
    kind = kind_of(file)
    if kind not in kinds:
        what = KINDS.get(kind, "an HDF5 file of another program")
        raise StorageError(f"{file.filename} is {what}; expected {expected}")
    group = file if kind == SWEEP else file[kind]
    if int(group.attrs["format"]) != known:
        written = f"vofem {group.attrs['written_by']} in format {group.attrs['format']}"
        raise StorageError(
            f"{file.filename} was written by {written}, but this is vofem {__version__}, which reads format {known}; "
            "read it with the version that wrote it, or write it again"
        )
    return group


def block_slices(count: int, row_bytes: int) -> Iterator[slice]:
    """Yield slices of rows, each of a bounded size."""
    step = max(1, _BLOCK // max(row_bytes, 1))
    for start in range(0, count, step):
        yield slice(start, min(start + step, count))


def chunks(shape: tuple[int, ...], itemsize: int) -> tuple[int, ...]:
    """Return the shape of a chunk of an array without zeros in its shape: whole rows as far as these fit."""
    inner = list(shape[1:])
    if inner:
        inner[0] = min(inner[0], max(1, _CHUNK // itemsize))
    rows = max(1, _CHUNK // (itemsize * int(np.prod(inner, dtype=np.int64))))
    return (min(shape[0], rows), *inner)


def texts_of(values: NDArray) -> NDArray:
    """Return texts for HDF5, without characters that it cannot hold."""
    texts = [text.encode("utf-8", "replace").replace(b"\0", b"?") for text in values.ravel().tolist()]
    return np.array(texts, dtype=object).reshape(values.shape)


def empty_dataset(group: h5py.Group, name: str, shape: tuple[int, ...], dtype: Any) -> h5py.Dataset:
    """Return a new dataset, to be written by rows."""
    dtype = np.dtype(dtype)
    filters = {"chunks": chunks(shape, dtype.itemsize), **FILTERS} if all(shape) else {}
    return group.create_dataset(name, shape=shape, dtype=dtype, **filters)


def write_rows(blocks: Blocks, group: h5py.Group, name: str, rows: NDArray) -> None:
    """Write an array as a dataset, some rows at a time."""
    dataset = empty_dataset(group, name, rows.shape, rows.dtype)
    if rows.size:
        for part in block_slices(rows.shape[0], int(np.prod(rows.shape[1:])) * rows.dtype.itemsize):
            dataset[part] = rows[part]
            blocks.flush()
