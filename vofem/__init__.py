"""vofem: finite elements for beams and masses that hit, rattle and yield.

One equation with evolving stiffness describes contact: a variable-order
Riemann-Liouville operator, applied to the constant K0, switches between 0 and
K0 as a gap function changes sign. See the README for a first scene.
"""

from typing import TYPE_CHECKING, Any

from vofem import fractional
from vofem._version import __version__
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
    InstabilityError,
    LimitLoadError,
    LoadError,
    MeshError,
    MethodError,
    MissingCallableError,
    OutputError,
    SceneFileError,
    SingularSystemError,
    StepSizeError,
    StorageError,
    VofemError,
)
from vofem.modes import Modes, modes
from vofem.polynomial import Polynomial
from vofem.result import Result
from vofem.scene import Scene
from vofem.simulate import explain, simulate
from vofem.statics import Equilibrium, QuasiStatic, equilibrium, quasi_static

if TYPE_CHECKING:
    import vofem.studies.accuracy as accuracy
    from vofem.io.saved import load, resume
    from vofem.io.scene_file import dump_scene, load_scene
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
]

#: What is imported when first asked for.
_LATER = {
    "Branch": "vofem.studies.steady",
    "PeriodicOrbit": "vofem.studies.steady",
    "SpecialPoint": "vofem.studies.steady",
    "accuracy": "vofem.studies.accuracy",
    "backbone": "vofem.studies.steady",
    "continuation": "vofem.studies.steady",
    "dump_scene": "vofem.io.scene_file",
    "frequency_response": "vofem.studies.steady",
    "io": "vofem.io",
    "load": "vofem.io.saved",
    "load_scene": "vofem.io.scene_file",
    "lyapunov": "vofem.studies.steady",
    "periodic": "vofem.studies.steady",
    "poincare": "vofem.studies.steady",
    "resume": "vofem.io.saved",
}


def __getattr__(name: str) -> Any:
    if name not in _LATER:
        raise AttributeError(f"module 'vofem' has no attribute {name!r}")
    from importlib import import_module

    module = import_module(_LATER[name])
    return module if module.__name__.endswith(f".{name}") else getattr(module, name)


def __dir__() -> list[str]:
    return sorted({*__all__, *_LATER, *(name for name in globals() if name.startswith("__"))})
