"""The page of the gallery: every script of examples/ is run, and its sentence, pictures and code are put on a page."""

from __future__ import annotations

import ast
import hashlib
import json
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parent.parent
EXAMPLES = ROOT / "examples"
#: Pictures of earlier builds, which are kept as long as the example and the package are the same.
STORE = ROOT / "build" / "gallery"
PICTURES = (".png", ".webp", ".gif", ".svg")

_START = """\
# Gallery

Every picture on this page was drawn by a script of the folder `examples/` when the site was built. To draw one
yourself, run the script from the folder of the repository, as in `python examples/two_masses.py --output output`.
"""


def _digest(script: Path) -> str:
    """Return a number for all that the pictures of a script depend on."""
    found = hashlib.sha256(script.read_bytes())
    for path in sorted((ROOT / "vofem").rglob("*.py")):
        found.update(path.read_bytes())
    return found.hexdigest()[:20]


def draw(script: Path) -> list[Path]:
    """Run a script unless its pictures are there, and return them, by name.

    Raises
    ------
    RuntimeError
        If the script fails or draws nothing.
    """
    folder = STORE / f"{script.stem}-{_digest(script)}"
    done = folder / "done"
    if not done.exists():
        folder.mkdir(parents=True, exist_ok=True)
        environment = {**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": str(ROOT)}
        command = [sys.executable, str(script), "--output", str(folder)]
        run = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT, check=False)
        if run.returncode:
            raise RuntimeError(f"{script} failed:\n{run.stdout}\n{run.stderr}")
        done.touch()
    pictures = sorted(path for path in folder.iterdir() if path.suffix in PICTURES)
    if not pictures:
        raise RuntimeError(f"{script} wrote no picture into the folder of --output, expected at least one")
    return pictures


def _said(script: Path) -> tuple[str, str]:
    """Return the first sentence of a script's docstring, and the rest without the line that says how to run it."""
    text = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""
    first, _, rest = text.partition("\n\n")
    rest = re.sub(r"Run it with ``[^`]*``[^.]*\.", "", " ".join(rest.split()))
    return " ".join(first.split()), rest.replace("``", "`").strip()


def section(script: Path, pictures: list[Path]) -> str:
    """Return the part of the page that belongs to a script."""
    title = script.stem.replace("_", " ")
    sentence, rest = _said(script)
    lines = [f"## {title[0].upper()}{title[1:]}", "", sentence, ""]
    lines += [rest, ""] if rest else []
    for picture in pictures:
        lines += [f"![{title}: {picture.stem}](gallery/{picture.name})", ""]
    code = script.read_text(encoding="utf-8").rstrip()
    lines += [
        f'??? example "examples/{script.name}"',
        "",
        "    ```python",
        *(f"    {line}" for line in code.split("\n")),
    ]
    return "\n".join([*lines, "    ```", ""])


def notebook_section(path: Path) -> str:
    """Return the part of the page that belongs to a notebook: its text and its code, which a test runs."""
    cells = [
        (cell["cell_type"], "".join(cell["source"])) for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]
    ]
    title, _, text = cells[0][1].removeprefix("# ").partition("\n")
    lines = [f"## {title}", "", text.strip(), "", f'??? example "examples/{path.name}"', ""]
    for kind, source in cells[1:]:
        block = f"```python\n{source}\n```" if kind == "code" else source
        lines += [f"    {line}".rstrip() for line in block.split("\n")] + [""]
    return "\n".join(lines)


def write(pages: Path) -> None:
    """Write gallery.md and its pictures into the folder of the site's pages."""
    scripts = sorted(EXAMPLES.glob("*.py"))
    with ThreadPoolExecutor(max_workers=min(4, os.cpu_count() or 1)) as pool:
        drawn = list(pool.map(draw, scripts))
    folder = pages / "gallery"
    folder.mkdir()
    for pictures in drawn:
        for picture in pictures:
            (folder / picture.name).write_bytes(picture.read_bytes())
    parts = [_START, *(section(script, pictures) for script, pictures in zip(scripts, drawn, strict=True))]
    parts += [notebook_section(path) for path in sorted(EXAMPLES.glob("*.ipynb"))]
    (pages / "gallery.md").write_text("\n".join(parts), encoding="utf-8")
