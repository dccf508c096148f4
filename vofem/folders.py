"""A small file of entries that processes share."""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
from pathlib import Path
from typing import Any


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
