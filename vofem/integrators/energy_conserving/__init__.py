"""The midpoint rule with a discrete gradient for every scalar law."""

from vofem.integrators.energy_conserving.run import run

__all__ = ["run"]
