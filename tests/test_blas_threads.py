"""Small runs keep BLAS to one thread, large ones leave it alone, and what was set before comes back."""

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

import vofem as vf
from vofem import blas
from vofem.errors import VofemError


@pytest.fixture(scope="module", autouse=True)
def controller():
    """Find the libraries once: it takes a millisecond, and loads ask often."""
    import scipy.linalg  # noqa: F401

    threads.controller = ThreadpoolController()


def threads():
    """Return the numbers of threads of all BLAS libraries that are loaded."""
    return [library.num_threads for library in threads.controller.lib_controllers if library.user_api == "blas"]


def chain(count, seen):
    """Return masses in a row under a load that looks at the threads whenever it is asked for its value."""
    masses = [vf.Mass(1.0, stiffness=1.0, name=f"m{k}") for k in range(count)]

    def load(t):
        seen.append(threads())
        return np.sin(t)

    return vf.Scene(masses, [vf.PointLoad(masses[0], load)])


@pytest.fixture
def two_threads():
    """Set two threads, as is the default of machines with two cores."""
    with threads.controller.limit(limits=2, user_api="blas"):
        if 2 not in threads():
            pytest.fail("this BLAS takes no number of threads, so that nothing can be said of it")
        yield threads()


def test_a_small_run_takes_one_thread_and_gives_the_others_back(two_threads):
    seen = []
    vf.simulate(chain(3, seen), 0.1, dt=0.05, method="energy_conserving", compiled=False)
    assert seen
    assert all(set(found) == {1} for found in seen)
    assert threads() == two_threads


def test_a_large_run_takes_all_threads(two_threads, monkeypatch):
    monkeypatch.setattr(blas, "_SMALL", 2)
    seen = []
    vf.simulate(chain(3, seen), 0.1, dt=0.05, method="energy_conserving", compiled=False)
    assert seen
    assert all(found == two_threads for found in seen)


def test_a_run_that_fails_gives_them_back_too(two_threads):
    scene = chain(3, [])
    with pytest.raises(VofemError):
        vf.simulate(scene, 0.1, method="event_driven", compiled=False)

    def broken(t):
        raise RuntimeError("no load")

    masses = scene.bodies
    with pytest.raises(VofemError, match="no load"):
        vf.simulate(
            vf.Scene(masses, [vf.PointLoad(masses[0], broken)]),
            0.1,
            dt=0.05,
            method="energy_conserving",
            compiled=False,
        )
    assert threads() == two_threads


def test_sampling_small_runs_takes_one_thread_each_time(two_threads, monkeypatch):
    """What is read after a run is computed by the same rule."""
    mass = vf.Mass(1.0, stiffness=1.0, name="m")
    result = vf.simulate(vf.Scene([mass], initial={mass: (1.0, 0.0)}), 1.0, method="event_driven", compiled=False)
    seen = []
    plain = type(result.solution).begins

    def begins(self, *given):
        seen.append(threads())
        return plain(self, *given)

    monkeypatch.setattr(type(result.solution), "begins", begins)
    result.solution.energies(np.linspace(0.0, 1.0, 5))
    assert seen
    assert all(set(found) == {1} for found in seen)
    assert threads() == two_threads


class Watched:
    """An effect without a force that looks at the threads when its scene is assembled."""

    name = "watched"

    def __init__(self, seen):
        self.seen = seen

    def points(self):
        return ()

    def compile(self, builder):
        self.seen.append(threads())

    def describe(self):
        return "looks at the threads"


def rattle(omega, seen, *, damping=0.2):
    """Return a mass on a stop, loaded where it is damped, that looks at the threads when it is assembled."""
    mass = vf.Mass(1.0, stiffness=1.0, damping=damping, name="mass")
    stop = vf.Contact(mass, gap=0.5, stiffness=2.0, side="above", acts_on="penetration", name="stop")
    loads = [vf.PointLoad(mass, vf.Sine(0.3, omega))] if damping else []
    return vf.Scene([mass], [stop, Watched(seen), *loads])


SHORT = {"periods": 2, "skip": 2, "executor": "serial"}

STUDIES = {
    "periodic": lambda seen: vf.periodic(rattle(1.0, seen)),
    "continuation": lambda seen: vf.continuation(lambda w: rattle(w, seen), 1.4, 1.45),
    "harmonic balance": lambda seen: vf.continuation(lambda w: rattle(w, seen), 1.4, 1.45, harmonics=5),
    "backbone": lambda seen: vf.backbone(rattle(1.0, seen, damping=0.0), 1, [1.0]),
    "frequency_response": lambda seen: vf.frequency_response(rattle(1.0, seen), [0.1]),
    "lyapunov": lambda seen: vf.lyapunov(rattle(1.0, seen), 20.0),
    "bifurcation_diagram": lambda seen: vf.bifurcation_diagram(lambda w: rattle(w, seen), [1.0], **SHORT),
    "basins": lambda seen: vf.basins(rattle(1.0, seen), {"displacement": [0.0], "velocity": [0.0]}, **SHORT),
    "stability_map": lambda seen: vf.stability_map(lambda x, y: rattle(x, seen), x=[1.0], y=[0.0], executor="serial"),
}


@pytest.mark.kernels("plain")
@pytest.mark.parametrize("study", STUDIES.values(), ids=STUDIES)
def test_a_study_takes_one_thread_and_gives_the_others_back(two_threads, study):
    seen = []
    study(seen)
    assert seen
    assert all(set(found) == {1} for found in seen)
    assert threads() == two_threads


@pytest.mark.kernels("plain")
def test_what_is_computed_of_a_branch_later_takes_one_thread_too(two_threads):
    seen = []

    def build(omega):
        seen.append(threads())
        return rattle(omega, seen)

    branch = vf.continuation(build, 1.4, 1.45)
    del seen[:]
    assert branch.at(1.43)
    assert seen
    assert all(set(found) == {1} for found in seen)
    assert threads() == two_threads
