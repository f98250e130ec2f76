"""Robot programs around the exported step: reference from the measured posture, checks, and stops."""

from .allowed import Allowed as Allowed
from .gravity import weight_by_robot as weight_by_robot
from .reasons import REASONS as REASONS
from .write import write_law as write_law
from .write import write_onboard as write_onboard
