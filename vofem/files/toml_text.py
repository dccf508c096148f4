"""TOML as text: the few kinds of values that scene files hold."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+\Z")
_WIDTH = 100


def key(name: str) -> str:
    """Return a key, in quotes where it needs them."""
    return name if _BARE.match(name) else string(name)


def string(text: str) -> str:
    """Return a basic string on one line."""
    # The escapes of JSON are escapes of TOML; TOML also wants one for DEL.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def value(item: Any) -> str:
    """Return a value on one line; floats as `repr` gives them, so that they are read back bit for bit."""
    if isinstance(item, bool):
        return "true" if item else "false"
    if isinstance(item, (int, float)):
        return repr(item)
    if isinstance(item, str):
        return string(item)
    if isinstance(item, Mapping):
        inside = ", ".join(f"{key(name)} = {value(part)}" for name, part in item.items())
        return f"{{ {inside} }}" if inside else "{}"
    return f"[{', '.join(value(part) for part in item)}]"


def table(header: str, content: Mapping[str, Any]) -> str:
    """Return a table: its header line and a line for every key, more for a long array."""
    lines = [header] if header else []
    for name, item in content.items():
        line = f"{key(name)} = {value(item)}"
        if len(line) > _WIDTH and isinstance(item, (list, tuple)):
            line = f"{key(name)} = [\n{_wrapped(value(part) for part in item)}]"
        lines.append(line)
    return "\n".join(lines) + "\n"


def _wrapped(parts: Iterable[str]) -> str:
    lines = [""]
    for part in parts:
        if lines[-1] and len(lines[-1]) + len(part) + 2 > _WIDTH:
            lines.append("")
        lines[-1] += f" {part}," if lines[-1] else f"    {part},"
    return "".join(f"{line}\n" for line in lines)
