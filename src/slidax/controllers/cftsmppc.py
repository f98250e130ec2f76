"""The paper's own scheme."""

from __future__ import annotations

from slidax.reaching import FixedTimeReaching, UncertaintyBound
from slidax.surfaces import SmoothFixedTime
from slidax.transformations import PrescribedPerformance

from .preset import Given, Preset
from .sliding_mode import SlidingMode

cftsmppc = Preset(
    SlidingMode,
    """Approximate continuous fixed-time terminal sliding mode with prescribed performance (CFTSMPPC), the paper's own.

    Eqs. (40)-(45) with the boundary layer (51), the fixed-time envelope (20) and the smooth power surface (29).
    Source: Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w.
    """,
    source="Table 1",
    transformation=Given(PrescribedPerformance),
    surface=Given(SmoothFixedTime, k1=0.2, k2=0.6, p=0.5, q=1.2, delta=0.01),
    reaching=Given(FixedTimeReaching, gain=0.1, exponent=1.2, layer=0.05),
    bound=Given(UncertaintyBound),
)
