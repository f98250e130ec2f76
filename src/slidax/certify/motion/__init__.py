"""Error bound along any motion of an identified arm, for laws with the same loop in all joints.

docs/any-motion.md derives the bound and defines the symbols.

`certified_law.py` has the assumptions on sensors and drives, such as the range of encoder noise. `loop_kernels.py`
bounds a joint's response to noise, friction and model errors. `path_suprema.py` bounds the model errors along the
motion. `fixed_point.py` combines these into a bound of the tracking error, and `drive_limits.py` into a bound of the
torque. `admission.py` decides if a motion is admitted.

Read first: `tracking_bound.py`, then `fixed_point.py`.
"""

from .joint_loop import JointLoop as JointLoop
from .parameter_region import BodyBand as BodyBand
from .parameter_region import ParameterRegion as ParameterRegion
from .tracking_bound import ArmUncertainty as ArmUncertainty
from .tracking_bound import certified_path as certified_path
from .tracking_bound import motion_bound as motion_bound
