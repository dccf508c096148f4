"""Outcomes as text, as Markdown and as JUnit XML."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree

from vofem.verification.case import FAILED, PASSED, REFUSED, STOPPED, TOLD, subjects
from vofem.verification.runner import Measured, Outcome

HEADINGS = ("case", "source", "quantity", "reference", "got", "error", "tolerance", "method", "verdict")

#: Widths beyond which columns of a terminal are cut.
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
    """Return the lines of an outcome for a terminal; what failed says why."""
    lines = [_line(row) for row in rows(outcome)]
    if outcome.verdict == FAILED:
        lines.append(f"    {outcome.message}")
    return "\n".join(lines)


def _line(row: Sequence[str]) -> str:
    name, source, quantity, reference, got, error, tolerance, method, verdict = row
    start = "  ".join(f"{text[:width]:<{width}}" for text, width in zip((name, source, quantity), _WIDTHS, strict=True))
    return f"{start}  {reference:>15}  {got:>15}  {error:>11}  {tolerance:>9}  {method:<18}  {verdict}"


def summary(outcomes: Iterable[Outcome]) -> str:
    """Return how many runs came to which verdict, on one line."""
    outcomes = tuple(outcomes)
    counts = {
        verdict: sum(o.verdict == verdict for o in outcomes) for verdict in (PASSED, TOLD, REFUSED, STOPPED, FAILED)
    }
    cases = len({o.case.name for o in outcomes})
    said = ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count or verdict == FAILED)
    return f"{cases} cases, {len(outcomes)} runs: {said}"


def markdown(outcomes: Iterable[Outcome]) -> str:
    """Return the table of methods by cases, and all quantities, as Markdown."""
    outcomes = tuple(outcomes)
    lines = [
        "# Verification",
        "",
        "Written by `vofem verify --markdown docs/verification.md`; do not edit it. `vofem verify` runs the same",
        "catalogue on your machine, and the tests run it too. Hard cases carry their number; the others are published.",
        "",
        "- **passed**: every quantity is within its tolerance. The figure is the error of the quantity that comes",
        "  nearest to its tolerance, relative unless it is marked abs.",
        "- **told**: beyond the tolerance at this step, and `result.notes` says so.",
        "- **refused**: an error before the first step, which names a method that can where one can.",
        "- **stopped**: a typed error on the way: energy out of nothing, no convergence, a load that is no number.",
        "",
        f"{summary(outcomes)}.",
        "",
        "## Methods and cases",
        "",
        "| case | " + " | ".join(subjects()) + " |",
        "| --- |" + " --- |" * len(subjects()),
    ]
    for case in dict.fromkeys(o.case for o in outcomes):
        mine = {o.method: o for o in outcomes if o.case is case}
        cells = [_cell(mine[method]) if method in mine else "" for method in subjects()]
        lines.append(f"| {_escaped(case.label)} | " + " | ".join(cells) + " |")
    lines += ["", "## Quantities", "", "| " + " | ".join((*HEADINGS[:-1], "options", HEADINGS[-1])) + " |"]
    lines.append("|" + " --- |" * (len(HEADINGS) + 1))
    for outcome in outcomes:
        options = ", ".join(f"{k} = {v:.4g}" for k, v in outcome.case.hows()[outcome.method].options.items())
        for row in rows(outcome):
            lines.append("| " + " | ".join(_escaped(text) for text in (*row[:-1], options, row[-1])) + " |")
    said = [o for o in outcomes if o.message and o.verdict != PASSED]
    lines += ["", "## What users are told", ""]
    lines += [f"- {_escaped(o.case.label)}, {o.method}, {o.verdict}: {_escaped(o.message)}" for o in said]
    return "\n".join(lines) + "\n"


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
