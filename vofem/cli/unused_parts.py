"""Keeps parts of numpy that no command uses from being imported.

SciPy names every part of numpy when it is imported. numpy then imports parts that it would otherwise load when they are
first used: its interface to Fortran and its tools for tests. These take a third of the time that importing SciPy takes.
"""

from __future__ import annotations

import sys
from importlib.util import LazyLoader, find_spec, module_from_spec

import numpy as np

_PARTS = ("f2py", "testing")


def import_later() -> None:
    """Let these parts be imported when something in them is first asked for; in the process of a command only."""
    for part in _PARTS:
        name = f"numpy.{part}"
        spec = None if name in sys.modules else find_spec(name)
        if spec is None or spec.loader is None:
            continue
        spec.loader = LazyLoader(spec.loader)
        module = sys.modules[name] = module_from_spec(spec)
        spec.loader.exec_module(module)
        setattr(np, part, module)
