"""``vofem verify``: the catalogue of hard and published cases on this machine."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path

from vofem.cli.common import FAULT, FINE, Commands, made
from vofem.errors import ArgumentError
from vofem.integrators.registry import method_names


def add_verify(commands: Commands) -> None:
    """Add the command to a parser."""
    verify = commands.add_parser("verify", help="run the catalogue of hard and published cases on this machine")
    methods = ", ".join((*method_names(), "equilibrium", "modes", "shooting", "harmonic_balance"))
    verify.add_argument("--method", help=f"only {methods}")
    verify.add_argument("--case", metavar="PATTERN", help="number of a hard case, or a part of a name or a source")
    verify.add_argument(
        "--markdown", type=Path, metavar="FILE", help="write a summary there, .md, and tables beside it"
    )
    verify.add_argument("--junit", type=Path, metavar="FILE", help="write JUnit XML there, .xml")
    verify.add_argument("--quick", action="store_true", help="leave out runs that take long")
    verify.set_defaults(command=_verify)


def _verify(arguments: argparse.Namespace) -> int:
    from vofem.files.whole import target, write_text
    from vofem.verification import FAILED, catalogue, select, verify
    from vofem.verification.report import junit, markdown, markdown_details, summary, text_header, text_lines

    # The file is checked first, so that minutes of runs do not end because it cannot be written.
    files: list[tuple[Path, str, Callable[..., str]]]
    files = [] if arguments.junit is None else [(arguments.junit, ".xml", junit)]
    if arguments.markdown is not None:
        beside = arguments.markdown.with_name(f"{arguments.markdown.stem}-details.md")
        files.append((arguments.markdown, ".md", partial(markdown, details=beside.name)))
        files.append((beside, ".md", markdown_details))
    for file, suffix, _ in files:
        made(target(file, (suffix,)).parent)
    outcomes = []
    chosen = select(catalogue(), arguments.case)
    print(text_header(), flush=True)
    for outcome in verify(chosen, arguments.method, arguments.quick):
        outcomes.append(outcome)
        print(text_lines(outcome), flush=True)
    if not outcomes:
        raise ArgumentError("verify: no case that was chosen has to do with that method; leave out --method or --case")
    print(f"\n{summary(outcomes)}")
    written = [write_text(file, form(outcomes)) for file, _, form in files]
    if written:
        print("wrote " + "\n      ".join(str(path) for path in written))
    return FAULT if any(outcome.verdict == FAILED for outcome in outcomes) else FINE
