"""Writing a file whole or not at all, and what the functions that write one share."""

from __future__ import annotations

import contextlib
import errno
import functools
import inspect
import os
import re
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ParamSpec

from vofem._validate import flag, one_of
from vofem.errors import ArgumentError, OutputError

#: Where a system keeps its devices; a file put there is lost at the next start.
_DEVICES = "/dev"

#: What file systems answer that know no hard links, or cannot force a folder to disk.
_UNSUPPORTED = {errno.EPERM, errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EMLINK, errno.EACCES, errno.ENOSYS}


def path_of(path: Any, expected: str = "a file") -> Path:
    """Return `path` as a Path; raise `ArgumentError`, which says what was `expected`, if no file can have that name."""
    try:
        result = Path(path)
        os.fsencode(result)
    except TypeError:
        found = repr(path)
    except UnicodeEncodeError:
        found = f"{str(path)!r}, which holds characters that this system cannot write in names"
    else:
        if "\0" not in str(result):
            return result
        found = f"{str(path)!r}, which holds a NUL character"
    raise ArgumentError(f"path is {found}, expected the name of {expected}")


def target(path: str | os.PathLike[str], suffixes: tuple[str, ...]) -> Path:
    """Return `path` as a Path, or raise `ArgumentError` if no file can have that name, or its suffix is another one."""
    result = path_of(path)
    if result.suffix.lower() not in suffixes:
        raise ArgumentError(f"path is {str(path)!r}, expected a name that ends in {one_of(suffixes)}")
    return result


P = ParamSpec("P")


def writer(*suffixes: str) -> Callable[[Callable[P, None]], Callable[P, Path]]:
    """Make a function of one that writes a file, whole or not at all.

    The function has a parameter `path`. In its place it gets a hidden name of the same suffix and folder. Whatever
    keeps the file from being written is told before the work begins. The path of the user is returned, and the
    docstring gets what all writers share.

    `suffixes`: how names may end.
    """

    def make(write: Callable[P, None]) -> Callable[P, Path]:
        signature = inspect.signature(write)

        @functools.wraps(write)
        def written(*given: P.args, **named: P.kwargs) -> Path:
            bound = signature.bind(*given, **named)
            goal = target(bound.arguments["path"], suffixes)
            with replacing(goal) as temporary:
                bound.arguments["path"] = temporary
                write(*bound.args, **bound.kwargs)
            return goal

        ends = " or ".join(filter(None, (", ".join(suffixes[:-1]), suffixes[-1])))
        written.__doc__ = documented(write, {"path": f"path of a {ends}"}, "Path\n    `path`.")
        return written

    return make


def documented(function: Callable[..., Any], shared: dict[str, str], returns: str) -> str:
    """Return the docstring of a writer, completed by parameters that it does not name, its outcome and its error.

    `shared`: what stands behind the names of parameters that several functions have.
    """
    text = inspect.cleandoc(function.__doc__ or "")
    parts = re.split(r"^((?:Raises|Notes|References)\n-+\n)", text + "\n", maxsplit=1, flags=re.MULTILINE)
    head, rest = parts[0].rstrip() + "\n", "".join(parts[1:])
    names = [name for name in inspect.signature(function).parameters if f"\n{name} : " not in head]
    head += "".join(f"{name} : {shared[name]}\n" for name in names if name in shared)
    raises = "" if rest.startswith("Raises") else "Raises\n------\n"
    errors, notes, more = (raises + rest).partition("\nNotes\n")
    error = "OutputError\n    If the file cannot be written.\n"
    return f"{head}\nReturns\n-------\n{returns}\n\n{errors.rstrip()}\n{error}{notes}{more}"


def refuse_existing(path: Path, cure: str = "choose another name, or pass overwrite=True") -> None:
    """Raise `OutputError` if something of that name exists; `cure` ends the message."""
    if os.path.lexists(path) and not os.path.isdir(path):
        raise OutputError(f"{path} exists already and was left as it is; {cure}")


#: Temporary files of `replacing` that are being written.
_unfinished: set[Path] = set()


def remove_unfinished() -> None:
    """Remove files that are being written, just before the process ends without leaving the blocks that write them."""
    for temporary in tuple(_unfinished):
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def replacing(path: Path, *, overwrite: bool = True) -> Iterator[Path]:
    """Give a temporary name in the folder of `path`; rename it to `path` once the block has succeeded.

    The content is forced to disk before the name changes, and the change of
    name after it. So a reader sees the old file or the new one, never a part,
    whenever the process or the machine stops, and an error leaves nothing
    behind. (A process that is killed leaves its temporary file, whose name
    begins with ``.vofem-``.)

    `overwrite`: whether a file of that name is replaced. If not, it is refused before the block and, where another
    process has made it meanwhile, after it.
    Raises `ArgumentError` if `overwrite` is neither True nor False.
    Raises `OutputError` if the file cannot be written, or is a device, a pipe or a socket.
    """
    if not flag("overwrite", overwrite):
        refuse_existing(path)
    path = _real(path)
    temporary = _hidden_name(path)
    _unfinished.add(temporary)
    try:
        # Created first, so that a folder that cannot be written is found before the work is done.
        _create(path, temporary)
        yield temporary
        _to_disk(temporary)
        _publish(temporary, path, overwrite)
        _folder_to_disk(path.parent)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {_reason(path, error)}") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        _unfinished.discard(temporary)


def write_text(path: Path, text: str, *, overwrite: bool = True) -> Path:
    """Write a text file whole and return its path; see `replacing`."""
    with replacing(path, overwrite=overwrite) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
    return path


def try_to_write(path: Path) -> None:
    """Raise `OutputError` if no file can be made in the folder of `path`; what is there stays as it is."""
    path = _real(path)
    temporary = _hidden_name(path)
    try:
        _create(path, temporary)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {_reason(path, error)}") from error
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


def _real(path: Path) -> Path:
    """Return the file that a name stands for, links followed; raise `OutputError` where it is no regular file."""
    real = Path(os.path.realpath(path)) if os.path.islink(path) else path
    if os.path.islink(real):
        raise OutputError(f"{path} cannot be written: it is a link that leads back to itself; choose another name")
    if os.path.exists(real) and not os.path.isfile(real) and not os.path.isdir(real):
        raise OutputError(f"{path} cannot be written: it is a device, a pipe or a socket, and no regular file")
    if os.path.realpath(real.parent) == _DEVICES:
        raise OutputError(f"{path} cannot be written: {_DEVICES} is the folder of devices; choose another place")
    return real


def _hidden_name(path: Path) -> Path:
    # Of fixed length, so that a long name which is valid itself stays so; of the same suffix, by which writers
    # choose a format.
    return path.parent / f".vofem-{secrets.token_hex(8)}{path.suffix}"


def _create(path: Path, temporary: Path) -> None:
    if path.is_dir():
        raise IsADirectoryError("it is a folder")
    # The tempfile module would make it private to its owner.
    os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))


def _to_disk(file: Path) -> None:
    """Wait until the content of a file is on disk; a full or failing disk may tell only now."""
    descriptor = os.open(file, os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _publish(temporary: Path, path: Path, overwrite: bool) -> None:
    """Give a file its name, in one step."""
    if overwrite:
        os.replace(temporary, path)
        return
    try:
        # Unlike a rename, a link never takes the place of a file that has appeared since.
        os.link(temporary, path)
    except FileExistsError:
        refuse_existing(path)
        raise
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise
        refuse_existing(path)
        os.replace(temporary, path)


def _folder_to_disk(folder: Path) -> None:
    """Wait until a change of names is on disk, where the system can do that for folders."""
    if os.name == "nt":
        return
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:  # a folder may be written and not read
        return
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise
    finally:
        os.close(descriptor)


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
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        return f"{error.strerror or error}; make room in {folder}, or choose another place"
    return f"{error.strerror or error}; check the permissions of {folder} and the space left, or choose another place"
