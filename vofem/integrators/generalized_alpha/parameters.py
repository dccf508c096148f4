"""The numbers of the generalized-alpha method."""

from __future__ import annotations

from typing import NamedTuple

from vofem._validate import number
from vofem.errors import ArgumentError


class Parameters(NamedTuple):
    """The method's four numbers."""

    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float


def parameters(
    rho_infinity: float = 0.8,
    alpha_m: float | None = None,
    alpha_f: float | None = None,
    gamma: float | None = None,
    newmark_beta: float | None = None,
) -> Parameters:
    """Return the parameters of the method, those given in place of Chung and Hulbert's.

    Raises
    ------
    ArgumentError
        Outside [0, 1] for rho_infinity, or where linear systems would not be stable.
    """
    rho = number("simulate: rho_infinity", rho_infinity, minimum=0)
    if rho > 1.0:
        raise ArgumentError(
            f"simulate: rho_infinity is {rho:g}, expected a number in [0, 1]: 1 without numerical dissipation, "
            "0 with most"
        )
    am = (2.0 * rho - 1.0) / (rho + 1.0) if alpha_m is None else number("simulate: alpha_m", alpha_m)
    af = rho / (rho + 1.0) if alpha_f is None else number("simulate: alpha_f", alpha_f)
    g = 0.5 - am + af if gamma is None else number("simulate: gamma", gamma)
    b = 0.25 * (1.0 - am + af) ** 2 if newmark_beta is None else number("simulate: newmark_beta", newmark_beta)
    slack = 1e-12
    if not (am <= af + slack and af <= 0.5 + slack and g >= 0.5 - am + af - slack and b >= 0.5 * g - slack and b > 0):
        raise ArgumentError(
            f"simulate: alpha_m = {am:g}, alpha_f = {af:g}, gamma = {g:g}, newmark_beta = {b:g} are not "
            "unconditionally stable, expected alpha_m <= alpha_f <= 1/2, gamma >= 1/2 - alpha_m + alpha_f and "
            "newmark_beta >= gamma/2; rho_infinity alone chooses all four"
        )
    return Parameters(am, af, g, b)
