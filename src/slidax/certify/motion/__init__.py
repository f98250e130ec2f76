"""Error bound along any motion of an identified arm, for computed torque with the same loop in all joints.

Read first: `tracking_bound.py`, then `fixed_point.py`.
"""

from .loop_kernels import JointLoop as JointLoop
from .path_suprema import Band as Band
from .tracking_bound import ArmUncertainty as ArmUncertainty
from .tracking_bound import tracking_bound as tracking_bound
