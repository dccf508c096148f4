"""Simulations: methods and their choice, arguments, plans, explanations."""

from vofem.integrators.registry import method_names
from vofem.simulate.explanation import Explanation, explain
from vofem.simulate.methods import Choice, choose, option_names
from vofem.simulate.plan import Plan, run_plan
from vofem.simulate.simulation import simulate

__all__ = [
    "Choice",
    "Explanation",
    "Plan",
    "choose",
    "explain",
    "method_names",
    "option_names",
    "run_plan",
    "simulate",
]
