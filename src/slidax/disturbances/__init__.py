"""Disturbances: external forces that the controller does not know."""

from .constant import Constant as Constant
from .disturbance import AbstractDisturbance as AbstractDisturbance
from .disturbance import Samples as Samples
from .disturbance import Scaled as Scaled
from .disturbance import Sum as Sum
from .elastic_stop import ElasticStop as ElasticStop
from .friction import Friction as Friction
from .harmonic import Harmonic as Harmonic
from .step import Step as Step
