"""Robot arms: inertia, bias and tip. One class serves as the true robot and as the nominal one that a law knows.

The ready arms are functions without arguments, one for each file in `ready`: `slidax.robots.panda()`.
"""

import sys
from collections.abc import Callable

from . import ready as ready
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
from .robot import AbstractRobot as AbstractRobot
from .scara import Scara as Scara
from .two_link import TwoLink as TwoLink


def __getattr__(name: str) -> Callable[[], Articulated]:
    if name.startswith("_") or name not in ready.names():
        raise AttributeError(f"module `slidax.robots` has no `{name}`", name=name, obj=sys.modules[__name__])
    return ready.maker(name)


def __dir__() -> list[str]:
    return sorted({*globals(), *ready.names()})
