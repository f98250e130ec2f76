"""Transformations of the tracking error, on which the surfaces act."""

from .frame import Frame as Frame
from .prescribed_performance import PrescribedPerformance as PrescribedPerformance
from .psi import Sides as Sides
from .transformation import AbstractTransformation as AbstractTransformation
from .transformation import TransformedError as TransformedError
from .unconstrained import Unconstrained as Unconstrained
