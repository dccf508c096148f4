"""Every example runs, and a number that it prints is right."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def check_cantilever(result, printed):
    stop = result.contacts["stop"]
    assert stop.closings[0] == pytest.approx(3.8131224981, abs=1e-9)
    assert result.counters.events == 12
    assert "3.813122498" in printed
    assert "12 contact events" in printed


CHECKS = {"cantilever_on_stop": check_cantilever}


def test_every_example_has_a_check():
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(CHECKS)


@pytest.mark.parametrize("name", sorted(CHECKS))
def test_example(name, tmp_path, capsys):
    result = load(name).main(tmp_path)
    printed = capsys.readouterr().out
    CHECKS[name](result, printed)
    pictures = sorted(tmp_path.glob("*.png"))
    assert pictures
    for picture in pictures:
        assert str(picture) in printed
        assert picture.stat().st_size > 5000
