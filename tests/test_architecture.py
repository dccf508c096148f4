"""The layout: imports point one way; what is imported when is tested in test_start_up.py."""

import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import grimp

ROOT = Path(__file__).parent.parent / "vofem"


@cache
def parsed(path):
    """Return the syntax tree of a file, which is shared by all tests and not to be changed."""
    return ast.parse(path.read_text())


def modules():
    for path in sorted(ROOT.rglob("*.py")):
        parts = path.relative_to(ROOT).with_suffix("").parts
        if parts[0] not in ("__init__", "__main__"):
            yield path, parts[0]


def test_imports_keep_the_contracts_of_pyproject():
    """The order of the rooms, no circles, and which packages only some rooms may import."""
    command = [Path(sys.executable).with_name("lint-imports"), "--no-cache"]
    run = subprocess.run(command, cwd=ROOT.parent, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr


def test_nothing_imports_the_package_as_a_whole():
    """`vofem/__init__.py` stands above all rooms, so none of them asks it for a name."""
    assert not grimp.build_graph("vofem", cache_dir=None).find_modules_that_directly_import("vofem")


#: Where classes of laws may be asked for: in their own modules, and for `System.contacts`, on which `event_driven`,
#: histories of contacts and pictures of K_eq are built.
KNOWS_LAWS = {"laws", "system"}


def kinds_of_laws():
    """Return the names of all classes of laws and of groups of laws, but for the bases of groups."""
    text = "".join(path.read_text() for path in (ROOT / "laws").glob("*.py"))
    return set(re.findall(r"^class (\w*Laws?)\b", text, re.MULTILINE)) - {"Law", "Laws", "ListedLaws"}


def asked_for(path):
    """Return the names in the parts of a module that ask for the class of an object."""
    named = set()
    for node in ast.walk(parsed(path)):
        called = getattr(node, "func", None)
        asks = getattr(called, "id", getattr(called, "attr", "")) in ("isinstance", "issubclass")
        if asks or isinstance(node, (ast.Compare, ast.MatchClass)):
            inner = ast.walk(node)
            named |= {
                n.id if isinstance(n, ast.Name) else n.attr for n in inner if isinstance(n, ast.Name | ast.Attribute)
            }
    return named


def test_no_other_module_branches_on_kinds_of_laws():
    """Methods, statics, steady states, results and files ask a law group what they need to know."""
    kinds = kinds_of_laws()
    assert {"ContactLaws", "HystereticLaws", "PrintedLaws", "SmoothLaws", "SpringpotLaws"} <= kinds
    assert "ContactLaws" in asked_for(ROOT / "system.py")
    for path, layer in modules():
        # Most modules name no class of laws at all.
        if layer not in KNOWS_LAWS and any(kind in path.read_text() for kind in kinds):
            found = kinds & asked_for(path)
            assert not found, f"{path} asks for {found}"


def test_library_code_neither_prints_nor_exits():
    for path, layer in modules():
        # Most modules hold none of these names before a parenthesis.
        if layer == "cli" or not re.search(r"\b(print|exit|_exit|quit)\s*\(", path.read_text()):
            continue
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                assert called not in ("print", "exit", "quit", "sys.exit", "os._exit"), f"{path}: {called}"
