"""Certificates of an arm with its uncertainty set: stability for each inertia, robust torque, and torque limits.

`members.py` has the true arms of a set. `inertia_bounds.py` bounds inertia and gravity torque in every posture.
`demand.py` bounds the disturbances that the joints' loops must compensate along the motion. `inertia_ratio.py`,
`torque_budget.py` and `robust_torque.py` are the certificates.

Read first: `arm_motion.py`, `members.py`, `demand.py`.
"""

from .demand import compute_demand as compute_demand
from .inertia_bounds import ArmConstants as ArmConstants
from .inertia_bounds import arm_constants as arm_constants
from .inertia_ratio import inertia_ratio as inertia_ratio
from .robust_torque import robust_torque as robust_torque
from .robust_torque import uncertainty_bound as uncertainty_bound
from .torque_budget import torque_budget as torque_budget
