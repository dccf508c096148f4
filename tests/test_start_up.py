"""What is imported when: each part by those who ask for it, because a newcomer waits for all of it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

#: Packages that take long to import, and modules of vofem for effects and pictures that a scene may lack.
WATCHED = {
    "scipy", "skfem", "numba", "matplotlib", "pyvista", "vtkmodules", "h5py", "rich", "meshio", "pandas", "xarray",
    "vofem.io.cards", "vofem.laws.springpot_past",
}  # fmt: skip

#: What is done in one process, stage after stage, and what each stage adds to what is imported.
#: A run so short needs no compiled code; writing VTU files needs no VTK.
STAGES = {
    "import": ("import vofem as vf", set()),
    "public names": ("for name in vf.__all__: getattr(vf, name)", set()),
    "masses": (
        "a, b = vf.Mass(1.0, stiffness=1.0), vf.Mass(1.0)\n"
        "hit = vf.Contact(a, b, gap=0.1, stiffness=10.0, acts_on='penetration')\n"
        "scene = vf.Scene([a, b], [hit], initial={a: (0.0, 1.0)})\n"
        "result = vf.simulate(scene, 3.0)\n"
        "assert result.counters.events and result.energy",
        {"scipy"},
    ),
    "steps": (
        "import numpy as np\n"
        "for method, how in (('energy_conserving', {}), ('energy_conserving', {'tol': 1e-3}),\n"
        "                    ('generalized_alpha', {}), ('central_difference', {})):\n"
        "    swings = vf.Scene([a], [vf.PointLoad(a, np.sin)], {a: (0.0, 1.0)})\n"
        "    stepped = vf.simulate(swings, 1.0, method=method, **how)\n"
        "    assert stepped.counters.history_terms == stepped.counters.history_updates == len(stepped.springs) == 0",
        set(),
    ),
    "beam": (
        "beam = vf.Beam(1.0, 1.0, 1.0, 5, {'left': 'clamped'})\n"
        "vf.simulate(vf.Scene([beam], [vf.PointLoad(beam.at(1.0), 1.0)]), 1.0)",
        {"skfem"},
    ),
    "orbit": (
        "stop = vf.Contact(a, gap=0.1, stiffness=10.0, side='above', acts_on='penetration')\n"
        "driven = vf.Scene([a], [stop, vf.ModalDamping(0.05), vf.PointLoad(a, vf.Sine(0.05, 1.1))])\n"
        "orbit = vf.periodic(driven)\n"
        "assert orbit.amplitude(a) > 0.1 and orbit.stable",
        set(),
    ),
    "explain": ("from vofem.cli import main\nassert main(['explain', EXAMPLE]) == 0", set()),
    "run": ("assert main(['run', EXAMPLE, '--no-pictures', '--output', FOLDER + '/out']) == 0", set()),
    "series": (
        "from vofem.io.vtk import write_series\nwrite_series(result, FOLDER + '/series.pvd')",
        {"pyvista", "vtkmodules"},
    ),
    "run with pictures": ("assert main(['run', EXAMPLE, '--output', FOLDER + '/out']) == 0", {"matplotlib"}),
}


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """By stage, what it has imported, in a process without compiled code on disk."""
    folder = tmp_path_factory.mktemp("start")
    program = [f"import json, sys\nFOLDER, EXAMPLE = {str(folder)!r}, 'examples/cantilever.toml'"]
    for name, (code, _) in STAGES.items():
        found = f"[m for m in {sorted(WATCHED)} if m in sys.modules]"
        program.append(f"{code}\nprint('after', json.dumps([{name!r}, {found}]))")
    run = subprocess.run(
        [sys.executable, "-c", "\n".join(program)], cwd=ROOT, capture_output=True, text=True, check=False,
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder / "caches")},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert (folder / "out" / "histories.csv").exists()
    return dict(
        json.loads(line.removeprefix("after ")) for line in run.stdout.splitlines() if line.startswith("after ")
    )


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_imports_what_it_needs(imported, stage):
    expected = set()
    for name, (_, more) in STAGES.items():
        expected |= more
        if name == stage:
            break
    assert set(imported[stage]) == expected
