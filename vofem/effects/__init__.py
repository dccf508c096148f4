"""Effects: what acts on bodies. Each compiles itself into rows, laws and loads of the System."""

from vofem.effects.approximated import Approximated
from vofem.effects.attachments import Dashpot, PointMass, RotationalSpring, Spring
from vofem.effects.base_motion import BaseMotion
from vofem.effects.contact import Contact, Resolved
from vofem.effects.damping import ModalDamping, RayleighDamping
from vofem.effects.foundation import Foundation
from vofem.effects.loads import DistributedLoad, Gravity, PointLoad, PointMoment
from vofem.effects.nonlinear_spring import NonlinearSpring
from vofem.effects.time_functions import Constant, Pulse, Ramp, Sine, Tabulated, TimeFunction

__all__ = [
    "Approximated",
    "BaseMotion",
    "Constant",
    "Contact",
    "Dashpot",
    "DistributedLoad",
    "Foundation",
    "Gravity",
    "ModalDamping",
    "NonlinearSpring",
    "PointLoad",
    "PointMass",
    "PointMoment",
    "Pulse",
    "Ramp",
    "RayleighDamping",
    "Resolved",
    "RotationalSpring",
    "Sine",
    "Spring",
    "Tabulated",
    "TimeFunction",
]
