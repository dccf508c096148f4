"""vofem: finite elements for beams and masses that hit, rattle and yield.

Beams and masses hit stops, rattle in loose supports, and yield. Describe them by a
`Scene`, run it with `simulate`, and ask the `Result`. See the README for a first
scene.
"""

from typing import TYPE_CHECKING, Any

import vofem.simulate as _simulate
from vofem._version import __version__
from vofem.cards import Presenter, use_presenter
from vofem.persistence import Store, use_store

# The package of that name has taken the place of the function in it, which `__getattr__` finds: once it is imported,
# it does so no more.
globals().pop(_simulate.__name__.rpartition(".")[2])

if TYPE_CHECKING:
    import vofem.fractional as fractional
    import vofem.studies.accuracy as accuracy
    from vofem.bodies import Beam, Mass
    from vofem.effects import (
        Approximated,
        BaseMotion,
        BilinearSpring,
        Constant,
        Contact,
        CrushingStop,
        Dashpot,
        DistributedLoad,
        Foundation,
        Gravity,
        HystereticSpring,
        IwanSpring,
        Joint,
        LinearSoftening,
        ModalDamping,
        NonlinearSpring,
        PointLoad,
        PointMass,
        PointMoment,
        Pulse,
        Ramp,
        RayleighDamping,
        Resolved,
        RotationalSpring,
        Sine,
        Spring,
        Springpot,
        Tabulated,
        TimeFunction,
    )
    from vofem.errors import (
        ArgumentError,
        ConvergenceError,
        EventStormError,
        ExecutorError,
        InstabilityError,
        LimitLoadError,
        LoadError,
        MeshError,
        MethodError,
        MissingCallableError,
        MissingPackageError,
        OutputError,
        SceneFileError,
        SingularSystemError,
        StepSizeError,
        StorageError,
        VofemError,
    )
    from vofem.io.saved import load, resume
    from vofem.io.scene_file import dump_scene, load_scene
    from vofem.polynomial import Polynomial
    from vofem.result import Result
    from vofem.scene import Scene
    from vofem.simulate import explain, simulate
    from vofem.statics import Equilibrium, QuasiStatic, equilibrium, quasi_static
    from vofem.studies.diagrams import basins, bifurcation_diagram, stability_map
    from vofem.studies.steady import (
        Branch,
        PeriodicOrbit,
        SpecialPoint,
        backbone,
        continuation,
        frequency_response,
        lyapunov,
        periodic,
        poincare,
    )
    from vofem.studies.sweep.sweeping import sweep
    from vofem.vibration import Modes, modes

__all__ = [
    "Approximated",
    "ArgumentError",
    "BaseMotion",
    "Beam",
    "BilinearSpring",
    "Branch",
    "Constant",
    "Contact",
    "ConvergenceError",
    "CrushingStop",
    "Dashpot",
    "DistributedLoad",
    "Equilibrium",
    "EventStormError",
    "ExecutorError",
    "Foundation",
    "Gravity",
    "HystereticSpring",
    "InstabilityError",
    "IwanSpring",
    "Joint",
    "LimitLoadError",
    "LinearSoftening",
    "LoadError",
    "Mass",
    "MeshError",
    "MethodError",
    "MissingCallableError",
    "MissingPackageError",
    "ModalDamping",
    "Modes",
    "NonlinearSpring",
    "OutputError",
    "PeriodicOrbit",
    "PointLoad",
    "PointMass",
    "PointMoment",
    "Polynomial",
    "Pulse",
    "QuasiStatic",
    "Ramp",
    "RayleighDamping",
    "Resolved",
    "Result",
    "RotationalSpring",
    "Scene",
    "SceneFileError",
    "Sine",
    "SingularSystemError",
    "SpecialPoint",
    "Spring",
    "Springpot",
    "StepSizeError",
    "StorageError",
    "Tabulated",
    "TimeFunction",
    "VofemError",
    "__version__",
    "accuracy",
    "backbone",
    "basins",
    "bifurcation_diagram",
    "continuation",
    "dump_scene",
    "equilibrium",
    "explain",
    "fractional",
    "frequency_response",
    "load",
    "load_scene",
    "lyapunov",
    "modes",
    "periodic",
    "poincare",
    "quasi_static",
    "resume",
    "simulate",
    "stability_map",
    "sweep",
]

#: Names that are imported when first asked for, by module.
_MODULES = {
    "vofem.bodies": "Beam Mass",
    "vofem.effects": (
        "Approximated BaseMotion BilinearSpring Constant Contact CrushingStop Dashpot "
        "DistributedLoad Foundation Gravity HystereticSpring IwanSpring Joint LinearSoftening "
        "ModalDamping NonlinearSpring PointLoad PointMass PointMoment Pulse Ramp RayleighDamping "
        "Resolved RotationalSpring Sine Spring Springpot Tabulated TimeFunction"
    ),
    "vofem.errors": (
        "ArgumentError ConvergenceError EventStormError ExecutorError InstabilityError LimitLoadError LoadError "
        "MeshError MethodError MissingCallableError MissingPackageError OutputError SceneFileError SingularSystemError "
        "StepSizeError StorageError VofemError"
    ),
    "vofem.fractional": "fractional",
    "vofem.io": "io",
    "vofem.io.saved": "load resume",
    "vofem.io.scene_file": "dump_scene load_scene",
    "vofem.polynomial": "Polynomial",
    "vofem.result": "Result",
    "vofem.scene": "Scene",
    "vofem.simulate.explanation": "explain",
    "vofem.simulate.simulation": "simulate",
    "vofem.statics": "Equilibrium QuasiStatic equilibrium quasi_static",
    "vofem.studies.accuracy": "accuracy",
    "vofem.studies.diagrams": "basins bifurcation_diagram stability_map",
    "vofem.studies.steady": (
        "Branch PeriodicOrbit SpecialPoint backbone continuation frequency_response lyapunov periodic poincare"
    ),
    "vofem.studies.sweep.sweeping": "sweep",
    "vofem.vibration": "Modes modes",
}

#: The module of every name.
_LATER = {name: module for module, names in _MODULES.items() for name in names.split()}


def _store() -> Store:
    from vofem.io.storage import branch_file, checkpoint, run_file

    return Store(run_file.save, checkpoint.checkpoint_writer, branch_file.save)


use_store(_store)


def _presenter() -> Presenter:
    from vofem.io.cards import card_of

    return card_of


use_presenter(_presenter)


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'vofem' has no attribute {name!r}")
    from importlib import import_module

    module = import_module(_LATER[name])
    value = module if module.__name__.endswith(f".{name}") else getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*__all__, *_LATER, *(name for name in globals() if name.startswith("__"))})
