"""Sampled-data form of every law: estimator, prediction over the delay, and torque limits."""

from .explicit_step import ExplicitStep as ExplicitStep
from .gate import Admission as Admission
from .gate import GateMemory as GateMemory
from .gate import MeasurementGate as MeasurementGate
from .law import SampledData as SampledData
from .monitor import Monitor as Monitor
from .recipe import sampled_data as sampled_data
