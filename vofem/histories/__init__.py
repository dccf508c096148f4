"""What a scene and single parts of it did along a run."""

from vofem.histories.contact import ContactHistory as ContactHistory
from vofem.histories.friction import FrictionHistory as FrictionHistory
from vofem.histories.impacts import ContactStatistics as ContactStatistics
from vofem.histories.impacts import Impacts as Impacts
from vofem.histories.motion import Motion as Motion
from vofem.histories.run import Energy as Energy
from vofem.histories.run import ProbeHistory as ProbeHistory
from vofem.histories.run import Reaction as Reaction
from vofem.histories.run import Run as Run
from vofem.histories.spring import SpringHistory as SpringHistory
from vofem.histories.table import Table as Table
