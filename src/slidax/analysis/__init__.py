"""Analysis of closed loops and their runs: metrics, linearisation with margins, and diagnosis.

Metrics turn a run into values per joint or per run: `metrics.py` has all of them, `metric.py` has their class.
`linearise` returns the simulated loop at a point of its run as a linear system with eigenvalues and margins. `explain`
lists the likely causes for which a run left its envelope, with evidence from its log and remedies tried in simulation.
`forecast` checks the planned motion before a run and warns of such causes.

Start with `metrics.py`, `linearise.py` and `explain.py`.
"""

from .cause import AbstractCause as AbstractCause
from .cause import Finding as Finding
from .cause import Remedy as Remedy
from .explain import CAUSES as CAUSES
from .explain import Explanation as Explanation
from .explain import explain as explain
from .explain import likeliest_cause as likeliest_cause
from .explain import read_saved as read_saved
from .forecast import forecast as forecast
from .linearise import LinearisedLoop as LinearisedLoop
from .linearise import linearise as linearise
from .metric import Metric as Metric
from .metric import array_of as array_of
from .metric import arrays as arrays
from .metric import metric as metric
from .metric import short_names as short_names
from .metrics import METRICS as METRICS
from .metrics import MONITOR_METRICS as MONITOR_METRICS
from .metrics import TOLERANCE_METRICS as TOLERANCE_METRICS
from .metrics import TOOL_METRICS as TOOL_METRICS
from .metrics import envelope_margin as envelope_margin
from .metrics import envelope_violations as envelope_violations
from .metrics import guarantee_margin as guarantee_margin
from .metrics import iae as iae
from .metrics import initial_torque as initial_torque
from .metrics import max_torque_step as max_torque_step
from .metrics import metrics_frame as metrics_frame
from .metrics import metrics_of as metrics_of
from .metrics import peak_torque as peak_torque
from .metrics import rms_error as rms_error
from .metrics import rms_tool_error as rms_tool_error
from .metrics import rms_tool_turn as rms_tool_turn
from .metrics import settling_time as settling_time
from .metrics import steady_error as steady_error
from .metrics import steady_tool_error as steady_tool_error
from .metrics import steady_tool_turn as steady_tool_turn
from .metrics import steady_torque_step as steady_torque_step
from .metrics import steady_torque_step_rms as steady_torque_step_rms
from .metrics import summary as summary
from .metrics import tolerance_margin as tolerance_margin
from .metrics import tolerance_violations as tolerance_violations
from .metrics import tool_error as tool_error
from .metrics import tool_turn as tool_turn
from .metrics import torque_energy as torque_energy
from .metrics import torque_travel as torque_travel
from .metrics import warned_at as warned_at
from .run_record import RunRecord as RunRecord
from .run_record import require_explainable as require_explainable
from .run_verdict import RunVerdict as RunVerdict
from .run_verdict import run_verdict as run_verdict
from .sampled_system import Margins as Margins
from .sampled_system import SampledSystem as SampledSystem
from .sampled_system import margins_of as margins_of
