"""From a run to numbers, one per joint. They read the run's tally, so they count every sample, whatever was logged."""

from .effort import aice as aice
from .effort import eci as eci
from .effort import initial_torque as initial_torque
from .effort import max_torque_step as max_torque_step
from .effort import peak_torque as peak_torque
from .effort import steady_torque_step as steady_torque_step
from .effort import steady_torque_step_rms as steady_torque_step_rms
from .envelope import envelope_margin as envelope_margin
from .envelope import envelope_violations as envelope_violations
from .error import iae as iae
from .error import settling_time as settling_time
from .error import steady_error as steady_error
from .summary import summary as summary
