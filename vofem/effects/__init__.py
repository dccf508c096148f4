"""Effects, which act on bodies. Each effect adds its rows, laws and loads to the System."""

from vofem._validate import public
from vofem.effects.attachments import Dashpot, PointMass, RotationalSpring, Spring
from vofem.effects.base_motion import BaseMotion
from vofem.effects.contact import Contact, Resolved
from vofem.effects.damping import ModalDamping, RayleighDamping
from vofem.effects.foundation import Foundation
from vofem.effects.hysteretic_spring import CrushingStop, HystereticSpring
from vofem.effects.jenkins import BilinearSpring, IwanSpring
from vofem.effects.joint import Joint
from vofem.effects.loads import DistributedLoad, Gravity, PointLoad, PointMoment
from vofem.effects.nonlinear_spring import NonlinearSpring
from vofem.effects.softening import LinearSoftening
from vofem.effects.springpot import Springpot
from vofem.time_functions import Constant, Pulse, Ramp, Sine, Tabulated, TimeFunction
from vofem.time_functions.approximated import Approximated

__all__ = [
    "Approximated",
    "BaseMotion",
    "BilinearSpring",
    "Constant",
    "Contact",
    "CrushingStop",
    "Dashpot",
    "DistributedLoad",
    "Foundation",
    "Gravity",
    "HystereticSpring",
    "IwanSpring",
    "Joint",
    "LinearSoftening",
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
    "Springpot",
    "Tabulated",
    "TimeFunction",
]

public(Approximated)
