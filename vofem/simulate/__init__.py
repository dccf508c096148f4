"""Simulations: methods and their choice, arguments, plans, explanations."""

from vofem.simulate.explanation import Explanation, explain
from vofem.simulate.methods import METHODS, Choice, choose, option_names
from vofem.simulate.plan import Plan, run_plan
from vofem.simulate.simulation import simulate

__all__ = ["METHODS", "Choice", "Explanation", "Plan", "choose", "explain", "option_names", "run_plan", "simulate"]
