import os
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from vofem.kernels.mode import kernels

sys.path.insert(0, str(Path(__file__).parent))

settings.register_profile("default", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))


#: Modules that come first, because they take longest. The first two compile different kernels: those of event_driven,
#: and those of methods that step in time. Two workers that begin with them compile few kernels twice.
FIRST = (
    "random_scenes", "energy_conserving", "friction_orbits", "populations", "harmonic_balance", "locus",
    "continuation", "verification", "docs", "impact_orbits", "storage", "compiled_cache", "symmetric_branches",
    "examples", "backbone", "kernel_modes", "fitting", "crash_safety", "sweep", "sensitivities",
    "tolerance_and_stops", "travelling", "checkpoints", "springpot", "orbit_sensitivities", "hunt_friction",
    "pictures", "settling", "choice_by_cost", "study_files", "hysteresis", "figures", "near_grazing",
    "steady_pictures", "friction", "movies", "accuracy", "impact_sensitivities", "event_loop", "start_up",
    "interrupts", "large_systems", "statuses", "generalized_alpha", "many_impacts", "hysteresis_in_time",
    "gradients", "stiff_equilibria", "cards", "condensed_orbits",
)  # fmt: skip


def pytest_collection_modifyitems(items):
    rank = {f"test_{name}": k for k, name in enumerate(FIRST)}
    items.sort(key=lambda item: rank.get(item.path.stem, len(FIRST)))


def pytest_addoption(parser):
    parser.addoption("--plain-kernels", action="store_true", help="run kernels as plain Python")


def pytest_configure(config):
    config.addinivalue_line(
        "markers", "kernels(way): run kernels as 'plain' Python, where that is quicker than compiling, or 'compiled'"
    )


@pytest.fixture(scope="session", autouse=True)
def _kernels(pytestconfig):
    """All tests run kernels in one way, whatever ran before; tests of the choice begin processes of their own."""
    with kernels(compiled=not pytestconfig.getoption("--plain-kernels")):
        yield


@pytest.fixture(scope="module", autouse=True)
def _kernels_of_module(request, _kernels):
    """The mark of a module holds for its fixtures too."""
    yield from _as_marked(request)


@pytest.fixture(autouse=True)
def _kernels_of_test(request, _kernels_of_module):
    """The mark of a test has precedence over that of its module."""
    yield from _as_marked(request)


@pytest.fixture(autouse=True)
def _figures_are_closed():
    """Figures of one test are gone before the next one: many open ones are a warning, and warnings are errors."""
    yield
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")


def _as_marked(request):
    mark = request.node.get_closest_marker("kernels")
    if mark is None or request.config.getoption("--plain-kernels"):
        yield
        return
    (way,) = mark.args
    with kernels(compiled={"plain": False, "compiled": True}[way]):
        yield
