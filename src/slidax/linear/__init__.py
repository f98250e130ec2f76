"""The sampled closed loop near a point of its motion, as a linear system: eigenvalues, margins, Bode, step response.

The linearised system is the simulated one: law, estimator, delay, drives and the arm between two samples.
"""

from .linearise import Linear as Linear
from .linearise import linearise as linearise
from .margins import Margins as Margins
from .margins import margins_of as margins_of
from .sampled_system import SampledSystem as SampledSystem
