"""Certificates of an arm with its uncertainty set: its constants, and the demand of its motion on loops and drives."""

from .constants import ArmConstants as ArmConstants
from .constants import arm_constants as arm_constants
from .demand import compute_demand as compute_demand
from .robust_torque import robust_torque as robust_torque
from .torque_budget import torque_budget as torque_budget
from .uncertainty_bound import uncertainty_bound as uncertainty_bound
