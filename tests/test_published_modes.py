"""Frequencies from the validation manuals of other codes (tests/data/published)."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import published, quantity

import vofem as vf


def check(case, names, frequencies, at=""):
    for name, frequency in zip(names, frequencies, strict=True):
        q = quantity(case, name, at)
        assert frequency == pytest.approx(q["value"], abs=q["tolerance"])
        # The independent recomputations have a mesh of their own: six digits.
        assert frequency == pytest.approx(q["our_value"], rel=1e-5)


def test_simply_supported_beam():
    case = published("vpcs_sdll05_ss_beam")
    p = case["parameters"]
    beam = vf.Beam(p["L"], p["E"] * p["I"], p["rho"] * p["A"], 40, {"left": "pinned", "right": "pinned"})
    check(case, ["f1", "f2"], vf.modes(vf.Scene([beam]), 2).frequencies)


@pytest.mark.parametrize("index", [0, 1, 2])
def test_beam_with_a_sprung_mass(index):
    """A beam and a mass, two bodies joined by a spring at a quarter of the span."""
    case = published("vpcs_sdll04_sprung_mass")
    p = case["parameters"]
    beam = vf.Beam(p["L"], p["E"] * p["I"], p["rho"] * p["A"], 40, {"left": "pinned", "right": "pinned"})
    if index == 0:
        check(case, ["f1", "f2"], vf.modes(vf.Scene([beam]), 2).frequencies, "bare")
        return
    mass = vf.Mass(p["m"][index])
    spring = vf.Spring(beam.at(p["L"] / 4.0), mass, stiffness=p["k"][index])
    modes = vf.modes(vf.Scene([beam, mass], [spring]), 3)
    check(case, ["f1", "f2", "f3"], modes.frequencies, f"m={p['m'][index]:g}")


def test_cantilever_with_a_tip_mass():
    case = published("vpcs_sdll15_tip_mass")
    p = case["parameters"]
    inertia = np.pi / 64.0 * (p["De"] ** 4 - p["Di"] ** 4)
    area = np.pi / 4.0 * (p["De"] ** 2 - p["Di"] ** 2)
    beam = vf.Beam(p["L"], p["E"] * inertia, p["rho"] * area, 40, {"left": "clamped"})
    tip = vf.PointMass(beam.at("right"), mass=p["tip_mass"])
    check(case, ["f1", "f2", "f3", "f4"], vf.modes(vf.Scene([beam], [tip]), 4).frequencies, "bending")


@pytest.mark.parametrize(("at", "root_width"), [("case 1", 0.04), ("case 2", 0.05)])
def test_tapered_cantilever(at, root_width):
    case = published("vpcs_sdll09_tapered")
    p = case["parameters"]

    def height(x):
        return 0.04 - 0.03 * x / p["L"]

    def width(x):
        return root_width - (root_width - 0.01) * x / p["L"]

    beam = vf.Beam(
        p["L"],
        lambda x: p["E"] * width(x) * height(x) ** 3 / 12.0,
        lambda x: p["rho"] * width(x) * height(x),
        60,
        {"left": "clamped"},
    )
    names = [f"f{k}" for k in range(1, 6)]
    check(case, names, vf.modes(vf.Scene([beam]), 5).frequencies, at)


def test_beam_folded_on_itself():
    """Two arms side by side, one clamped and one free at the far end, stiffly joined there: double frequencies."""
    case = published("vpcs_sdll02_folded")
    p = case["parameters"]
    width, height, arm = 0.050, 0.005, p["arm"]
    EI, rhoA = p["E"] * width * height**3 / 12.0, p["rho"] * width * height
    outer = vf.Beam(arm, EI, rhoA, 40, {"left": "clamped"})
    inner = vf.Beam(arm, EI, rhoA, 40)
    fold = [
        vf.Spring(outer.at("right"), inner.at("right"), stiffness=1e8 * EI / arm**3),
        vf.RotationalSpring(outer.at("right"), inner.at("right"), stiffness=1e8 * EI / arm),
    ]
    frequencies = vf.modes(vf.Scene([outer, inner], fold), 8).frequencies
    for k, name in enumerate(("f1,f2", "f3,f4", "f5,f6", "f7,f8")):
        q = quantity(case, name)
        for frequency in frequencies[2 * k : 2 * k + 2]:
            assert frequency == pytest.approx(q["value"], abs=q["tolerance"])
            assert frequency == pytest.approx(q["our_value"], rel=1e-4)
