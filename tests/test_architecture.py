"""The layout: imports point one way, and only what is needed is imported."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "vofem"

# From the bottom up. A module imports only from layers before its own, or from its own package.
LAYERS = [
    "_version",
    "errors",
    "_validate",
    "cache",
    "polynomial",
    "fractional",
    "linalg",
    "laws",
    "system",
    "initial",
    "bodies",
    "assembly",
    "lookup",
    "effects",
    "scene",
    "integrators",
    "reactions",
    "histories",
    "result",
    "progress",
    "statics",
    "modes",
    "simulate",
    "studies",
    "io",
    "verification",
    "cli",
]

# Imports against the direction: inside a function, so that what they bring is loaded when it is called.
DOORS = {
    ("studies/steady/branch.py", "vofem.io.storage.branch_file"): "Branch.save",
    ("result.py", "vofem.io.storage.run_file"): "Result.save",
    ("simulate/simulation.py", "vofem.io.storage.checkpoint"): "simulate(checkpoint=...)",
}

# What only some layers may import.
RESERVED = {
    "skfem": {"bodies"},
    "matplotlib": {"io"},
    "pyvista": {"io"},
    "vtkmodules": {"io"},
    "meshio": {"io", "bodies"},
    "h5py": {"io"},
}


def modules():
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        if parts[0] not in ("__init__", "__main__"):
            yield path, parts[0]


def imported(path):
    tree = ast.parse(path.read_text())
    typing_only = {
        id(node)
        for block in ast.walk(tree)
        if isinstance(block, ast.If) and getattr(block.test, "id", "") == "TYPE_CHECKING"
        for node in ast.walk(block)
    }
    for node in ast.walk(tree):
        if id(node) in typing_only:
            continue
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            yield from ([f"vofem.{a.name}" for a in node.names] if node.module == "vofem" else [node.module])
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_every_module_has_a_layer():
    assert {layer for _, layer in modules()} <= set(LAYERS)


@pytest.mark.parametrize("layer", LAYERS)
def test_imports_point_one_way(layer):
    for path, own in modules():
        if own != layer:
            continue
        for name in imported(path):
            first, *rest = name.split(".")
            if first == "vofem" and rest and (path.relative_to(ROOT).as_posix(), name) not in DOORS:
                assert LAYERS.index(rest[0]) <= LAYERS.index(layer), f"{path.name} imports {name}"
            if first in RESERVED:
                assert layer in RESERVED[first], f"{path.name} imports {name}"


@pytest.mark.parametrize(("file", "name"), DOORS)
def test_imports_against_the_direction_wait_until_they_are_needed(file, name):
    at_once = [node for node in ast.parse((ROOT / file).read_text()).body if isinstance(node, ast.ImportFrom)]
    assert name in imported(ROOT / file)
    assert name not in [node.module for node in at_once]


def test_integrators_know_nothing_of_bodies():
    allowed = {"_validate", "cache", "errors", "linalg", "laws", "system", "integrators", "fractional", "effects"}
    for path, layer in modules():
        if layer != "integrators":
            continue
        for name in imported(path):
            if name.startswith("vofem."):
                assert name.split(".")[1] in allowed, f"{path.name} imports {name}"
                if name.startswith("vofem.effects"):
                    assert name == "vofem.effects.time_functions"


def test_functions_of_time_know_nothing_of_effects():
    allowed = ("vofem._validate", "vofem.errors", "vofem.effects.time_functions")
    for path in (ROOT / "effects" / "time_functions").glob("*.py"):
        for name in imported(path):
            assert not name.startswith("vofem") or name.startswith(allowed), f"{path.name} imports {name}"


def test_library_code_neither_prints_nor_exits():
    for path, layer in modules():
        if layer == "cli":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                assert called not in ("print", "exit", "quit", "sys.exit", "os._exit"), f"{path}: {called}"


def loaded_after(code):
    heavy = "('scipy', 'skfem', 'numba', 'meshio', 'pyvista', 'vtkmodules', 'matplotlib', 'h5py', 'rich')"
    script = f"{code}\nimport sys\nprint(*[m for m in {heavy} if m in sys.modules])"
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()


def test_import_loads_numpy_only():
    assert loaded_after("import vofem") == []


def test_naming_the_public_interface_loads_numpy_only():
    assert loaded_after("import vofem\nfor name in vofem.__all__: getattr(vofem, name)") == []


def test_a_chain_of_masses_needs_no_finite_elements():
    code = """
import vofem as vf
a, b = vf.Mass(1.0, stiffness=1.0), vf.Mass(1.0)
scene = vf.Scene([a, b], [vf.Contact(a, b, gap=0.1, stiffness=10.0, acts_on="penetration")], initial={a: (0.0, 1.0)})
result = vf.simulate(scene, 3.0)
assert result.counters.events
result.energy
"""
    assert set(loaded_after(code)) == {"scipy", "numba"}


def test_a_beam_needs_no_pictures():
    code = """
import vofem as vf
beam = vf.Beam(1.0, 1.0, 1.0, 5, {"left": "clamped"})
vf.simulate(vf.Scene([beam], [vf.PointLoad(beam.at(1.0), 1.0)]), 1.0)
"""
    assert set(loaded_after(code)) == {"scipy", "numba", "skfem"}
