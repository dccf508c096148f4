"""The place of compiled kernels on disk, and the kinds of work for which they exist, without importing numba.

numba keeps machine code beside the sources or, where these cannot be written, in the user's folder for caches. Beside
it stands an index of this package: the kinds of work for which all code has been compiled, under a key that names the
sources, the versions of Python and numba, and the processor. The index is only an estimate: code that is missing
nevertheless is compiled again.
"""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

#: Subpackages that contain kernels.
_ROOMS = ("kernels", "linalg", "laws", "integrators")

_ROOT = Path(__file__).parent.parent

_INDEX = "vofem-compiled.json"


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
    import uuid

    return uuid.uuid4().hex[:8]


def cache_folder() -> Path | None:
    """Return the folder below which numba keeps code of this package, or None where it has none.

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
        *source_stamp(),
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


def kinds_on_disk() -> frozenset[str]:
    """Return the kinds of work for which compiled code is on disk."""
    folder = cache_folder()
    return frozenset() if folder is None else frozenset(read_entries(folder / _INDEX).get(_key(), ()))


def keep_kind(kind: str) -> None:
    """Enter into the index that all code for a kind of work is on disk."""
    folder = cache_folder()
    if folder is None:
        return
    kinds = kinds_on_disk()
    if kind not in kinds:
        write_entry(folder / _INDEX, _key(), sorted({*kinds, kind}))


def size_on_disk() -> int:
    """Return the bytes of compiled code of this package on disk."""
    folder = cache_folder()
    if folder is None:
        return 0
    beside = folder.name == "__pycache__" and folder.is_relative_to(_ROOT)
    return sum(file.stat().st_size for file in (_ROOT if beside else folder).rglob("*.nbc"))


def read_entries(file: Path) -> dict[str, Any]:
    """Return what `write_entry` has written, nothing where there is no such file."""
    try:
        known = json.loads(file.read_text())
    except (OSError, ValueError):
        return {}
    return known if isinstance(known, dict) else {}


def write_entry(file: Path, key: str, value: Any, most: int = 8) -> None:
    """Enter a value into a small file that processes share; where it cannot be written, do nothing.

    The file is replaced as a whole, so that readers never see a part of it. The oldest of more than `most` entries go.
    """
    known = {name: old for name, old in read_entries(file).items() if name != key}
    known = dict([*known.items()][-(most - 1) :]) | {key: value}
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=file.parent, prefix=file.name)
        try:
            with os.fdopen(handle, "w") as stream:
                json.dump(known, stream, indent=1)
            os.replace(name, file)
        except OSError:
            os.unlink(name)
            raise
