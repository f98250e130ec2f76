"""Robot arms: inertia, bias forces and tip. One class is both the true arm and the nominal one that a law knows.

The built-in arms are functions without arguments, such as `slidax.robots.panda()`.
"""

from .articulated import Articulated as Articulated
from .assemble import assemble as assemble
from .coupled import Coupled as Coupled
from .coupled import couple as couple
from .files import from_mjcf as from_mjcf
from .files import from_urdf as from_urdf
from .joint import Joint as Joint
from .joint_limits import JointLimits as JointLimits
from .load import Load as Load
from .mismatch import Mismatch as Mismatch
from .payload import Payload as Payload
from .ready.read import BuiltInArm as BuiltInArm
from .ready.read import built_in_arm as built_in_arm
from .ready.read import built_in_names as built_in_names
from .ready.read import built_in_title as built_in_title
from .ready.read import gen3 as gen3
from .ready.read import iiwa14 as iiwa14
from .ready.read import panda as panda
from .ready.read import ur5e as ur5e
from .ready.read import xarm7 as xarm7
from .robot import AbstractRobot as AbstractRobot
from .scara import Scara as Scara
from .two_link import TwoLink as TwoLink
