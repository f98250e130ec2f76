"""The singularity-free fixed-time scheme that the paper cites as [24]."""

from __future__ import annotations

from typing import Any

from slidax.reaching import TwoPowerReaching, UncertaintyBound
from slidax.robots import AbstractRobot
from slidax.surfaces import SingularityFree
from slidax.transformations import AbstractTransformation, Unconstrained

from .sliding_mode import SlidingMode


def sfsmc(
    nominal: AbstractRobot,
    *,
    bound: UncertaintyBound,
    c1: Any = 2.0,
    c2: Any = 2.0,
    alpha: Any = 0.7,
    beta: Any = 1.9,
    r: Any = 1.7,
    delta: Any = 0.3,
    k1: Any = 5.0,
    k2: Any = 5.0,
    v1: Any = 2.5,
    v2: Any = 0.5,
    layer: Any = 0.0,
    transformation: AbstractTransformation | None = None,
) -> SlidingMode:
    """Singularity-free fixed-time sliding mode control (SFSMC), [24]; with an envelope around it if one is given.

    `s = ė + C1 S_α(e) + C2 Sig^β(e)`, `S_α(x) = sig^α(x)` for `|x| >= δ`, else `l1 x + l2 sig^r(x)` with
    `l1 = (r-α)/(r-1) δ^(α-1)`, `l2 = (α-1)/(r-1) δ^(α-r)`;
    `τ0 + τ1 = M0 (q̈_d - (C1 S_α'(e) + C2 β|e|^(β-1)) ė) + C0 q̇ + G0 - K1 Sig^v1(s) - K2 Sig^v2(s)`;
    `u = (k + a0 + a1‖q̇‖² + γ‖τ0 + τ1‖)/(1 - γ)`; `τ = τ0 + τ1 - u s/(‖s‖ + s0)`.

    The paper prints its parameters, not its law: reconstructed, confidence medium; of Example 4.2 it gives the first
    torque of joint 3 as 44.4 N, where the paper prints 45.37 N. Defaults are those of Table 2.

    - `nominal`: the robot as the law knows it.
    - `bound`: k, m1, m2 of (45)-(47), a0 as `constant`, a1 as `velocity`; the law has no b1, so its `position` should
      be 0.
    - `c1`, `c2`: diagonals of C1, C2 > 0, one number or [n], rad^(1-α)/s and rad^(1-β)/s.
    - `alpha`, `beta`: exponents of the surface, 0 < α < 1 < β.
    - `r`: exponent in the surface's core, > 1.
    - `delta`: δ > 0, half-width of the core, rad.
    - `k1`, `k2`: diagonals of K1, K2 > 0, one number or [n], N m.
    - `v1`, `v2`: exponents of the reaching law, v1 > 1 > v2 > 0.
    - `layer`: s0 >= 0, rad/s; 0 gives the discontinuous law.
    - `transformation`: a `PrescribedPerformance` puts its envelope around the scheme, as (40)-(45) do; None for none.

    Raises DefinitionError if one of them is out of its range or does not fit the joints.
    """
    return SlidingMode(
        nominal=nominal,
        transformation=Unconstrained() if transformation is None else transformation,
        surface=SingularityFree(c1=c1, c2=c2, alpha=alpha, beta=beta, r=r, delta=delta),
        reaching=TwoPowerReaching(k1=k1, k2=k2, v1=v1, v2=v2, layer=layer),
        bound=bound,
    )
