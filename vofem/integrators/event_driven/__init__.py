"""The event-driven method; see `run`."""

from vofem.integrators.event_driven.run import refusal, run
from vofem.integrators.event_driven.solution import EventSolution

__all__ = ["EventSolution", "refusal", "run"]
