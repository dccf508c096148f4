"""What commands import: each its own part, because a newcomer waits for all of it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
EXAMPLE = "examples/cantilever.toml"

#: Packages that take long to import.
HEAVY = {"skfem", "numba", "matplotlib", "pyvista", "vtkmodules", "h5py", "rich", "meshio", "pandas", "xarray"}


def imported(code, **environment):
    """Return which heavy packages a program has imported at its end."""
    program = (
        f"{code}\nimport json, sys\nprint('imported', json.dumps([m for m in {sorted(HEAVY)} if m in sys.modules]))"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False,
        env={**os.environ, **environment},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return set(json.loads(run.stdout.splitlines()[-1].removeprefix("imported ")))


def command(folder, *words):
    """Return what a command imports on a machine without compiled code, of which a short run has no use."""
    return imported(f"from vofem.cli import main\nassert main({list(words)!r}) == 0", NUMBA_CACHE_DIR=str(folder))


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("explain", EXAMPLE), {"skfem"}),
        (("run", EXAMPLE, "--no-pictures", "--output", "{}"), {"skfem"}),
        (("run", EXAMPLE, "--output", "{}"), {"skfem", "matplotlib"}),
    ],
    ids=["explain", "run without pictures", "run"],
)
def test_a_command_imports_what_it_needs(tmp_path, words, expected):
    """matplotlib is imported for pictures alone, VTK for a snapshot; a run so short needs no compiled code."""
    out = tmp_path / "out"
    assert command(tmp_path / "caches", *(word.format(out) for word in words)) == expected
    assert (words[0] == "explain") is not (out / "histories.csv").exists()
