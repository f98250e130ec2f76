"""Metrics of a run, most of them one per joint.

They read the run's tally, so they count every sample, whatever was logged. Each is a `Metric`, which says what it is
called, its unit, and how it is computed. All take a batch of runs, too.
"""

from .effort import initial_torque as initial_torque
from .effort import max_torque_step as max_torque_step
from .effort import peak_torque as peak_torque
from .effort import steady_torque_step as steady_torque_step
from .effort import steady_torque_step_rms as steady_torque_step_rms
from .effort import torque_energy as torque_energy
from .effort import torque_travel as torque_travel
from .envelope import envelope_margin as envelope_margin
from .envelope import envelope_violations as envelope_violations
from .error import iae as iae
from .error import rms_error as rms_error
from .error import settling_time as settling_time
from .error import steady_error as steady_error
from .frames import frame as frame
from .metric import Metric as Metric
from .metric import array_of as array_of
from .metric import arrays as arrays
from .metric import metric as metric
from .names import short_names as short_names
from .promise import guarantee_margin as guarantee_margin
from .promise import warned_at as warned_at
from .summary import METRICS as METRICS
from .summary import OF_MONITORS as OF_MONITORS
from .summary import OF_TOLERANCES as OF_TOLERANCES
from .summary import OF_TOOLS as OF_TOOLS
from .summary import metrics_of as metrics_of
from .summary import summary as summary
from .tool import rms_tool_error as rms_tool_error
from .tool import rms_tool_turn as rms_tool_turn
from .tool import steady_tool_error as steady_tool_error
from .tool import steady_tool_turn as steady_tool_turn
from .tool import tool_error as tool_error
from .tool import tool_turn as tool_turn
from .tube import tolerance_margin as tolerance_margin
from .tube import tolerance_violations as tolerance_violations
