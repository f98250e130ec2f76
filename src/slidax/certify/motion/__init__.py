"""Error bound along any motion of an identified arm, for laws with the same loop in all joints.

Read first: `tracking_bound.py`, then `fixed_point.py`.
"""

from .joint_loop import JointLoop as JointLoop
from .parameter_region import BodyBand as BodyBand
from .parameter_region import ParameterRegion as ParameterRegion
from .tracking_bound import ArmUncertainty as ArmUncertainty
from .tracking_bound import certified_path as certified_path
from .tracking_bound import motion_bound as motion_bound
