"""The causes, one in each file; what they find is weighed against each other, so that their order says nothing."""

from .contact import Contact as Contact
from .delay import Delay as Delay
from .encoder import Encoder as Encoder
from .estimator import Estimator as Estimator
from .inertia import Inertia as Inertia
from .payload import Payload as Payload
from .period import Period as Period
from .robust_torque import RobustTorque as RobustTorque
from .substeps import Substeps as Substeps
from .torque import Torque as Torque
from .torque_rate import TorqueRate as TorqueRate
