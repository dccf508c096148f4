"""The place of compiled kernels on disk, and the kinds of work for which they exist, without importing numba.

numba keeps machine code in a folder whose name is a key of the sources, the versions of Python and numba, and the
processor. Beside the code stands an empty file for each kind of work for which all code has been compiled. These files
are only an estimate: code that is missing nevertheless is compiled again.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import threading
from functools import cache
from pathlib import Path
from typing import Any

#: Subpackages that contain kernels.
_ROOMS = ("kernels", "linalg", "laws", "integrators")

_ROOT = Path(__file__).parent.parent

#: Ending of the file that says that there is code for a kind of work.
_KIND = ".kind"

#: Number of keys whose folders are kept.
_MOST = 4

#: Time in s for which a process that compiles waits for another one at most.
_LONGEST = 60.0


@cache
def _source_stamp() -> tuple[float, int]:
    """Return the latest change and the total size of all sources that hold kernels."""
    found = [path.stat() for part in _ROOMS for path in (_ROOT / part).rglob("*.py")]
    return max(status.st_mtime for status in found), sum(status.st_size for status in found)


def cache_folder() -> Path | None:
    """Return the folder for compiled code of all versions of this package, or None where there is none.

    It takes the first that can be written of the folder that NUMBA_CACHE_DIR names, that of the package and that of the
    user's caches.
    """
    import platformdirs

    given = os.environ.get("NUMBA_CACHE_DIR")
    named = [Path(given)] if given else []
    users = platformdirs.user_cache_path("numba", appauthor=False)
    folders = [*named, Path(__file__).parent / "__pycache__", users]
    return next((folder for folder in folders if _writable(folder)), None)


def _writable(folder: Path) -> bool:
    """Return whether a folder can be written, or made."""
    there = next((part for part in (folder, *folder.parents) if part.exists()), None)
    return there is not None and there.is_dir() and os.access(there, os.W_OK)


def refused_folder() -> str:
    """Return a sentence if the folder that NUMBA_CACHE_DIR names cannot be used, otherwise an empty text."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    return f"NUMBA_CACHE_DIR names {given}, which cannot be written" if given and not _writable(Path(given)) else ""


@cache
def _key() -> str:
    """Return a key of all that compiled code depends on: sources, their place, versions, processor."""
    import hashlib
    import platform

    settings = sorted(f"{name}={value}" for name, value in os.environ.items() if name.startswith("NUMBA_"))
    parts = [
        str(_ROOT),
        *_source_stamp(),
        _numba(),
        platform.python_version(),
        platform.machine(),
        _processor(),
        *settings,
    ]
    return hashlib.sha256("\n".join(map(str, parts)).encode()).hexdigest()[:32]


def _numba() -> str:
    """Return the version of numba, without importing it."""
    from importlib.util import find_spec

    found = find_spec("numba")
    if found is None or found.origin is None:
        return ""
    version = Path(found.origin).with_name("_version.py")
    return version.read_text() if version.is_file() else str(os.stat(found.origin))


def _processor() -> str:
    """Return a description of the processor, as far as the system gives one."""
    with contextlib.suppress(OSError), open("/proc/cpuinfo") as lines:
        found = []
        for line in lines:
            if line.startswith(("model name", "flags", "Features", "CPU part")):
                found.append(line)
            elif not line.strip():
                break
        return "".join(found)
    import platform

    return platform.processor()


def code_folder() -> Path | None:
    """Return the folder for code that is compiled from these sources, which need not be there yet, or None."""
    folder = cache_folder()
    return None if folder is None else folder / f"vofem-{_key()}"


def kinds_on_disk() -> frozenset[str]:
    """Return the kinds of work for which compiled code is on disk."""
    folder = code_folder()
    return frozenset() if folder is None else frozenset(file.stem for file in folder.glob(f"*{_KIND}"))


def keep_kind(kind: str) -> None:
    """Write down that all code for a kind of work is on disk, and remove the oldest folders of other keys."""
    folder = code_folder()
    if folder is None:
        return
    with contextlib.suppress(OSError), Turn():
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{kind}{_KIND}").touch()
        by_age = sorted(folder.parent.glob("vofem-*/"), key=lambda one: one.stat().st_mtime)
        for old in by_age[:-_MOST]:
            shutil.rmtree(old, ignore_errors=True)


def size_on_disk() -> int:
    """Return the bytes of compiled code for these sources on disk."""
    folder = code_folder()
    return 0 if folder is None else sum(file.stat().st_size for file in folder.rglob("*.nbc"))


class Turn(threading.local):
    """Lets processes look for code on disk, compile it and write it one after the other.

    Two processes that compiled one function for different arguments at once would give both files one name, and the
    index of one of them would stand beside the code of the other. A process whose turn does not come goes on.
    """

    depth = 0

    def __enter__(self) -> None:
        lock = _lock()
        if self.depth == 0 and lock is not None:
            with contextlib.suppress(OSError, NotImplementedError):
                lock.acquire(timeout=_LONGEST)
        self.depth += 1

    def __exit__(self, *error: object) -> None:
        lock = _lock()
        self.depth -= 1
        if self.depth == 0 and lock is not None:
            lock.release()


@cache
def _lock() -> Any:
    import filelock

    folder = cache_folder()
    return None if folder is None else filelock.FileLock(folder / "vofem.lock")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_lock.cache_clear)  # The lock of the parent cannot be used.
