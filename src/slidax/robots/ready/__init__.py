"""Arms that need no file: the numbers of their makers and of published identifications, each with its source."""

from ..articulated import Articulated
from .read import NAMES as NAMES
from .read import Ready as Ready
from .read import read as read
from .read import title as title


def panda() -> Articulated:
    """Franka Emika Panda, seven joints, to the flange."""
    return read("panda").robot


def ur5e() -> Articulated:
    """Universal Robots UR5e, six joints, to the flange."""
    return read("ur5e").robot


def iiwa14() -> Articulated:
    """KUKA LBR iiwa 14 R820, seven joints, to the flange."""
    return read("iiwa14").robot


def xarm7() -> Articulated:
    """UFactory xArm7, seven joints, to the flange."""
    return read("xarm7").robot


def gen3() -> Articulated:
    """Kinova Gen3 with seven joints, to the flange."""
    return read("gen3").robot
