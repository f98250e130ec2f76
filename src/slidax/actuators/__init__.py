"""Actuators: torque and torque-rate limits, delay, and lag."""

from .actuator import Actuator as Actuator
from .torque_limits import TorqueLimits as TorqueLimits
