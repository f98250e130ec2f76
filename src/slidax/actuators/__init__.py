"""What is delivered of the torque that is commanded: limited in size and rate, late, and through a lag."""

from .actuator import Actuator as Actuator
from .torque_limits import TorqueLimits as TorqueLimits
