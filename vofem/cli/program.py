"""Reads the command line, runs the command, turns errors into messages and exit codes."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

from vofem._version import __version__
from vofem.cli.accuracy import add_accuracy
from vofem.cli.common import FAULT, FINE
from vofem.cli.compile import add_compile
from vofem.cli.doctor import add_doctor
from vofem.cli.explain import add_explain
from vofem.cli.prompt_end import pressed
from vofem.cli.render import add_render
from vofem.cli.respond import add_respond
from vofem.cli.run import add_run
from vofem.cli.sweep import add_sweep
from vofem.cli.unused_parts import import_later
from vofem.cli.verify import add_verify
from vofem.errors import VofemError


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; Ctrl-C is for the caller."""
    import_later()
    arguments = _parser().parse_args(argv)
    try:
        code: int = arguments.command(arguments)
        sys.stdout.flush()
        return code
    except VofemError as error:
        if pressed():
            raise KeyboardInterrupt from None
        print(f"vofem: {error}", file=sys.stderr)
        return FAULT
    except BrokenPipeError:
        # The program that reads the output has ended, as in `vofem explain ... | head`, so nothing more can be printed.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FINE


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="vofem", description="Beams and masses that hit, rattle and yield.")
    parser.add_argument("--version", action="version", version=f"vofem {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for add in (
        add_run, add_render, add_explain, add_respond, add_sweep, add_verify, add_accuracy, add_compile, add_doctor,
    ):  # fmt: skip
        add(commands)
    return parser
