"""How a commanded torque is delivered: limited in size and rate, late, and through a lag."""

from .actuator import Actuator as Actuator
from .torque_limits import TorqueLimits as TorqueLimits
