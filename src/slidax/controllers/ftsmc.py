"""FTSMC: the fixed-time scheme without an envelope, [23] in the paper."""

from __future__ import annotations

from slidax.reaching import FixedTimeReaching, UncertaintyBound
from slidax.surfaces import LinearCoreFixedTime
from slidax.transformations import Unconstrained

from .preset import Given, Preset
from .sliding_mode import SlidingMode

ftsmc = Preset(
    SlidingMode,
    """Fixed-time terminal sliding mode without an envelope (FTSMC), the paper's [23].

    `s = ė + K1 Ŝ^p(e) + K2 Sig^q(e)` with `ŝ^p` of (78); `u = (k + b0 + b2‖q̇‖² + γ‖τ0 + τ1‖)/(1 - γ)`, without b1. The
    paper prints its parameters, not its law: the form follows from (34)-(47), (78), (79); reconstructed, confidence
    medium in the details. Table 1 lists no boundary layer, hence the unit vector; but the paper's figure 4 looks like a
    run with `layer=0.05`.
    """,
    source="Table 1",
    transformation=Given(Unconstrained),
    surface=Given(LinearCoreFixedTime, k1=1.5, k2=1.0, p=0.5, q=1.2, delta=0.01),
    reaching=Given(FixedTimeReaching, gain=1.0, exponent=1.2, layer=0.0),
    bound=Given(UncertaintyBound, b1=0.0),
)
