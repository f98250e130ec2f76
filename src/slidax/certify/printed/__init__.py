"""Certificates of laws in the form that the paper prints, in continuous time or with the torque held over a period.

The paper is Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w. Numbers in brackets are its equations.

Read first: `printed_law.py`, `settling_time.py`.
"""

from .settling_time import settling_time as settling_time
from .settling_time import two_power_time as two_power_time
from .ultimate_bound import printed_period as printed_period
from .ultimate_bound import ultimate_bound as ultimate_bound
