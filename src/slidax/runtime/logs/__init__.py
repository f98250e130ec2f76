"""Logs of runs and robots as MCAP files, which Foxglove, PlotJuggler and ROS 2 open, and joint states from ROS 2 bags.

Read `messages` for the content of a log, `mcap_files` for writing and reading it, `ros_bags` for recordings by
other tools.
"""

from .mcap_files import LogWriter as LogWriter
from .mcap_files import SavedLog as SavedLog
from .mcap_files import read_mcap as read_mcap
from .mcap_files import require_writer as require_writer
from .messages import Channels as Channels
from .messages import Message as Message
from .messages import MessageField as MessageField
from .messages import joint_state as joint_state
from .messages import names_of_bits as names_of_bits
from .ros_bags import JointStates as JointStates
from .ros_bags import read_bag as read_bag
from .ros_bags import read_joint_states as read_joint_states
