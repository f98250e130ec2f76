"""Error bound along any motion of an identified arm, for laws with the same loop in all joints.

`certified_law.py` has the assumptions on sensors and drives, such as the range of encoder noise. `loop_kernels.py`
bounds a joint's response to noise, friction and model errors, and `path_suprema.py` the model errors along the motion.
`fixed_point.py` adds them to the bound of the error, and `drive_limits.py` to that of the torque. `admission.py`
decides on a motion.

Read first: `tracking_bound.py`, then `fixed_point.py`.
"""

from .joint_loop import JointLoop as JointLoop
from .parameter_region import BodyBand as BodyBand
from .parameter_region import ParameterRegion as ParameterRegion
from .tracking_bound import ArmUncertainty as ArmUncertainty
from .tracking_bound import certified_path as certified_path
from .tracking_bound import motion_bound as motion_bound
