"""The closed form of a function of time between two breakpoints."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Piece:
    """A function near a time t0: ``sum_k Re(a_k exp(i w_k tau)) + c0 + c1 tau + c2 tau^2/2 + c3 tau^3/6``.

    Here tau is the time since t0.

    Attributes
    ----------
    harmonics : tuple of (float, complex)
        Pairs (w in rad/s, complex amplitude at t0).
    constant, slope, curvature, jerk : float
        Value and derivatives at t0 of the polynomial part.
    """

    harmonics: tuple[tuple[float, complex], ...] = ()
    constant: float = 0.0
    slope: float = 0.0
    curvature: float = 0.0
    jerk: float = 0.0

    def __add__(self, other: Piece) -> Piece:
        return Piece(
            self.harmonics + other.harmonics,
            self.constant + other.constant,
            self.slope + other.slope,
            self.curvature + other.curvature,
            self.jerk + other.jerk,
        )

    def scaled(self, factor: float) -> Piece:
        """Return the piece times a number."""
        harmonics = tuple((w, factor * a) for w, a in self.harmonics)
        polynomial = (factor * part for part in (self.constant, self.slope, self.curvature, self.jerk))
        return Piece(harmonics, *polynomial)
