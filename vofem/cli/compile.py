"""``vofem compile``: compile all numerical kernels ahead, once on a machine."""

from __future__ import annotations

import argparse

from vofem.cli.common import FAULT, FINE, Commands


def add_compile(commands: Commands) -> None:
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
