"""The catalogue of hard and published cases: every quick run of it, its tables, and how it judges."""

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import vofem as vf
from vofem.cli import main
from vofem.verification import (
    FAILED,
    PASSED,
    REFUSED,
    REPORTED,
    STOPPED,
    Case,
    How,
    Quantity,
    catalogue,
    select,
    verify,
)
from vofem.verification.case import DYNAMIC, judge
from vofem.verification.cases.masses import bilinear_period
from vofem.verification.report import junit, markdown, markdown_details, summary

DOCS = Path(__file__).parent.parent / "docs" / "verification.md"
RUNS = [(case, method, how) for case in catalogue() for method, how in case.how.items() if not how.slow]

# What a case about numerics has to be there for; 30 is about files and has tests of its own.
NUMBERS = {*range(1, 30), 31, 32}


@pytest.mark.parametrize(
    ("case", "method", "how"),
    [pytest.param(*run, id=f"{run[0].label}, {run[1]}") for run in RUNS],
)
def test_case(case, method, how):
    outcome = judge(case, method, how)
    shown = "; ".join(f"{m.quantity.name} {m.got!r}, error {m.error:.2e}" for m in outcome.measured)
    assert outcome.verdict != FAILED, f"{outcome.message}. {shown}"


def test_every_hard_case_is_there_and_every_dynamic_method_has_its_word():
    assert {case.number for case in catalogue() if case.number} == NUMBERS
    names = [case.name for case in catalogue()]
    assert len(names) == len(set(names))
    for case in catalogue():
        assert case.source
        dynamic = set(case.how) - {"equilibrium", "modes", "shooting", "harmonic_balance"}
        # Cases of statics, of modes and of the order of steps are about these alone.
        assert dynamic in (set(), set(DYNAMIC)) or "order of steps" in case.name, case.name


@pytest.mark.parametrize(("energy", "gap", "period"), [(1e-3, 0.01, 1.7956890733), (1.0, 0.01, 1.4108224620)])
def test_formula_of_the_bilinear_period(energy, gap, period):
    assert bilinear_period(energy, gap) == pytest.approx(period, abs=1e-10)


def test_event_driven_passes_all_but_what_it_says():
    """It refuses what has no closed form and meshes on which K has lost its digits, and tells of coarse meshes."""
    others = {c.name for c in catalogue() if "event_driven" in c.how and c.how["event_driven"].expected != PASSED}
    assert others == {
        "a load that turns nan at 1 s",
        "a load that turns inf at 1 s",
        "a start velocity that is not a number",
        "bar of 400 masses on a stop of 10000 N/m",
        "graded mesh, elements 1 : 1e+06",
        "softening spring, manufactured solution",
        "fractional oscillator of order 1/2, released",
        "fractional oscillator of order 1/2, struck",
        "fractional oscillator of order 1/2, loaded",
    }


def test_the_table_of_the_docs_lists_every_case_and_no_failure():
    text = DOCS.read_text(encoding="utf-8")
    labels = [case.label for case in catalogue()]
    found = set()
    tables = text.split("## Methods and cases")[1]
    for table in tables.split("| case | ")[1:]:
        listed = [line.split(" | ")[0].removeprefix("| ") for line in table.splitlines() if line.startswith("| ")]
        assert listed == ["---", *(label for label in labels if label in listed)]
        found |= set(listed[1:])
    assert found == set(labels)
    assert ", 0 FAILED." in text
    assert "FAILED" not in tables


def toy(value=1.0, how=None, error=None, note=None):
    """A case that yields a value, a note or an error."""

    def measure(run):
        if error is not None:
            raise error
        if note is not None:
            run.notes.append(note)
        return {"x [m]": value}

    how = {"event_driven": How(1e-3), "central_difference": how or How(1e-3)}
    return Case(3, "toy | of <all> *things*", "closed form", (Quantity("x [m]", 1.0),), measure, how)


def verdict(case, method="central_difference"):
    return judge(case, method, case.how[method]).verdict


@pytest.mark.parametrize(
    ("value", "how", "note", "expected"),
    [
        (1.0005, How(1e-3), None, PASSED),
        (1.01, How(1e-3), None, FAILED),
        (np.nan, How(1e-3), None, FAILED),
        (1.01, How(1e-3, expected=REPORTED, says="rounding"), "rounding: much", REPORTED),
        (1.0, How(1e-3, expected=REPORTED, says="rounding"), None, PASSED),
        (1.01, How(1e-3, expected=REPORTED, says="rounding"), "energy: much", FAILED),
        (1.0, How(1e-3, says="coarse"), None, FAILED),
        (1.0, How(1e-3, expected=REFUSED), None, FAILED),
        (1.0, How(1e-3, expected=STOPPED), None, FAILED),
    ],
)
def test_verdicts_on_values(value, how, note, expected):
    assert verdict(toy(value, how, note=note)) == expected


@pytest.mark.parametrize(
    ("error", "how", "expected"),
    [
        (vf.StepSizeError("too large, choose method='event_driven'"), How(expected=REFUSED), REFUSED),
        (vf.StepSizeError("too large, choose method='generalized_alpha'"), How(expected=REFUSED), FAILED),
        (vf.StepSizeError("too large"), How(expected=REFUSED), FAILED),
        (vf.StepSizeError("too large, choose method='event_driven'"), How(expected=REFUSED, says="limit"), FAILED),
        (vf.StepSizeError("too large, choose method='event_driven'"), How(1e-3), FAILED),
        (vf.InstabilityError("blew up"), How(expected=STOPPED, says="blew up"), STOPPED),
        (vf.InstabilityError("blew up"), How(expected=REFUSED), FAILED),
        (ZeroDivisionError("division by zero"), How(expected=STOPPED), FAILED),
    ],
)
def test_verdicts_on_errors(error, how, expected):
    """A refusal must name a method that passes; an error that is none of vofem's is a failure."""
    assert verdict(toy(how=how, error=error)) == expected


def test_selection():
    cases = catalogue()
    assert {case.number for case in select(cases, "7")} == {7}
    assert all("grazing" in case.name for case in select(cases, "Grazing"))
    assert {case.number for case in select(cases, "code_aster")} == {None}
    assert select(cases, None) == cases
    with pytest.raises(vf.ArgumentError, match="no case matches 'unicorn'"):
        select(cases, "unicorn")
    with pytest.raises(vf.ArgumentError, match="did you mean 'event_driven'"):
        verify(cases, "event_drivn")


def test_reports():
    good, bad = toy(), toy(2.0)
    outcomes = list(verify([good, replace(bad, name="bad")]))
    assert summary(outcomes) == "2 cases, 4 runs: 2 passed, 2 FAILED"
    text = markdown(outcomes)
    assert r"| 3. toy \| of &lt;all> \*things\* | passed 0.0e+00 |" in text
    assert "| 3. bad | FAILED 1.0e+00 |" in text
    assert "| event_driven | 2 | 1 | 0 | 0 | 0 | 1 |" in text
    assert "| hard cases of this package | 2 | 2 | 0 | 0 | 0 | 2 |" in text
    details = markdown_details(outcomes)
    assert details.count("\n## ") == 2
    assert "- event_driven, **FAILED**: beyond its tolerance" in details
    root = ET.fromstring(junit(outcomes).split("\n", 1)[1])
    assert (root.get("tests"), root.get("failures")) == ("4", "2")
    assert [suite.get("name") for suite in root] == ["event_driven", "central_difference"]
    failures = root.findall(".//failure")
    assert [f.get("message") for f in failures] == ["beyond its tolerance"] * 2
    assert "error 1.0e+00, tolerance 1e-03" in root.find(".//testcase[@name='3. bad']/system-out").text


def test_command_line(tmp_path, capsys):
    files = ["--markdown", str(tmp_path / "new" / "v.md"), "--junit", str(tmp_path / "v.xml")]
    assert main(["verify", "--case", "12", "--method", "equilibrium", "--quick", *files]) == 0
    printed = capsys.readouterr().out
    header = re.split(r"\s{2,}", printed.splitlines()[0])
    assert header == ["case", "source", "quantity", "reference", "got", "error", "tolerance", "method", "verdict"]
    assert "1 cases, 1 runs: 1 passed, 0 FAILED" in printed
    assert "12. preload across a gap of zero" in (tmp_path / "new" / "v.md").read_text()
    assert "[The details](v-details.md)" in (tmp_path / "new" / "v.md").read_text()
    assert "## 12. preload across a gap of zero" in (tmp_path / "new" / "v-details.md").read_text()
    assert ET.parse(tmp_path / "v.xml").getroot().get("failures") == "0"


def test_command_line_fails_where_a_case_does(monkeypatch, capsys):
    monkeypatch.setattr("vofem.verification.catalogue", lambda: (toy(2.0),))
    assert main(["verify"]) == 1
    assert "beyond its tolerance" in capsys.readouterr().out
    assert main(["verify", "--method", "modes"]) == 1
    assert "no run is left" in capsys.readouterr().err
    assert main(["verify", "--markdown", "table.txt"]) == 1
    assert "expected a name that ends in '.md'" in capsys.readouterr().err
