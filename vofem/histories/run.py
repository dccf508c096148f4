"""The attributes of a run that histories use."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vofem.assembly import Model
from vofem.integrators.base import ContactSamples, Sampled, Solution


class Run(Protocol):
    """A run as its histories see it; nothing is computed before it is asked for."""

    @property
    def model(self) -> Model:
        """The compiled scene."""

    @property
    def solution(self) -> Solution:
        """The solution of the integrator."""

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of the run in s, shape (n_times,)."""

    @property
    def samples(self) -> Sampled:
        """Free degrees of freedom at `times`."""

    @property
    def contact_samples(self) -> ContactSamples:
        """Contacts at `times`."""
