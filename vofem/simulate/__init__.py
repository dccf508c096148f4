"""Simulations: the choice of a method, checks of arguments, runs and explanations."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vofem.integrators.registry import method_names as method_names
    from vofem.simulate.explanation import Explanation as Explanation
    from vofem.simulate.explanation import explain as explain
    from vofem.simulate.methods import Choice as Choice
    from vofem.simulate.methods import choose as choose
    from vofem.simulate.methods import option_names as option_names
    from vofem.simulate.plan import Plan as Plan
    from vofem.simulate.plan import run_plan as run_plan
    from vofem.simulate.simulation import simulate as simulate

_MODULES = {
    "vofem.integrators.registry": "method_names",
    "vofem.simulate.explanation": "Explanation explain",
    "vofem.simulate.methods": "Choice choose option_names",
    "vofem.simulate.plan": "Plan run_plan",
    "vofem.simulate.simulation": "simulate",
}

_LATER = {name: module for module, names in _MODULES.items() for name in names.split()}

__all__ = list(_LATER)


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'vofem.simulate' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(_LATER[name]), name)
