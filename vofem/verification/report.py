"""Outcomes as text, as Markdown and as JUnit XML."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from xml.etree import ElementTree

from vofem.integrators.registry import method_names
from vofem.verification.case import FAILED, PASSED, VERDICTS, Measured, Outcome, subjects

HEADINGS = ("case", "source", "quantity", "reference", "got", "error", "tolerance", "method", "verdict")

#: Widths at which columns of a terminal are cut off.
_WIDTHS = (44, 24, 30)


def rows(outcome: Outcome) -> list[tuple[str, ...]]:
    """Return the lines of an outcome under `HEADINGS`, one a quantity; one without numbers where there are none."""
    start, end = (outcome.case.label, outcome.case.source), (outcome.method, outcome.verdict)
    if not outcome.measured:
        return [(*start, "", "", "", "", "", *end)]
    return [(*start, *_numbers(m), *end) for m in outcome.measured]


def _numbers(m: Measured) -> tuple[str, ...]:
    kind = "" if m.quantity.relative else " abs"
    return (
        m.quantity.name, f"{m.quantity.reference:.10g}", f"{m.got:.10g}", f"{m.error:.1e}{kind}", f"{m.tolerance:.0e}",
    )  # fmt: skip


def text_header() -> str:
    """Return the header of the table for a terminal."""
    return _line(HEADINGS) + "\n" + "-" * len(_line(HEADINGS))


def text_lines(outcome: Outcome) -> str:
    """Return the lines of an outcome for a terminal, with the reason where it failed."""
    lines = [_line(row) for row in rows(outcome)]
    if outcome.verdict == FAILED:
        lines.append(f"    {outcome.message}")
    return "\n".join(lines)


def _line(row: Sequence[str]) -> str:
    name, source, quantity, reference, got, error, tolerance, method, verdict = row
    start = "  ".join(f"{text[:width]:<{width}}" for text, width in zip((name, source, quantity), _WIDTHS, strict=True))
    return f"{start}  {reference:>15}  {got:>15}  {error:>11}  {tolerance:>9}  {method:<18}  {verdict}"


def summary(outcomes: Iterable[Outcome]) -> str:
    """Return the number of runs of every verdict, on one line."""
    outcomes = tuple(outcomes)
    counts = {verdict: sum(o.verdict == verdict for o in outcomes) for verdict in VERDICTS}
    cases = len({o.case.name for o in outcomes})
    said = ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count or verdict == FAILED)
    return f"{cases} cases, {len(outcomes)} runs: {said}"


def markdown(outcomes: Iterable[Outcome], details: str = "") -> str:
    """Return a summary by method and by source, and the table of methods by cases, as Markdown.

    `details`: name of the file with the details, for a link to it; no link where empty.
    """
    outcomes = tuple(outcomes)
    lines = [
        "# Verification",
        "",
        "Written by `vofem verify --markdown docs/verification.md`; do not edit it. `vofem verify` runs the same",
        "catalogue on your machine, and the tests run it too. A case states a problem whose right answer is known from",
        "a closed form, an independent integration or a publication. Every method that applies is run on it.",
        "",
        *([f"[The details]({details}) list every quantity, its reference and what came out.", ""] if details else []),
        f"{summary(outcomes)}.",
        "",
        "## Summary",
        "",
        "A run has one of these outcomes:",
        "",
        "- **passed**: every quantity is within its tolerance.",
        "- **reported**: a quantity is beyond its tolerance at this step, and `result.notes` says so.",
        "- **refused**: an error before the first step. It names a method that can treat the case where there is one.",
        "- **stopped**: an error during the run: energy without a source, no convergence, a load that is not a number.",
        "- **FAILED**: anything else.",
        "",
        *_counts("method", subjects(), outcomes, lambda outcome: outcome.method),
        "",
        *_counts("cases from", _ORIGINS, outcomes, _origin),
        "",
        "## Methods and cases",
        "",
        "The number beside a verdict is the error of the quantity that comes nearest to its tolerance. It is relative",
        "unless it is marked abs. Hard cases carry a number; the others are published.",
        "",
    ]
    dynamic = [name for name in subjects() if name in method_names()]
    for heading, names in (
        ("### Motion in time", dynamic),
        ("### Statics, modes and steady states", [name for name in subjects() if name not in dynamic]),
    ):
        lines += _matrix(heading, names, outcomes)
    return "\n".join(lines).rstrip() + "\n"


def _matrix(heading: str, names: Sequence[str], outcomes: Sequence[Outcome]) -> list[str]:
    """Return a table of cases by methods, of those that were run."""
    mine = [o for o in outcomes if o.method in names]
    if not mine:
        return []
    names = [name for name in names if any(o.method == name for o in mine)]
    lines = []
    for case in dict.fromkeys(o.case for o in mine):
        cells = {o.method: _cell(o) for o in mine if o.case is case}
        lines.append((case.label, *(cells.get(name, "") for name in names)))
    return [heading, "", *_table(("case", *names), lines), ""]


_HARD = "hard cases of this package"
_PROGRAMS = ("code_aster", "VPCS", "ANSYS", "NLvib")
_ORIGINS = (_HARD, *_PROGRAMS, "other publications")


def _origin(outcome: Outcome) -> str:
    if outcome.case.number is not None:
        return _HARD
    return next((name for name in _PROGRAMS if name in outcome.case.source), _ORIGINS[-1])


def _counts(
    heading: str, names: Iterable[str], outcomes: Sequence[Outcome], name_of: Callable[[Outcome], str]
) -> list[str]:
    """Return a table of the number of runs of every verdict; names without runs are left out."""
    lines = []
    for name in names:
        mine = [outcome for outcome in outcomes if name_of(outcome) == name]
        if mine:
            counts = [sum(outcome.verdict == verdict for outcome in mine) for verdict in VERDICTS]
            cases = len({outcome.case.name for outcome in mine})
            lines.append((name, *map(str, (cases, *counts))))
    return _table((heading, "cases", *VERDICTS), lines, numbers=True)


def _table(headings: Sequence[str], lines: Iterable[Sequence[str]], numbers: bool = False) -> list[str]:
    """Return the lines of a table as Markdown; columns of numbers, all but the first, are aligned at the right."""
    below = ["---", *(["---:" if numbers else "---"] * (len(headings) - 1))]
    return [f"| {' | '.join(map(_escaped, cells))} |" for cells in (headings, below, *lines)]


def markdown_details(outcomes: Iterable[Outcome]) -> str:
    """Return a section for every case as Markdown: its source, all quantities, and the notes of the runs."""
    outcomes = tuple(outcomes)
    lines = [
        "# Verification in detail",
        "",
        "Written by `vofem verify --markdown docs/verification.md`; do not edit it. Errors are relative unless they",
        "are marked abs.",
    ]
    for case in dict.fromkeys(o.case for o in outcomes):
        mine = [o for o in outcomes if o.case is case]
        lines += ["", f"## {_escaped(case.label)}", "", f"Source: {_escaped(case.source)}", ""]
        measured = [(o, m) for o in mine for m in o.measured]
        if measured:
            cells = [(_run(outcome), *_numbers(m)) for outcome, m in measured]
            lines += _table(
                ("quantity", "reference", "method", "got", "error", "tolerance"),
                [(name, reference, how, *rest) for how, name, reference, *rest in cells],
            )
        said = [o for o in mine if o.verdict != PASSED]
        lines += [""] if measured and said else []
        lines += [f"- {_run(o)}, **{o.verdict}**: {_escaped(o.message)}" for o in said]
    return "\n".join(lines) + "\n"


def _run(outcome: Outcome) -> str:
    """Return the method and its options."""
    options = outcome.case.hows()[outcome.method].options.items()
    return ", ".join((outcome.method, *(f"{name} = {value:.4g}" for name, value in options)))


def _cell(outcome: Outcome) -> str:
    worst = outcome.worst
    if worst is None:
        return outcome.verdict
    return f"{outcome.verdict} {worst.error:.1e}{'' if worst.quantity.relative else ' abs'}"


def _escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("*", "\\*").replace("\n", " ").replace("<", "&lt;")


def junit(outcomes: Iterable[Outcome]) -> str:
    """Return the outcomes as JUnit XML: one suite a method, one test case a case."""
    outcomes = tuple(outcomes)
    root = ElementTree.Element("testsuites", name="vofem verify", tests=str(len(outcomes)))
    root.set("failures", str(sum(o.verdict == FAILED for o in outcomes)))
    for method in dict.fromkeys(o.method for o in outcomes):
        mine = [o for o in outcomes if o.method == method]
        suite = ElementTree.SubElement(root, "testsuite", name=method, tests=str(len(mine)))
        suite.set("failures", str(sum(o.verdict == FAILED for o in mine)))
        suite.set("time", f"{math.fsum(o.seconds for o in mine):.3f}")
        for o in mine:
            test = ElementTree.SubElement(
                suite, "testcase", classname=method, name=o.case.label, time=f"{o.seconds:.3f}"
            )
            if o.verdict == FAILED:
                ElementTree.SubElement(test, "failure", message=_printable(o.message))
            table = [*(", ".join(f"{h} {v}" for h, v in zip(HEADINGS[2:7], r[2:7], strict=True) if v) for r in rows(o))]
            ElementTree.SubElement(test, "system-out").text = _printable("\n".join((o.verdict, *table, o.message)))
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def _printable(text: str) -> str:
    """Leave out control characters, which XML cannot hold."""
    return "".join(c for c in text if c >= " " or c in "\n\t")
