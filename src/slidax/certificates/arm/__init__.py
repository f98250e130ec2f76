"""What is certified of an arm and its set: constants, what its motion asks of the loops, and of the drives."""

from .constants import ArmConstants as ArmConstants
from .constants import arm_constants as arm_constants
from .demand import demand as demand
