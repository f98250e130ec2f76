"""Robot arms: inertia matrix, bias forces, friction, tip, and inverse kinematics.

The true arm and the nominal arm of a control law have the same class. Begin with `arm.py`, the base class, and
`articulated.py`, the class of nearly all arms. `files` reads URDF and MJCF, `assemble.py` builds an arm from joints,
and `built_in.py` has the built-in arms as functions, such as `slidax.arms.panda()`. `mismatch.py` derives the true arm
from the nominal one. `chain.py` and `inverse.py` have the kinematics of the tool.
"""

from .arm import AbstractRobot as AbstractRobot
from .arm import JointLimits as JointLimits
from .arm import Payload as Payload
from .articulated import Articulated as Articulated
from .assemble import assemble as assemble
from .built_in import BuiltInArm as BuiltInArm
from .built_in import built_in_arm as built_in_arm
from .built_in import built_in_names as built_in_names
from .built_in import built_in_title as built_in_title
from .built_in import gen3 as gen3
from .built_in import iiwa14 as iiwa14
from .built_in import panda as panda
from .built_in import ur5e as ur5e
from .built_in import xarm7 as xarm7
from .chain import Pose as Pose
from .coupled import Coupled as Coupled
from .coupled import couple as couple
from .files.mjcf import from_mjcf as from_mjcf
from .files.urdf import from_urdf as from_urdf
from .inverse import InverseSolution as InverseSolution
from .inverse import inverse as inverse
from .joint import Joint as Joint
from .mismatch import Mismatch as Mismatch
from .mismatch import TimedPayload as TimedPayload
from .paper_arms import Scara as Scara
from .paper_arms import TwoLink as TwoLink
