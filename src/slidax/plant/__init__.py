"""Sensors, actuators and disturbances: everything that surrounds the arm in a simulation.

A sensor turns a sample of the true state into a measurement. An actuator turns a commanded torque into the torque at
the joint. Disturbances are torques that no controller knows; they can be added and scaled. A transmission adds LuGre
friction and elastic joints to an arm, with their own states.

Read first: `sensors.py`, `actuators.py`, `disturbances.py`, `transmissions.py`.
"""

from .actuators import Actuator as Actuator
from .actuators import ActuatorMap as ActuatorMap
from .actuators import TorqueLimits as TorqueLimits
from .disturbances import AbstractDisturbance as AbstractDisturbance
from .disturbances import Constant as Constant
from .disturbances import ElasticStop as ElasticStop
from .disturbances import Friction as Friction
from .disturbances import Harmonic as Harmonic
from .disturbances import Ripple as Ripple
from .disturbances import Samples as Samples
from .disturbances import Scaled as Scaled
from .disturbances import Step as Step
from .disturbances import Stribeck as Stribeck
from .disturbances import Sum as Sum
from .sensors import AbstractSensor as AbstractSensor
from .sensors import Delayed as Delayed
from .sensors import DifferencedEncoders as DifferencedEncoders
from .sensors import Encoders as Encoders
from .sensors import Exact as Exact
from .sensors import Lossy as Lossy
from .sensors import Measurement as Measurement
from .timing import TRACES as TRACES
from .transmissions import Elasticity as Elasticity
from .transmissions import LuGre as LuGre
from .transmissions import Transmission as Transmission
from .transmissions import TransmissionState as TransmissionState
