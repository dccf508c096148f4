"""Many runs at once: one function, called for many points, on any executor."""

from vofem.studies.sweep.sweep import FailedPoint, Sweep, SweepInterrupted

__all__ = ["FailedPoint", "Sweep", "SweepInterrupted"]
