"""Reference motions: a time becomes desired positions, velocities and accelerations of the joints."""

from .constant import Constant as Constant
from .exponential_sum import ExponentialSum as ExponentialSum
from .minimum_jerk import MinimumJerk as MinimumJerk
from .sinusoid import Sinusoid as Sinusoid
from .tabulated import Tabulated as Tabulated
from .tool_motion import ToolMotion as ToolMotion
from .trajectory import AbstractTrajectory as AbstractTrajectory
from .trapezoidal import Trapezoidal as Trapezoidal
