"""Terminal sliding modes of other papers in Example 4.2, with the parameters of Table 2."""

from __future__ import annotations

from slidax.reaching import StateBound

from .adaptive_nonsingular_fast_terminal import AdaptiveNonsingularFastTerminal
from .nonsingular_fast_terminal import NonsingularFastTerminal
from .preset import Given, Preset

nftsmc = Preset(
    NonsingularFastTerminal,
    "Nonsingular fast terminal sliding mode, the paper's [7].",
    source="Table 2",
    bound=Given(StateBound),
    gamma1=2.0,
    gamma2=5.0 / 3.0,
    reach=2.0,
    gain=2.0,
    layer=0.0,
)

anftsmc = Preset(
    AdaptiveNonsingularFastTerminal,
    """Adaptive nonsingular fast terminal sliding mode, the paper's [10].

    α comes from a follow-up paper: with the 0.2 of Table 2 the law is singular.
    """,
    source="Table 2",
    k1=1.0,
    k2=1.0,
    alpha=2.0,
    beta=5.0 / 3.0,
    gain=250.0,
    margin=0.5,
    adaptation=(0.01, 0.01, 0.01),
    initial=(0.0, 0.0, 0.0),
    layer=0.0,
)
