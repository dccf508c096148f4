"""What single parts of a scene did along a run."""

from vofem.histories.probe import ProbeHistory

__all__ = ["ProbeHistory"]
