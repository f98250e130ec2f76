"""FTSMPPC: the paper's law on an older surface, which has a kink."""

from __future__ import annotations

from slidax.reaching import FixedTimeReaching, UncertaintyBound
from slidax.surfaces import LinearCoreFixedTime
from slidax.transformations import PrescribedPerformance

from .preset import Given, Preset
from .sliding_mode import SlidingMode

ftsmppc = Preset(
    SlidingMode,
    """Fixed-time terminal sliding mode with prescribed performance (FTSMPPC), the paper's [33].

    CFTSMPPC with `ŝ^p` of (78) in place of the smooth `s^p` of (29). The paper prints its parameters, not its law:
    reconstructed, confidence medium.
    """,
    source="Table 1",
    transformation=Given(PrescribedPerformance),
    surface=Given(LinearCoreFixedTime, k1=0.2, k2=0.6, p=0.5, q=1.2, delta=0.01),
    reaching=Given(FixedTimeReaching, gain=0.1, exponent=1.2, layer=0.05),
    bound=Given(UncertaintyBound),
)
