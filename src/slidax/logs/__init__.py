"""Logs as MCAP files, which Foxglove, PlotJuggler and ROS 2 open: messages, channels, written and read."""

from .bag import read_bag as read_bag
from .channels import Channels as Channels
from .channels import flags as flags
from .joint_states import JointStates as JointStates
from .joint_states import read_joint_states as read_joint_states
from .message import Field as Field
from .message import Message as Message
from .message import joint_state as joint_state
from .needed import require_writer as require_writer
from .reader import SavedLog as SavedLog
from .reader import read_mcap as read_mcap
from .writer import LogWriter as LogWriter
