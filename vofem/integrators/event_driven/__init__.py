"""The event-driven method; see `run`."""

from vofem.integrators.event_driven.run import EventSolution, refusal, run

__all__ = ["EventSolution", "refusal", "run"]
