"""From measured positions and torques to an arm's numbers, and the motion that shows them best."""

from .identification import Estimated as Estimated
from .identification import Identification as Identification
from .identify import identify as identify
from .log import Log as Log
from .read_log import read_log as read_log
