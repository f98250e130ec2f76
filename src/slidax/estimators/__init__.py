"""From what is measured to the state that a law uses, and to the push that its model does not explain."""

from .estimator import AbstractEstimator as AbstractEstimator
from .estimator import Estimate as Estimate
from .filtered_difference import FilteredDifference as FilteredDifference
from .kalman import Kalman as Kalman
from .measured import Measured as Measured
from .robust_differentiator import RobustDifferentiator as RobustDifferentiator
