"""Variable-order Riemann-Liouville operators: order laws, the operator on constants and on functions."""

from vofem.fractional.constants import ideal, literal, resolved
from vofem.fractional.laws import ConstantOrder, ExponentialOrder, OrderLaw, TabulatedOrder
from vofem.fractional.operator import rl_derivative, rl_integral
from vofem.fractional.orders import exponential_order, scaling_factor
from vofem.fractional.streaming import StreamingDerivative

__all__ = [
    "ConstantOrder",
    "ExponentialOrder",
    "OrderLaw",
    "StreamingDerivative",
    "TabulatedOrder",
    "exponential_order",
    "ideal",
    "literal",
    "resolved",
    "rl_derivative",
    "rl_integral",
    "scaling_factor",
]
