"""The sampled-data form of every controller: estimator, prediction over the delay, torque limits.

`sampled_data` makes this form from a controller in printed form. Each sample passes the measurement gate, the
estimator, the prediction, a discrete-time step and the torque limits.

Read first: `controller.py`, `recipe.py`. The steps themselves are in `law/steps.py` and `law/implicit_steps.py`,
because each printed controller names its step.
"""

from .controller import SampledData as SampledData
from .gate import Admission as Admission
from .gate import GateMemory as GateMemory
from .gate import MeasurementGate as MeasurementGate
from .monitor import Monitor as Monitor
from .recipe import ExplicitStep as ExplicitStep
from .recipe import sampled_data as sampled_data
