"""Linear models as records: second-order systems with internal states, controllers, closed loops, periodic systems.

One sign convention for the whole package: matrices stand on the left-hand side, so positive stiffness restores
and positive damping dissipates; forces from internal states, actuators and the guideway stand on the right.
"""

from maglev_ctrl.systems.feedback import Controller, close_loop, loop_matrices
from maglev_ctrl.systems.periodic import PeriodicSystem, at_depth, modulate
from maglev_ctrl.systems.second_order import Contribution, SecondOrderSystem

__all__ = [
    "Contribution",
    "Controller",
    "PeriodicSystem",
    "SecondOrderSystem",
    "at_depth",
    "close_loop",
    "loop_matrices",
    "modulate",
]
