"""A lock that only one process holds at a time, and that ends with its process."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from vofem.errors import OutputError


class FileLock:
    """Keeps other processes from writing the same file.

    The lock is a file beside it, ``NAME.lock``, which the operating system
    locks for this process: a process that is killed leaves no lock behind.

    Parameters
    ----------
    path : Path
        The file to be written.

    Raises
    ------
    OutputError
        If another process holds the lock, or the folder cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.with_name(path.name + ".lock")
        self._descriptor: int | None = self._acquire(path)

    def _acquire(self, path: Path) -> int:
        while True:
            try:
                descriptor = os.open(self._file, os.O_RDWR | os.O_CREAT, 0o666)
            except OSError as error:
                raise OutputError(
                    f"{path} cannot be written: {error.strerror or error}; check the folder {path.parent}"
                ) from error
            if not _lock(descriptor):
                holder = _content(descriptor)
                os.close(descriptor)
                raise OutputError(
                    f"{path} is being written by another process{f' ({holder})' if holder else ''}; "
                    "wait until that one has ended, or give another file"
                )
            # The process that held the lock may have removed the file since it was opened here.
            if self._is_current(descriptor):
                break
            os.close(descriptor)
        with contextlib.suppress(OSError):
            os.truncate(descriptor, 0)
            os.write(descriptor, f"process {os.getpid()}\n".encode())
        return descriptor

    def _is_current(self, descriptor: int) -> bool:
        try:
            return os.path.samestat(os.fstat(descriptor), os.stat(self._file))
        except FileNotFoundError:
            return False

    def release(self) -> None:
        """Let other processes write."""
        if self._descriptor is not None:
            # Removed while it is still locked, so that no other process locks a file that is about to go. Windows does
            # not remove open files; there the next process takes over the file that is left.
            with contextlib.suppress(OSError):
                self._file.unlink()
            os.close(self._descriptor)
            self._descriptor = None


#: The byte that is locked on Windows. It lies beyond the content, because a locked byte cannot be read there.
_LOCKED_BYTE = 1 << 20


def _content(descriptor: int) -> str:
    try:
        return os.read(descriptor, 32).decode("ascii", "replace").strip()
    except OSError:
        return ""


def _lock(descriptor: int) -> bool:
    """Return whether the operating system has locked a file for this process."""
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        except OSError:
            return False
        finally:
            os.lseek(descriptor, 0, os.SEEK_SET)
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
