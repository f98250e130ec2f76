"""From measured positions and torques to an arm's numbers, and the motion that shows them best."""

from .arm_file import arm_as_yaml as arm_as_yaml
from .arm_file import write_arm as write_arm
from .conventions import Conventions as Conventions
from .excitation import Excitation as Excitation
from .excite import excite as excite
from .identification import Estimated as Estimated
from .identification import Identification as Identification
from .identify import identify as identify
from .log import Log as Log
from .read_log import read_log as read_log
from .reading import parse_columns as parse_columns
