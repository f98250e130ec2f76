"""Mathematics without robots: powers, norms, small linear solves, time derivatives, integrators."""

from .derivatives import value_rate_curvature as value_rate_curvature
from .ldl import is_positive_definite as is_positive_definite
from .ldl import matvec as matvec
from .ldl import solve_symmetric as solve_symmetric
from .once import once as once
from .power import power as power
from .power import sig as sig
from .power import sig_and_slope as sig_and_slope
from .runge_kutta import runge_kutta_4 as runge_kutta_4
from .semi_implicit_euler import semi_implicit_euler as semi_implicit_euler
from .smooth_power import smooth_power as smooth_power
from .smooth_power import smooth_power_and_slope as smooth_power_and_slope
from .vector_norm import vector_norm as vector_norm
