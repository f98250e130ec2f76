"""What the joints should do: a time becomes a desired position, velocity and acceleration."""

from .constant import Constant as Constant
from .exponential_sum import ExponentialSum as ExponentialSum
from .minimum_jerk import MinimumJerk as MinimumJerk
from .sinusoid import Sinusoid as Sinusoid
from .tabulated import Tabulated as Tabulated
from .tool_motion import ToolMotion as ToolMotion
from .trajectory import AbstractTrajectory as AbstractTrajectory
from .trapezoidal import Trapezoidal as Trapezoidal
