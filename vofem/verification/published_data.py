"""The published numbers that come with the package, as files of JSON."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files
from typing import Any


@cache
def published(name: str) -> dict[str, Any]:
    """Return a published test case: statement, parameters, sources, and quantities with what is known of them."""
    text = (files("vofem.verification") / "published" / f"{name}.json").read_text(encoding="utf-8")
    case: dict[str, Any] = json.loads(text)
    return case


def entry(case: dict[str, Any], name: str, at: str | None = None) -> dict[str, Any]:
    """Return one quantity of a published case: value, tolerance and independent recomputation."""
    found = [q for q in case["quantities"] if q["name"] == name and (at is None or q["at"] == at)]
    if len(found) != 1:
        raise KeyError(f"{case['id']} has {len(found)} quantities {name!r} at {at!r}")
    quantity: dict[str, Any] = found[0]
    return quantity


def source(case: dict[str, Any]) -> str:
    """Return the test case's name and where it is published."""
    return f"{case['id']}, {case['source'][0].split(' ')[0]}"
