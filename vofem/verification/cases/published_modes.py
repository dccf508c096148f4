"""Frequencies from the validation manuals of other codes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from vofem.bodies import Beam, Mass
from vofem.effects import PointMass, RotationalSpring, Spring
from vofem.scene import Scene
from vofem.verification.case import Case, How, Quantity, Run
from vofem.verification.published_data import entry, published, source

PINNED = {"left": "pinned", "right": "pinned"}


def cases() -> Iterator[Case]:
    """Yield the cases."""
    yield _case("simply supported beam", "vpcs_sdll05_ss_beam", _simply_supported, ("f1", "f2"))
    yield _case("beam with a sprung mass, bare", "vpcs_sdll04_sprung_mass", _bare, ("f1", "f2"), "bare")
    for index in (1, 2):
        m = published("vpcs_sdll04_sprung_mass")["parameters"]["m"][index]

        def sprung(p: Mapping[str, Any], index: int = index) -> Scene:
            return _sprung(p, index)

        name = f"beam with a sprung mass of {m:g} kg"
        yield _case(name, "vpcs_sdll04_sprung_mass", sprung, ("f1", "f2", "f3"), f"m={m:g}")
    yield _case(
        "cantilever tube with a tip mass", "vpcs_sdll15_tip_mass", _tip_mass, ("f1", "f2", "f3", "f4"), "bending"
    )
    for at, width in (("case 1", 0.04), ("case 2", 0.05)):

        def tapered(p: Mapping[str, Any], width: float = width) -> Scene:
            return _tapered(p, width)

        yield _case(f"tapered cantilever, {at}", "vpcs_sdll09_tapered", tapered, [f"f{k}" for k in range(1, 6)], at)
    yield _case(
        "beam folded on itself", "vpcs_sdll02_folded", _folded, ("f1,f2", "f3,f4", "f5,f6", "f7,f8"), each=2, own=1e-4
    )


def _case(
    name: str, file: str, build: Callable[[Mapping[str, Any]], Scene], names: Sequence[str], at: str = "",
    each: int = 1, own: float = 1e-5,
) -> Case:  # fmt: skip
    """Return a case that compares with the printed values, and with independent recomputations to more digits."""
    data = published(file)
    entries = [entry(data, key, at) for key in names]
    printed = [f"{key} as printed [Hz]" for key in names]
    again = [f"{key} recomputed [Hz]" for key in names]

    def measure(run: Run) -> Mapping[str, float]:
        found = run.modes(build(data["parameters"]), each * len(names)).frequencies.reshape(len(names), each)
        values = {}
        for k, q in enumerate(entries):
            values[printed[k]] = float(found[k][np.argmax(np.abs(found[k] - q["value"]))])
            values[again[k]] = float(found[k][np.argmax(np.abs(found[k] - q["our_value"]))])
        return values

    quantities = [Quantity(key, q["value"], relative=False) for key, q in zip(printed, entries, strict=True)]
    quantities += [Quantity(key, q["our_value"]) for key, q in zip(again, entries, strict=True)]
    tolerance = {key: q["tolerance"] for key, q in zip(printed, entries, strict=True)} | dict.fromkeys(again, own)
    return Case(None, name, source(data), tuple(quantities), measure, {"modes": How(tolerance)})


def _simply_supported(p: Mapping[str, Any]) -> Scene:
    return Scene([Beam(p["L"], p["E"] * p["I"], p["rho"] * p["A"], 40, PINNED)])


def _bare(p: Mapping[str, Any]) -> Scene:
    return _simply_supported(p)


def _sprung(p: Mapping[str, Any], index: int) -> Scene:
    """Return a beam and a mass, two bodies joined by a spring at a quarter of the span."""
    beam = Beam(p["L"], p["E"] * p["I"], p["rho"] * p["A"], 40, PINNED)
    mass = Mass(p["m"][index])
    return Scene([beam, mass], [Spring(beam.at(p["L"] / 4.0), mass, stiffness=p["k"][index])])


def _tip_mass(p: Mapping[str, Any]) -> Scene:
    inertia = np.pi / 64.0 * (p["De"] ** 4 - p["Di"] ** 4)
    area = np.pi / 4.0 * (p["De"] ** 2 - p["Di"] ** 2)
    beam = Beam(p["L"], p["E"] * inertia, p["rho"] * area, 40, {"left": "clamped"})
    return Scene([beam], [PointMass(beam.at("right"), mass=p["tip_mass"])])


def _tapered(p: Mapping[str, Any], root_width: float) -> Scene:
    def height(x: Any) -> Any:
        return 0.04 - 0.03 * x / p["L"]

    def width(x: Any) -> Any:
        return root_width - (root_width - 0.01) * x / p["L"]

    def bending(x: Any) -> Any:
        return p["E"] * width(x) * height(x) ** 3 / 12.0

    def mass(x: Any) -> Any:
        return p["rho"] * width(x) * height(x)

    return Scene([Beam(p["L"], bending, mass, 60, {"left": "clamped"})])


def _folded(p: Mapping[str, Any]) -> Scene:
    """Return two arms side by side, one clamped and one free at the far end, stiffly joined there."""
    width, height, arm = 0.050, 0.005, p["arm"]
    EI, rhoA = p["E"] * width * height**3 / 12.0, p["rho"] * width * height
    outer = Beam(arm, EI, rhoA, 40, {"left": "clamped"})
    inner = Beam(arm, EI, rhoA, 40)
    fold = [
        Spring(outer.at("right"), inner.at("right"), stiffness=1e8 * EI / arm**3),
        RotationalSpring(outer.at("right"), inner.at("right"), stiffness=1e8 * EI / arm),
    ]
    return Scene([outer, inner], fold)
