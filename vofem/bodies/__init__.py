"""Bodies: things with mass, and the points by which they are touched."""

from vofem.bodies.base import Body, BodyMatrices, DegreesOfFreedom, Point, Row, Shape, as_point
from vofem.bodies.beam import Beam
from vofem.bodies.mass import Mass

__all__ = [
    "Beam",
    "Body",
    "BodyMatrices",
    "DegreesOfFreedom",
    "Mass",
    "Point",
    "Row",
    "Shape",
    "as_point",
]
