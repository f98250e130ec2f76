"""Whole control schemes: final classes, and recipes over the shared parts."""

from .adaptive_nonsingular_fast_terminal import AdaptiveNonsingularFastTerminal as AdaptiveNonsingularFastTerminal
from .cftsmppc import cftsmppc as cftsmppc
from .computed_torque import ComputedTorque as ComputedTorque
from .controller import AbstractController as AbstractController
from .ftsmc import ftsmc as ftsmc
from .ftsmppc import ftsmppc as ftsmppc
from .gravity_compensated_pd import GravityCompensatedPD as GravityCompensatedPD
from .model_based import AbstractModelBased as AbstractModelBased
from .model_based import AbstractSurfaceBased as AbstractSurfaceBased
from .nonsingular_fast_terminal import NonsingularFastTerminal as NonsingularFastTerminal
from .sampled_data import SampledData as SampledData
from .sampled_data import sampled_data as sampled_data
from .sfsmc import sfsmc as sfsmc
from .sliding_mode import SlidingMode as SlidingMode
from .slotine_li import SlotineLi as SlotineLi
from .steps import AbstractStep as AbstractStep
from .steps import Decision as Decision
from .steps import Moment as Moment
from .steps import Recovery as Recovery
from .super_twisting import Integral as Integral
from .super_twisting import SuperTwisting as SuperTwisting
