"""Timings of the standard scenes with pytest-benchmark: ``pytest benchmarks``. They assert nothing.

Regressions of work are caught by counters, in tests/test_absent_effects.py and
tests/test_work_ceilings.py; these tell of seconds on one machine.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from cases import many_contacts, paper_beam, two_masses

import vofem as vf

TIMES = np.linspace(0.0, 20.0, 1001)
STEPPING = ("energy_conserving", "generalized_alpha")


def run(scene: vf.Scene, **options: object) -> np.ndarray:
    result = vf.simulate(scene, 20.0, times=TIMES, **options)
    return result.displacement(scene.contacts[0].a)


@pytest.mark.parametrize("law", ["penetration", "displacement"])
@pytest.mark.parametrize("elements", [25, 100, 1000])
def test_beam_by_events(benchmark, law, elements):
    scene = paper_beam(law)(elements)
    benchmark(run, scene)


@pytest.mark.parametrize("method", STEPPING)
@pytest.mark.parametrize("elements", [25, 1000])
def test_beam_by_steps(benchmark, method, elements):
    scene = paper_beam("penetration")(elements)
    benchmark(run, scene, method=method, dt=4e-3)


@pytest.mark.parametrize("case", ["a", "b", "c"])
def test_two_masses(benchmark, case):
    scene = two_masses(case, "displacement")
    benchmark(run, scene)


def test_ten_contacts(benchmark):
    scene = many_contacts(25, 10)
    benchmark(run, scene)


def test_assembly_of_a_thousand_elements(benchmark):
    build = paper_beam("penetration")
    benchmark(lambda: build(1000).model)
