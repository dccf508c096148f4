"""The scenes that are measured."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import vofem as vf
from vofem.system import ContactLaws, Load, System

Build = Callable[[int], vf.Scene]


def paper_beam(
    acts_on: str,
    stiffness: float = 1.0,
    switch: Any = "ideal",
    extra: Callable[[vf.Beam], list[Any]] | None = None,
    contact: bool = True,
) -> Build:
    """Return a function of the number of elements: the paper's cantilever (section 4.2) above its stop."""

    def build(elements: int) -> vf.Scene:
        beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=elements, supports={"left": "clamped"}, name="beam")
        tip = beam.at(1.0)
        effects: list[Any] = [vf.PointLoad(tip, vf.Sine(0.1, 1.0))]
        if contact:
            effects.append(
                vf.Contact(
                    tip, gap=0.03, stiffness=stiffness, side="below", acts_on=acts_on, switch=switch, name="stop"
                )
            )
        return vf.Scene([beam], effects + (extra(beam) if extra is not None else []))

    return build


def two_masses(case: str, acts_on: str) -> vf.Scene:
    """Return the paper's two masses (section 4.1)."""
    forces = {
        "a": (vf.Sine(-3.0, 0.3), None),
        "b": (vf.Sine(-10.0, 0.3), None),
        "c": (vf.Sine(5.0, 0.8), vf.Sine(-5.0, 0.8)),
    }
    first = vf.Mass(1.0, stiffness=1.0, damping=0.1, name="first")
    second = vf.Mass(1.0, stiffness=1.0, damping=0.4, name="second")
    contact = vf.Contact(first, second, gap=5.0, stiffness=2.0, acts_on=acts_on, name="contact")
    loads = [vf.PointLoad(m, f) for m, f in zip((first, second), forces[case], strict=True) if f is not None]
    return vf.Scene([first, second], [contact, *loads], initial={first: (0.0, -1.0)})


def many_contacts(elements: int, contacts: int) -> vf.Scene:
    """Return the cantilever over stops that are spread along it, all of which it meets."""
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=elements, supports={"left": "clamped"}, name="beam")
    places = np.linspace(0.3, 1.0, contacts) if contacts > 1 else np.ones(contacts)
    effects: list[Any] = [vf.PointLoad(beam.at(1.0), vf.Sine(0.1, 1.0))]
    effects += [
        vf.Contact(beam.at(x), gap=0.03 * x**2, stiffness=1.0, side="below", acts_on="penetration", name=f"stop-{k}")
        for k, x in enumerate(places)
    ]
    return vf.Scene([beam], effects)


def chain(masses: int, contacts: int) -> System:
    """Return a chain of masses and springs, its last masses before stops, as integrators see it.

    A scene of a hundred thousand bodies takes a minute to assemble; here only time steps are of interest.
    """
    from scipy.sparse import csr_matrix, diags, identity

    ones = np.ones(masses)
    last = ones.copy()
    last[-1] = 0.0
    load = np.zeros(masses)
    load[-1] = 1.0
    laws = None
    if contacts:
        rows = csr_matrix(
            (-np.ones(contacts), (np.arange(contacts), masses - 1 - np.arange(contacts))), shape=(contacts, masses)
        )
        many = np.ones(contacts)
        names = tuple(f"stop-{k}" for k in range(contacts))
        laws = ContactLaws(
            names, rows, 0.03 * many, many, 0.0 * many, np.zeros(contacts, dtype=bool), np.inf * many, np.nan * many
        )
    return System(
        mass=identity(masses, format="csc"),
        stiffness=diags([ones + last, -ones[1:], -ones[1:]], [0, 1, -1], format="csc"),
        damping=None, rayleigh=None, modal_damping=None, loads=(Load(load, vf.Sine(0.1, 1.0), "the load"),),
        laws=() if laws is None else (laws,), scale=ones, strain=None, rigid=np.empty((masses, 0)),
        rotation=np.zeros(masses, dtype=bool),
    )  # fmt: skip
