"""Bodies: things with mass, and the points by which they are touched."""

from vofem.bodies.base import BaseBody, Body, BodyMatrices, DegreesOfFreedom, Point, Row, Shape, as_point
from vofem.bodies.beam import Beam, BeamPoint
from vofem.bodies.mass import Mass

__all__ = [
    "BaseBody",
    "Beam",
    "BeamPoint",
    "Body",
    "BodyMatrices",
    "DegreesOfFreedom",
    "Mass",
    "Point",
    "Row",
    "Shape",
    "as_point",
]
