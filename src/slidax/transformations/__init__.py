"""From the tracking error to the transformed error that a surface is built on."""

from .prescribed_performance import PrescribedPerformance as PrescribedPerformance
from .prescribed_performance import Sides as Sides
from .transformation import AbstractTransformation as AbstractTransformation
from .transformation import TransformedError as TransformedError
from .unconstrained import Unconstrained as Unconstrained
