"""Sensors: measurements of the true state that are exact, rounded, noisy, delayed or lost."""

from .delayed import Delayed as Delayed
from .differenced_encoders import DifferencedEncoders as DifferencedEncoders
from .encoders import Encoders as Encoders
from .exact import Exact as Exact
from .lossy import Lossy as Lossy
from .sensor import AbstractSensor as AbstractSensor
from .sensor import Measurement as Measurement
