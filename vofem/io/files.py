"""Writing a file whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from vofem._validate import one_of
from vofem.errors import ArgumentError, OutputError


def target(path: str | os.PathLike[str], suffixes: tuple[str, ...]) -> Path:
    """Return `path` as a Path, or raise `ArgumentError` if its suffix is none of `suffixes`."""
    try:
        result = Path(path)
    except TypeError:
        raise ArgumentError(f"path is {path!r}, expected the name of a file") from None
    if result.suffix.lower() not in suffixes:
        raise ArgumentError(f"path is {str(path)!r}, expected a name that ends in {one_of(suffixes)}")
    return result


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary name in the folder of `path`; rename it to `path` once the block has succeeded.

    A reader sees the old file or the new one, never a part, and a failure
    leaves nothing behind.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    # Of fixed length, so that a long name which is valid itself stays so; of the same suffix, by which writers
    # choose a format.
    temporary = path.parent / f".vofem-{secrets.token_hex(8)}{path.suffix}"
    try:
        if path.is_dir():
            raise IsADirectoryError("it is a folder")
        # Created first, so that a folder that cannot be written is found before the work is done. The tempfile
        # module would make it private to its owner.
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {_reason(path, error)}") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def _reason(path: Path, error: OSError) -> str:
    """Return cause and cure."""
    folder = path.parent
    # Not the methods of Path: these raise in a folder that may not be entered.
    if os.path.isdir(path):
        return "it is a folder; give the name of a file"
    if os.path.exists(folder) and not os.path.isdir(folder):
        return f"{folder} is a file, not a folder; choose another place"
    if error.errno == errno.ENOENT and not os.path.exists(folder):
        return f"the folder {folder} does not exist; create it first"
    return f"{error.strerror or error}; check the permissions of {folder} and the space left, or choose another place"
