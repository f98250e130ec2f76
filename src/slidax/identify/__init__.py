"""Identification of an arm from logs of positions and torques, and the motion that excites its parameters.

`identify` reads a log, checks it against the arm, and fits rotor inertias, friction, payload and links by weighted
least squares. `excite` designs the motion to record, and `write_arm` saves the result for `robot: {kind: identified}`.

Start with `identify.py`, which lists the steps in order. `log_files.py` reads files, `log_checks.py` and `checks.py`
reject or repair bad logs, `regressor.py` and `regression.py` hold the mathematics.
"""

from .arm_file import arm_as_yaml as arm_as_yaml
from .arm_file import write_arm as write_arm
from .band import Band as Band
from .excitation import Excitation as Excitation
from .excitation import excite as excite
from .identified_arm import EstimatedParameter as EstimatedParameter
from .identified_arm import Identification as Identification
from .identified_arm import LogFit as LogFit
from .identify import identify as identify
from .log_files import read_log as read_log
from .logs import Conventions as Conventions
from .logs import JointLog as JointLog
from .logs import parse_columns as parse_columns
from .payload_files import payload_text as payload_text
from .payload_files import require_payload_form as require_payload_form
from .records import parse_load as parse_load
