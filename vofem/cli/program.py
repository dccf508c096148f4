"""Reads the command line and runs the command; ``vofem explain``, ``compile`` and ``doctor``, which are short."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from vofem._version import __version__
from vofem.cli.accuracy import add_accuracy
from vofem.cli.common import FAULT, FINE, Commands, limits, print_method
from vofem.cli.render import add_render
from vofem.cli.respond import add_respond
from vofem.cli.run import add_run
from vofem.cli.sweep import add_sweep
from vofem.cli.verify import add_verify


def run_command(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; errors and Ctrl-C are for the caller."""
    arguments = _parser().parse_args(argv)
    code: int = arguments.command(arguments)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="vofem", description="Beams and masses that hit, rattle and yield.")
    parser.add_argument("--version", action="version", version=f"vofem {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for add in (
        add_run, add_render, _add_explain, add_respond, add_sweep, add_verify, add_accuracy, _add_compile, _add_doctor,
    ):  # fmt: skip
        add(commands)
    return parser


def _add_explain(commands: Commands) -> None:
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


def _add_compile(commands: Commands) -> None:
    """Add the command to a parser."""
    compile_ = commands.add_parser("compile", help="compile all kernels ahead, so that no run has to wait for it")
    compile_.set_defaults(command=_compile)


def _compile(arguments: argparse.Namespace) -> int:
    from vofem.simulate.ahead import KINDS, cache_folder, compile_ahead

    folder = cache_folder()
    if folder is None:
        print(
            "vofem: compiled code cannot be kept: neither the folder of the package nor that of the user's caches can "
            "be written. Set NUMBA_CACHE_DIR to a folder that can"
        )
        return FAULT
    print(f"compiling for {len(KINDS)} kinds of work; code that is on disk already is read", flush=True)
    for kind, seconds in compile_ahead():
        print(f"{kind:<82} {seconds:6.1f} s", flush=True)
    print(f"compiled code is in {folder}")
    return FINE


def _add_doctor(commands: Commands) -> None:
    """Add the command to a parser."""
    doctor = commands.add_parser("doctor", help="show versions; say whether VTK can draw without a window")
    doctor.set_defaults(command=_doctor)


def _doctor(arguments: argparse.Namespace) -> int:
    from vofem.io.doctor import diagnose

    found = diagnose()
    print(found)
    return FAULT if found.missing else FINE
