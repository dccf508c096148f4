"""vofem: finite elements for beams and masses that hit, rattle and yield.

Beams and masses hit stops, rattle in loose supports, and yield. Describe them by a
`Scene`, run it with `simulate`, and ask the `Result`. See the README for a first
scene.
"""

from typing import TYPE_CHECKING, Any

import vofem.simulate as _simulate
from vofem._version import __version__ as __version__
from vofem.persistence import Store, use_store

# The package of that name has taken the place of the function in it, which `__getattr__` finds: once it is imported,
# it does so no more.
globals().pop(_simulate.__name__.rpartition(".")[2])

# The names, for those who read this module without running it: editors and type checkers.
if TYPE_CHECKING:
    from vofem import fractional as fractional
    from vofem.bodies import Beam as Beam
    from vofem.bodies import Mass as Mass
    from vofem.effects import Approximated as Approximated
    from vofem.effects import BaseMotion as BaseMotion
    from vofem.effects import BilinearSpring as BilinearSpring
    from vofem.effects import Constant as Constant
    from vofem.effects import Contact as Contact
    from vofem.effects import CrushingStop as CrushingStop
    from vofem.effects import Dashpot as Dashpot
    from vofem.effects import DistributedLoad as DistributedLoad
    from vofem.effects import Foundation as Foundation
    from vofem.effects import Gravity as Gravity
    from vofem.effects import HystereticSpring as HystereticSpring
    from vofem.effects import IwanSpring as IwanSpring
    from vofem.effects import Joint as Joint
    from vofem.effects import LinearSoftening as LinearSoftening
    from vofem.effects import ModalDamping as ModalDamping
    from vofem.effects import NonlinearSpring as NonlinearSpring
    from vofem.effects import PointLoad as PointLoad
    from vofem.effects import PointMass as PointMass
    from vofem.effects import PointMoment as PointMoment
    from vofem.effects import Pulse as Pulse
    from vofem.effects import Ramp as Ramp
    from vofem.effects import RayleighDamping as RayleighDamping
    from vofem.effects import Resolved as Resolved
    from vofem.effects import RotationalSpring as RotationalSpring
    from vofem.effects import Sine as Sine
    from vofem.effects import Spring as Spring
    from vofem.effects import Springpot as Springpot
    from vofem.effects import Tabulated as Tabulated
    from vofem.effects import TimeFunction as TimeFunction
    from vofem.errors import ArgumentError as ArgumentError
    from vofem.errors import ConvergenceError as ConvergenceError
    from vofem.errors import EventStormError as EventStormError
    from vofem.errors import ExecutorError as ExecutorError
    from vofem.errors import InstabilityError as InstabilityError
    from vofem.errors import LimitLoadError as LimitLoadError
    from vofem.errors import LoadError as LoadError
    from vofem.errors import MeshError as MeshError
    from vofem.errors import MethodError as MethodError
    from vofem.errors import MissingCallableError as MissingCallableError
    from vofem.errors import MissingPackageError as MissingPackageError
    from vofem.errors import OutputError as OutputError
    from vofem.errors import SceneFileError as SceneFileError
    from vofem.errors import SingularSystemError as SingularSystemError
    from vofem.errors import StepSizeError as StepSizeError
    from vofem.errors import StorageError as StorageError
    from vofem.errors import VofemError as VofemError
    from vofem.io.saved import load as load
    from vofem.io.saved import resume as resume
    from vofem.io.scene_file import dump_scene as dump_scene
    from vofem.io.scene_file import load_scene as load_scene
    from vofem.polynomial import Polynomial as Polynomial
    from vofem.result import Result as Result
    from vofem.scene import Scene as Scene
    from vofem.simulate import explain as explain
    from vofem.simulate import simulate as simulate
    from vofem.statics import Equilibrium as Equilibrium
    from vofem.statics import QuasiStatic as QuasiStatic
    from vofem.statics import equilibrium as equilibrium
    from vofem.statics import quasi_static as quasi_static
    from vofem.studies import accuracy as accuracy
    from vofem.studies.diagrams import basins as basins
    from vofem.studies.diagrams import bifurcation_diagram as bifurcation_diagram
    from vofem.studies.diagrams import stability_map as stability_map
    from vofem.studies.steady import Branch as Branch
    from vofem.studies.steady import PeriodicOrbit as PeriodicOrbit
    from vofem.studies.steady import SpecialPoint as SpecialPoint
    from vofem.studies.steady import backbone as backbone
    from vofem.studies.steady import continuation as continuation
    from vofem.studies.steady import frequency_response as frequency_response
    from vofem.studies.steady import lyapunov as lyapunov
    from vofem.studies.steady import periodic as periodic
    from vofem.studies.steady import poincare as poincare
    from vofem.studies.sweep.sweeping import sweep as sweep
    from vofem.vibration import Modes as Modes
    from vofem.vibration import modes as modes

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

__all__ = sorted({*_LATER, "__version__"} - {"io"})


def _store() -> Store:
    from vofem.io.storage import branch_file, checkpoint, run_file

    return Store(run_file.save, checkpoint.checkpoint_writer, branch_file.save)


use_store(_store)


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
