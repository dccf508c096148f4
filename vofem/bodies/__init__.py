"""Bodies: things with mass, and the points by which they are touched."""

from vofem.bodies.base import Body as Body
from vofem.bodies.base import BodyMatrices as BodyMatrices
from vofem.bodies.base import DegreesOfFreedom as DegreesOfFreedom
from vofem.bodies.base import Point as Point
from vofem.bodies.base import Row as Row
from vofem.bodies.base import Shape as Shape
from vofem.bodies.base import as_point as as_point
from vofem.bodies.beam import Beam as Beam
from vofem.bodies.mass import Mass as Mass
from vofem.bodies.path import Path as Path
from vofem.bodies.path import TravellingPoint as TravellingPoint
