"""What a scene and single parts of it did along a run."""

from vofem.histories.contact import ContactHistory
from vofem.histories.energy import Energy
from vofem.histories.friction import FrictionHistory
from vofem.histories.impacts import ContactStatistics, Impacts
from vofem.histories.motion import Motion
from vofem.histories.probe import ProbeHistory
from vofem.histories.reaction import Reaction, joint_force_of, reaction_of
from vofem.histories.spring import SpringHistory
from vofem.histories.table import Table

__all__ = [
    "ContactHistory",
    "ContactStatistics",
    "Energy",
    "FrictionHistory",
    "Impacts",
    "Motion",
    "ProbeHistory",
    "Reaction",
    "SpringHistory",
    "Table",
    "joint_force_of",
    "reaction_of",
]
