"""Certificates of laws in printed form, in continuous time or with the torque held over a period."""

from .printed_period import printed_period as printed_period
from .settling_time import settling_time as settling_time
from .travel_time import two_power_time as two_power_time
from .ultimate_bound import ultimate_bound as ultimate_bound
