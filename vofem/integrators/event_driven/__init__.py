"""The event-driven method; see `run`."""

from vofem.integrators.event_driven.run import refusal, run
from vofem.integrators.event_driven.sliding import SlidingSolution
from vofem.integrators.event_driven.solution import EventSolution

__all__ = ["EventSolution", "SlidingSolution", "refusal", "run"]
