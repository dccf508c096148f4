"""Bodies: things with mass, and the points by which they are touched."""

from vofem.bodies.base import Body, BodyMatrices, DegreesOfFreedom, Point, Row, Shape, as_point
from vofem.bodies.beam import Beam
from vofem.bodies.mass import Mass
from vofem.bodies.path import Path, TravellingPoint

__all__ = [
    "Beam",
    "Body",
    "BodyMatrices",
    "DegreesOfFreedom",
    "Mass",
    "Path",
    "Point",
    "Row",
    "Shape",
    "TravellingPoint",
    "as_point",
]
