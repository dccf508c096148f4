"""Effects, which act on bodies. Each effect adds its rows, laws and loads to the System."""

from vofem._validate import public
from vofem.effects.attachments import Dashpot as Dashpot
from vofem.effects.attachments import Joint as Joint
from vofem.effects.attachments import ModalDamping as ModalDamping
from vofem.effects.attachments import PointMass as PointMass
from vofem.effects.attachments import RayleighDamping as RayleighDamping
from vofem.effects.attachments import RotationalSpring as RotationalSpring
from vofem.effects.attachments import Spring as Spring
from vofem.effects.contact import Contact as Contact
from vofem.effects.contact import Resolved as Resolved
from vofem.effects.contact import RigidStop as RigidStop
from vofem.effects.foundation import Foundation as Foundation
from vofem.effects.friction import Friction as Friction
from vofem.effects.hysteretic_spring import BilinearSpring as BilinearSpring
from vofem.effects.hysteretic_spring import CrushingStop as CrushingStop
from vofem.effects.hysteretic_spring import HystereticSpring as HystereticSpring
from vofem.effects.hysteretic_spring import IwanSpring as IwanSpring
from vofem.effects.hysteretic_spring import LinearSoftening as LinearSoftening
from vofem.effects.loads import BaseMotion as BaseMotion
from vofem.effects.loads import DistributedLoad as DistributedLoad
from vofem.effects.loads import Gravity as Gravity
from vofem.effects.loads import PointLoad as PointLoad
from vofem.effects.loads import PointMoment as PointMoment
from vofem.effects.nonlinear_spring import NonlinearSpring as NonlinearSpring
from vofem.effects.springpot import Springpot as Springpot
from vofem.time_functions import Constant as Constant
from vofem.time_functions import Pulse as Pulse
from vofem.time_functions import Ramp as Ramp
from vofem.time_functions import Sine as Sine
from vofem.time_functions import Tabulated as Tabulated
from vofem.time_functions import TimeFunction as TimeFunction
from vofem.time_functions.approximated import Approximated as Approximated

#: All that is imported above: a new effect is one line there.
__all__ = [name for name, made in list(globals().items()) if isinstance(made, type)]

public(Approximated)
