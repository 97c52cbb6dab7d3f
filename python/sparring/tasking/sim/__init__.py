"""Models of the simulation: `world`, and `dyn` and `fsw` of each satellite.

The simulation itself is compiled. These classes name its models, hold their arguments and give
access to its state.
"""

from . import dyn as dyn
from . import fsw as fsw
from . import world as world
from .simulator import Simulator

__all__ = ["Simulator"]
