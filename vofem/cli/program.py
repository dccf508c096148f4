"""Reads the command line and runs the command."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from vofem._version import __version__
from vofem.cli.accuracy import add_accuracy
from vofem.cli.compile import add_compile
from vofem.cli.doctor import add_doctor
from vofem.cli.explain import add_explain
from vofem.cli.render import add_render
from vofem.cli.respond import add_respond
from vofem.cli.run import add_run
from vofem.cli.sweep import add_sweep
from vofem.cli.unused_parts import import_later
from vofem.cli.verify import add_verify


def run_command(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; errors and Ctrl-C are for the caller."""
    import_later()
    arguments = _parser().parse_args(argv)
    code: int = arguments.command(arguments)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="vofem", description="Beams and masses that hit, rattle and yield.")
    parser.add_argument("--version", action="version", version=f"vofem {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for add in (
        add_run, add_render, add_explain, add_respond, add_sweep, add_verify, add_accuracy, add_compile, add_doctor,
    ):  # fmt: skip
        add(commands)
    return parser
