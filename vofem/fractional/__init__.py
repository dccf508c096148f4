"""Variable-order Riemann-Liouville operators: order laws and the operator on constants."""

from vofem.fractional.constants import ideal, literal, resolved
from vofem.fractional.orders import exponential_order, scaling_factor

__all__ = ["exponential_order", "ideal", "literal", "resolved", "scaling_factor"]
