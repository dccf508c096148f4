"""Simulations: the choice of a method, checks of arguments, runs and explanations."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_MODULES = {
    "vofem.integrators.registry": "method_names",
    "vofem.simulate.explanation": "Explanation explain",
    "vofem.simulate.methods": "Choice choose option_names",
    "vofem.simulate.plan": "Plan run_plan",
    "vofem.simulate.simulation": "simulate",
}

_LATER = {name: module for module, names in _MODULES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'vofem.simulate' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_LATER[name]), name)
