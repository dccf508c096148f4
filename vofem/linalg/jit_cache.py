"""Where compiled kernels are on disk, and for which kinds of work they are there already, without importing numba.

numba keeps machine code beside the sources or, where these cannot be written,
in the user's folder for caches. Beside it stands an index of this package: the
kinds of work for which all code has been compiled, under a key that names the
sources, the versions of Python and numba, and the processor. Code that is
missing all the same is compiled again: the index says what to expect, no more.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import sys
import tempfile
import uuid
from collections.abc import Callable
from functools import cache
from pathlib import Path

#: Rooms of the package that hold kernels.
_ROOMS = ("linalg", "laws", "integrators")

_ROOT = Path(__file__).parent.parent

_INDEX = "vofem-compiled.json"

#: Keys that an index holds: those of other versions and processors that share the folder.
_MOST_KEYS = 8


@cache
def source_stamp() -> tuple[float, int]:
    """Return the latest change and the total size of all sources that hold kernels."""
    found = [path.stat() for part in _ROOMS for path in (_ROOT / part).rglob("*.py")]
    return max(status.st_mtime for status in found), sum(status.st_size for status in found)


def own_name(name: Callable[[int], str]) -> Callable[[int], str]:
    """Return a function that names files as `name` does, with a mark that no other process uses."""
    mark = _mark()

    def marked(number: int) -> str:
        stem, _, suffix = name(number).rpartition(".")
        return f"{stem}-{mark}.{suffix}"

    return marked


@cache
def _mark() -> str:
    return uuid.uuid4().hex[:8]


def cache_folder() -> Path | None:
    """Return the folder below which numba keeps code of this package, or None where it has none."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    if given:
        return Path(given)
    beside = Path(__file__).parent / "__pycache__"
    if os.access(beside if beside.is_dir() else beside.parent, os.W_OK):
        return beside
    home = _user_caches()
    there = next((folder for folder in (home, *home.parents) if folder.is_dir()), None)
    return home if there is not None and os.access(there, os.W_OK) else None


def _user_caches() -> Path:
    """Return the folder that numba takes for a user's caches."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local")) / "numba"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "numba"
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "numba"


@cache
def _key() -> str:
    """Return what compiled code depends on: sources, their place, versions, processor."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        numba = version("numba")
    except PackageNotFoundError:
        numba = "none"
    settings = sorted(f"{name}={value}" for name, value in os.environ.items() if name.startswith("NUMBA_"))
    parts = [str(_ROOT), *source_stamp(), numba, platform.python_version(), platform.machine(), _processor(), *settings]
    return hashlib.sha256("\n".join(map(str, parts)).encode()).hexdigest()[:32]


def _processor() -> str:
    """Return what tells one processor from another, as far as the system says it."""
    with contextlib.suppress(OSError), open("/proc/cpuinfo") as lines:
        told = []
        for line in lines:
            if line.startswith(("model name", "flags", "Features", "CPU part")):
                told.append(line)
            elif not line.strip():
                break
        return "".join(told)
    return platform.processor()


def kinds_on_disk() -> frozenset[str]:
    """Return the kinds of work for which compiled code is on disk."""
    folder = cache_folder()
    return frozenset() if folder is None else frozenset(_read(folder / _INDEX).get(_key(), ()))


def keep_kind(kind: str) -> None:
    """Enter into the index that all code for a kind of work is on disk; where it cannot be written, do nothing."""
    folder = cache_folder()
    if folder is None:
        return
    file = folder / _INDEX
    known = _read(file)
    kinds = known.pop(_key(), [])
    if kind in kinds:
        return
    # What has been used last stands last.
    known = dict([*known.items()][1 - _MOST_KEYS :]) | {_key(): sorted([*kinds, kind])}
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=folder, prefix=_INDEX)
        try:
            with os.fdopen(handle, "w") as stream:
                json.dump(known, stream, indent=1)
            os.replace(name, file)
        except OSError:
            os.unlink(name)
            raise


def _read(file: Path) -> dict[str, list[str]]:
    """Return an index, empty where there is none that can be read."""
    try:
        known = json.loads(file.read_text())
    except (OSError, ValueError):
        return {}
    return known if isinstance(known, dict) else {}


def size_on_disk() -> int:
    """Return the bytes of compiled code of this package on disk."""
    folder = cache_folder()
    if folder is None:
        return 0
    beside = folder.name == "__pycache__" and folder.is_relative_to(_ROOT)
    return sum(file.stat().st_size for file in (_ROOT if beside else folder).rglob("*.nbc"))
