"""From the tracking error to the transformed error that a surface is built on."""

from .frame import Frame as Frame
from .prescribed_performance import PrescribedPerformance as PrescribedPerformance
from .psi import Sides as Sides
from .transformation import AbstractTransformation as AbstractTransformation
from .transformation import TransformedError as TransformedError
from .unconstrained import Unconstrained as Unconstrained
