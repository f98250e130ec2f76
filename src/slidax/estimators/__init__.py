"""Estimators of the state, and of the acceleration that the nominal model does not explain."""

from .estimator import AbstractEstimator as AbstractEstimator
from .estimator import Estimate as Estimate
from .filtered_difference import FilteredDifference as FilteredDifference
from .kalman import Kalman as Kalman
from .measured import Measured as Measured
from .robust_differentiator import RobustDifferentiator as RobustDifferentiator
