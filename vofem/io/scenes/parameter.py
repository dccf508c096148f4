"""Numbers of a scene file by the path of their key, as parameters of a study."""

from __future__ import annotations

import copy
import re
from typing import Any

#: A key with the number of an entry, counted from 0, where its table stands in an array.
_STEP = re.compile(r"([A-Za-z0-9_-]+)|\[(\d+)\]")


def steps_of(path: str) -> list[str | int] | None:
    """Return the keys and numbers of a path such as ``point_load[0].f.sine.omega``, or None where it is none."""
    parts: list[str | int] = []
    rest = path
    while rest:
        match = _STEP.match(rest)
        if match is None:
            return None
        parts.append(match[1] if match[1] is not None else int(match[2]))
        rest = rest[match.end() :].removeprefix(".")
    return parts or None


def number_at(content: Any, path: str) -> float | str:
    """Return the number that stands at a path of a parsed scene file, or a sentence that says what is there instead."""
    steps = steps_of(path)
    if steps is None:
        return f"expected the path of a key, such as 'point_load[0].f.sine.omega', found {path!r}"
    here, seen = content, ""
    for step in steps:
        if isinstance(step, int):
            if not isinstance(here, list) or step >= len(here):
                count = len(here) if isinstance(here, list) else 0
                return f"{path!r} leads nowhere: {seen} has {count} entries, counted from 0"
            here, seen = here[step], f"{seen}[{step}]"
            continue
        if isinstance(here, list):
            return f"{path!r} leads nowhere: {seen} is an array; write {seen}[0] for its first entry"
        if not isinstance(here, dict) or step not in here:
            known = f", which has {', '.join(here)}" if isinstance(here, dict) and seen else ""
            return f"{path!r} leads nowhere: there is no key {step!r}{f' in {seen}' if seen else ''}{known}"
        here, seen = here[step], f"{seen}.{step}" if seen else step
    if isinstance(here, bool) or not isinstance(here, (int, float)):
        return f"{path!r} is {here!r}, expected a number in the file there"
    return float(here)


def with_number(content: dict[str, Any], paths: tuple[str, ...], value: float) -> dict[str, Any]:
    """Return a parsed scene file with a number at some paths replaced."""
    changed = copy.deepcopy(content)
    for path in paths:
        *steps, last = steps_of(path) or [""]
        here: Any = changed
        for step in steps:
            here = here[step]
        here[last] = value
    return changed
