"""vofem: finite elements for beams and masses that hit, rattle and yield.

One equation with evolving stiffness describes contact: a variable-order
Riemann-Liouville operator, applied to the constant K0, switches between 0 and
K0 as a gap function changes sign. See the README for a first scene.
"""

from vofem import fractional
from vofem.bodies import Beam, Mass
from vofem.effects import (
    Constant,
    Contact,
    Dashpot,
    DistributedLoad,
    Gravity,
    ModalDamping,
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
    Tabulated,
    TimeFunction,
)
from vofem.errors import (
    ArgumentError,
    ConvergenceError,
    EventStormError,
    InstabilityError,
    LoadError,
    MeshError,
    MethodError,
    OutputError,
    SingularSystemError,
    StepSizeError,
    VofemError,
)
from vofem.modes import Modes, modes
from vofem.result import Result
from vofem.scene import Scene
from vofem.simulate import explain, simulate
from vofem.statics import Equilibrium, equilibrium

__version__ = "0.1.0"

__all__ = [
    "ArgumentError",
    "Beam",
    "Constant",
    "Contact",
    "ConvergenceError",
    "Dashpot",
    "DistributedLoad",
    "Equilibrium",
    "EventStormError",
    "Gravity",
    "InstabilityError",
    "LoadError",
    "Mass",
    "MeshError",
    "MethodError",
    "ModalDamping",
    "Modes",
    "OutputError",
    "PointLoad",
    "PointMass",
    "PointMoment",
    "Pulse",
    "Ramp",
    "RayleighDamping",
    "Resolved",
    "Result",
    "RotationalSpring",
    "Scene",
    "Sine",
    "SingularSystemError",
    "Spring",
    "StepSizeError",
    "Tabulated",
    "TimeFunction",
    "VofemError",
    "equilibrium",
    "explain",
    "fractional",
    "modes",
    "simulate",
]
