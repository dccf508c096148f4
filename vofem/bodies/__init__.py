"""Bodies: things with mass, and the points by which they are touched."""

from vofem._validate import public
from vofem.bodies.base import Body, BodyMatrices, Point, Row, as_point
from vofem.bodies.beam import Beam, BeamPoint
from vofem.bodies.mass import Mass

__all__ = ["Beam", "BeamPoint", "Body", "BodyMatrices", "Mass", "Point", "Row", "as_point"]

public(Beam, Mass)
