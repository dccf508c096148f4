"""Write docs/scene-reference.md from the schema of scene files: ``python tools/scene_reference.py``."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Iterable
from pathlib import Path

from vofem.io.scenes import schema
from vofem.io.scenes.entry import Entry
from vofem.io.scenes.settings import OUTPUT, RESPOND, run_entry

PAGE = Path(__file__).parent.parent / "docs" / "scene-reference.md"

_START = """\
# Tables of scene files

This page lists every table of a [scene file](scene-files.md) with its keys. It is written by
`python tools/scene_reference.py` from the schema that `vofem.load_scene` reads files with; do not edit it. All units
are SI.
"""

_RUN = """\
## The run

Each of these tables occurs at most once. The tables `[initial]` and `[sweep]` are described under
[scene files](scene-files.md) and [sweeps](sweeps.md).
"""

#: Parts of docstrings in numpydoc's style.
_SECTION = r"^(?:Parameters|Attributes)\n-+\n(.*?)(?=^\S[^\n]*\n-{3,}\n|\Z)"
_PARAMETER = r"^(\w[^\n:]*)(?: :[^\n]*)?\n((?:[ ]{4,}[^\n]*\n?|\n(?=[ ]{4}))*)"

_OPTION = "An option of a method; see `vofem.simulate`."


def descriptions(made: type) -> dict[str, str]:
    """Return what a class's docstring says about its parameters and attributes, by name."""
    text = inspect.getdoc(made) or ""
    found: dict[str, str] = {}
    for section in re.findall(_SECTION, text, re.M | re.S):
        for names, body in re.findall(_PARAMETER, section, re.M):
            first = textwrap.dedent(body).strip().split("\n\n")[0]
            for name in names.split(","):
                found[name.strip()] = " ".join(first.split())
    return found


def subject(made: type) -> str:
    """Return the first sentence of a class's docstring."""
    return " ".join((inspect.getdoc(made) or "").split("\n\n")[0].split())


def _cell(text: str) -> str:
    return text.replace("``", "`").replace("|", "\\|")


def _value(expected: str) -> str:
    """Set what is written in a file as code: inline tables, and names in quotes."""
    code = r"\{(?:[^{}]|\{[^{}]*\})*\}|'[^']*'"
    return re.sub(code, lambda found: "`" + found[0].strip("'") + "`", expected)


def _default(entry: Entry, name: str) -> str:
    if name in entry.required:
        return "must be given"
    value = entry._defaults.get(name)
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, (int, float)):
        return f"`{value:g}`"
    return f"`{value!r}`".replace("'", '"') if isinstance(value, str) else ""


def table(entry: Entry, heading: str) -> list[str]:
    """Return the section of an entry."""
    said = descriptions(entry.made)
    lines = [heading, "", subject(entry.made), "", "| key | value | default | meaning |", "| --- | --- | --- | --- |"]
    for name, kind in entry.keys.items():
        meaning = said.get(name, _OPTION if name in entry.optional else "")
        cells = f"`{name}`", _value(kind.expected), _default(entry, name), meaning
        lines.append("| " + " | ".join(_cell(text) for text in cells) + " |")
    return [*lines, ""]


def _sections(entries: Iterable[Entry], form: str) -> list[str]:
    return [line for entry in entries for line in table(entry, form.format(entry.name))]


def page() -> str:
    """Return the page."""
    lines = [_START, "## Bodies", "", "These tables may occur many times.", ""]
    lines += _sections(schema.BODIES.values(), "### `[[{}]]`")
    lines += ["## Effects", "", "These tables may occur many times.", ""]
    lines += _sections(schema.EFFECTS.values(), "### `[[{}]]`")
    lines += [
        "## Functions of time", "",
        "A function of time is a number, or a table with one of these keys, such as "
        "`{ sine = { amplitude = 0.1, omega = 1.0 } }`.", "",
    ]  # fmt: skip
    lines += _sections(schema._FUNCTIONS.values(), "### `{}`")
    lines += [_RUN, *_sections((run_entry(), OUTPUT, RESPOND), "### `[{}]`")]
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
