"""Robot arms: inertia, bias and tip. One class serves as the true robot and as the nominal one that a law knows."""

from . import ready as ready
from .articulated import Articulated as Articulated
from .assemble import assemble as assemble
from .files import from_mjcf as from_mjcf
from .files import from_urdf as from_urdf
from .joint import Joint as Joint
from .joint_limits import JointLimits as JointLimits
from .load import Load as Load
from .mismatch import Mismatch as Mismatch
from .payload import Payload as Payload
from .ready import gen3 as gen3
from .ready import iiwa14 as iiwa14
from .ready import panda as panda
from .ready import ur5e as ur5e
from .ready import xarm7 as xarm7
from .robot import AbstractRobot as AbstractRobot
from .scara import Scara as Scara
from .two_link import TwoLink as TwoLink
