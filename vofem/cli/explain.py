"""``vofem explain``: say what would be simulated, how, and what not."""

from __future__ import annotations

import argparse
from pathlib import Path

from vofem.cli.common import FINE, Commands, limits, print_method


def add_explain(commands: Commands) -> None:
    """Add the command to a parser."""
    explain = commands.add_parser("explain", help="say what would be simulated, how, and what not")
    explain.add_argument("scene", type=Path, help="scene file, TOML")
    explain.set_defaults(command=_explain)


def _explain(arguments: argparse.Namespace) -> int:
    from vofem.io.scene_file import load_scene
    from vofem.simulate.explanation import explain

    file = load_scene(arguments.scene)
    print(explain(file.scene, *limits(file)))
    print_method(file, None)
    return FINE
