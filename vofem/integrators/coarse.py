"""Contacts that are stiffer than the mesh they act on."""

from __future__ import annotations

import numpy as np

from vofem.system import System

#: From this many unknowns on a system may stand for a continuum.
_MANY = 20

#: Contact stiffness, over that of the mesh at its place, at which impact forces are off by a percent.
_STIFF = 0.3


def unresolved_contacts(system: System) -> list[str]:
    """Return a note on contacts stiffer than the mesh at their place, whose impacts show the mesh and not the body.

    The mesh's stiffness at a contact is that of its degrees of freedom, all
    others held. A chain of 400 masses that stands for a bar is off in its
    impact force by 2e-5 of the right one at a ratio of 0.01, 5e-3 at 0.25,
    0.14 at 1 and many times at 10.
    """
    return list(system.cache.get("unresolved contacts", None, lambda: _unresolved(system)))


def _unresolved(system: System) -> list[str]:
    laws = system.contacts
    if laws is None or system.size < _MANY:
        return []
    held = system.stiffness.diagonal()
    stiff = []
    for j in range(len(laws)):
        row = laws.rows[[j]]
        local = held[row.indices]
        # What nothing holds is a free mass, and no mesh.
        if local.size and np.all(local > 0.0):
            stiff.append((float(laws.stiffness[j] * np.sum(row.data**2 / local)), laws.names[j]))
    worst, name = max(stiff, default=(0.0, ""))
    if worst <= _STIFF:
        return []
    return [
        f"resolution: contact {name!r} is {worst:.2g} times stiffer than the mesh at its place, so its force in an "
        "impact oscillates with the mesh and peaks are not those of the body; refine the mesh to see by how much"
    ]
