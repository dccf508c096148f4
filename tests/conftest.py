from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from vofem.kernel_mode import kernels

sys.path.insert(0, str(Path(__file__).parent))

settings.register_profile("default", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))


def pytest_addoption(parser):
    parser.addoption("--plain-kernels", action="store_true", help="run kernels as plain Python")


@pytest.fixture(scope="session", autouse=True)
def _kernels(pytestconfig):
    """All tests run kernels in one way, whatever ran before; tests of the choice begin processes of their own."""
    with kernels(compiled=not pytestconfig.getoption("--plain-kernels")):
        yield
