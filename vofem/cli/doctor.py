"""``vofem doctor``: show versions, say whether VTK can draw on this machine."""

from __future__ import annotations

import argparse

from vofem.cli.common import FAULT, FINE, Commands


def add_doctor(commands: Commands) -> None:
    """Add the command to a parser."""
    doctor = commands.add_parser("doctor", help="show versions; say whether VTK can draw without a window")
    doctor.set_defaults(command=_doctor)


def _doctor(arguments: argparse.Namespace) -> int:
    from vofem.io.doctor import diagnose

    found = diagnose()
    print(found)
    return FAULT if found.missing else FINE
