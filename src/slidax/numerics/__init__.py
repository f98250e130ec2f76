"""Mathematics without robots: powers, norms, small linear solves, time derivatives, integrators."""

from .derivatives import value_rate_curvature as value_rate_curvature
from .increasing_root import increasing_root as increasing_root
from .inverse_norm import inverse_norm as inverse_norm
from .ldl import is_positive_definite as is_positive_definite
from .ldl import matvec as matvec
from .ldl import solve_symmetric as solve_symmetric
from .linear_core_power import linear_core_power_and_slope as linear_core_power_and_slope
from .nearest_in_box import nearest_in_box as nearest_in_box
from .once import once as once
from .power import power as power
from .power import sig as sig
from .power import sig_and_slope as sig_and_slope
from .precision import require_64_bits as require_64_bits
from .runge_kutta import runge_kutta_4 as runge_kutta_4
from .saturation import saturation as saturation
from .select import select as select
from .semi_implicit_euler import semi_implicit_euler as semi_implicit_euler
from .smooth_power import smooth_power as smooth_power
from .smooth_power import smooth_power_and_slope as smooth_power_and_slope
from .tangent_mask import tangent_mask as tangent_mask
from .two_term_power import two_term_power_and_slope as two_term_power_and_slope
from .unit_vector import unit_vector as unit_vector
from .vector_norm import vector_norm as vector_norm
