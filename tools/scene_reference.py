"""The page of the site on the tables of scene files, made of what the classes declare."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterable
from pathlib import Path

from vofem.bodies import Beam
from vofem.io.scenes import schema
from vofem.io.scenes.schema import MESH
from vofem.io.scenes.settings import OutputSettings, RespondSettings, RunSettings, run_keys
from vofem.parameters import Declaration, Real, declarations
from vofem.time_functions.base import FUNCTIONS

_START = """\
# Tables of scene files

This page lists every table of a [scene file](scene-files.md) with its keys. All units are SI.
"""

_RUN = """\
## The run

Each of these tables occurs at most once. The tables `[initial]` and `[sweep]` are described under
[scene files](scene-files.md) and [sweeps](sweeps.md).
"""


def subject(made: type) -> str:
    """Return the first sentence of a class's docstring."""
    return " ".join((inspect.getdoc(made) or "").split("\n\n")[0].split())


def _cell(text: str) -> str:
    return text.replace("``", "`").replace("|", "\\|")


def _value(expected: str) -> str:
    """Set what is written in a file as code: inline tables, and names in quotes."""
    code = r"\{(?:[^{}]|\{[^{}]*\})*\}|'[^']*'"
    return re.sub(code, lambda found: "`" + found[0].strip("'") + "`", expected)


def _default(one: Declaration, made: type) -> str:
    if one.needed and not (made is Beam and one.name in ("length", "elements")):
        return "must be given"
    if isinstance(one.default, bool):
        return f"`{str(one.default).lower()}`"
    if isinstance(one.default, (int, float)):
        return f"`{one.default:g}`"
    return f'`"{one.default}"`' if isinstance(one.default, str) else ""


def table(made: type, keys: Iterable[str], heading: str) -> list[str]:
    """Return the section of a class."""
    known = {**declarations(made), **({"mesh": Declaration("mesh", MESH, None)} if made is Beam else {})}
    lines = [heading, "", subject(made), "", "| key | value | default | meaning |", "| --- | --- | --- | --- |"]
    for name in keys:
        option = Declaration(name, Real("", "An option of a method; see `vofem.simulate`."), None)
        one = known.get(name, option)
        cells = f"`{name}`", _value(one.kind.expected), _default(one, made), one.kind.meaning
        lines.append("| " + " | ".join(_cell(text) for text in cells) + " |")
    return [*lines, ""]


def _sections(classes: dict[str, type], form: str) -> list[str]:
    return [line for name, made in classes.items() for line in table(made, schema.keys(made), form.format(name))]


def page() -> str:
    """Return the page."""
    lines = [_START, "## Bodies", "", "These tables may occur many times.", ""]
    lines += _sections(schema.BODIES, "### `[[{}]]`")
    lines += ["## Effects", "", "These tables may occur many times.", ""]
    lines += _sections(schema.EFFECTS, "### `[[{}]]`")
    lines += [
        "## Functions of time", "",
        "A function of time is a number, or a table with one of these keys, such as "
        "`{ sine = { amplitude = 0.1, omega = 1.0 } }`.", "",
    ]  # fmt: skip
    lines += _sections(FUNCTIONS, "### `{}`")
    lines += [_RUN, *table(RunSettings, run_keys(), "### `[run]`")]
    lines += _sections({"output": OutputSettings, "respond": RespondSettings}, "### `[{}]`")
    return "\n".join(lines).rstrip() + "\n"


def write(folder: Path) -> None:
    """Write the page, and the schema beside it, to the pages of the site."""
    (folder / "scene-file.schema.json").write_text(json.dumps(schema.json_schema(), indent=1), encoding="utf-8")
    (folder / "scene-reference.md").write_text(page(), encoding="utf-8")
