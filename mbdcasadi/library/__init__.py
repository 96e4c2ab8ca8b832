"""Ready mechanisms of the textbooks: one call each, with their inputs and natural coordinates.

>>> import mbdcasadi as mbd
>>> engine = mbd.library.slider_crank(crank=0.05, rod=0.15)
>>> run = mbd.kinematics(engine.driven(crank=20 * mbd.t), [0.0, 0.1, 0.2])
"""

from .free_linkages import free_linkage
from .jansen import jansen
from .linkages import five_bar, four_bar, slider_crank
from .machines import cam_follower, planetary_gear
from .model import Model
from .pendulums import pendulum_chain
from .six_bars import stephenson, watt
from .yokes import quick_return, scotch_yoke

__all__ = [
    "Model",
    "cam_follower",
    "five_bar",
    "four_bar",
    "free_linkage",
    "jansen",
    "pendulum_chain",
    "planetary_gear",
    "quick_return",
    "scotch_yoke",
    "slider_crank",
    "stephenson",
    "watt",
]
