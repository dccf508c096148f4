"""The closed form of a function of time between two breakpoints."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Piece:
    """A function near a time t0: ``sum_k Re(a_k exp(i w_k tau)) + c0 + c1 tau``, tau = t - t0.

    Attributes
    ----------
    harmonics : tuple of (float, complex)
        Pairs (w in rad/s, complex amplitude at t0).
    constant, slope : float
        The polynomial part.
    """

    harmonics: tuple[tuple[float, complex], ...] = ()
    constant: float = 0.0
    slope: float = 0.0

    def __add__(self, other: Piece) -> Piece:
        return Piece(self.harmonics + other.harmonics, self.constant + other.constant, self.slope + other.slope)

    def scaled(self, factor: float) -> Piece:
        """Return the piece times a number."""
        harmonics = tuple((w, factor * a) for w, a in self.harmonics)
        return Piece(harmonics, factor * self.constant, factor * self.slope)
