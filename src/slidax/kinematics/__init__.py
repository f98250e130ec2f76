"""From what a tool should do to what the joints should: inverse kinematics, and paths of a tool."""

from .follow import Followed as Followed
from .follow import follow as follow
from .inverse import Solution as Solution
from .inverse import inverse as inverse
from .moves import AbstractMove as AbstractMove
from .moves import Circle as Circle
from .moves import Line as Line
from .moves import Pause as Pause
from .moves import Screw as Screw
from .pose import Pose as Pose
from .through import Through as Through
