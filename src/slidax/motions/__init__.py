"""Reference motions of the joints: closed forms, motions through waypoints, tables, tool paths, and streams.

Begin with `trajectory.py`, which has the base class. `waypoints.py` plans motions within limits, `tabulated.py` reads
them from files, and `follow.py` turns the moves of a tool (`moves.py`) into a motion of the joints. `stream.py` smooths
positions that another computer sends during the run.
"""

from .follow import ToolPath as ToolPath
from .follow import follow as follow
from .moves import AbstractMove as AbstractMove
from .moves import Circle as Circle
from .moves import Line as Line
from .moves import Pause as Pause
from .moves import Screw as Screw
from .moves import Through as Through
from .stream import Streamed as Streamed
from .stream import StreamFilter as StreamFilter
from .tabulated import Tabulated as Tabulated
from .trajectory import AbstractMotion as AbstractMotion
from .trajectory import ConstantPosture as ConstantPosture
from .trajectory import ExponentialSum as ExponentialSum
from .trajectory import Sinusoid as Sinusoid
from .trajectory import ToolMotion as ToolMotion
from .waypoints import MinimumJerk as MinimumJerk
from .waypoints import Trapezoidal as Trapezoidal
