"""The proposed scheme of the paper."""

from __future__ import annotations

from typing import Any

from slidax.performance import AbstractPerformance
from slidax.reaching import FixedTimeReaching, UncertaintyBound
from slidax.robots import AbstractRobot
from slidax.surfaces import SmoothFixedTime
from slidax.transformations import PrescribedPerformance

from .sliding_mode import SlidingMode


def cftsmppc(
    nominal: AbstractRobot,
    *,
    performance: AbstractPerformance,
    overshoot: Any,
    bound: UncertaintyBound,
    k0: Any = 0.1,
    k1: Any = 0.2,
    k2: Any = 0.6,
    p: Any = 0.5,
    q: Any = 1.2,
    r: Any = 1.2,
    delta: Any = 0.01,
    layer: Any = 0.05,
) -> SlidingMode:
    """Approximate continuous fixed-time terminal sliding mode control with prescribed performance (CFTSMPPC).

    Eqs. (40)-(45) with the boundary layer (51), the fixed-time envelope (20) and the smooth power surface (29).
    Source: Nonlinear Dynamics (2022), doi 10.1007/s11071-022-07650-w. Defaults are those of its Table 1.

    - `nominal`: the robot as the law knows it.
    - `performance`: ρ(t); the paper's is `FixedTime`.
    - `overshoot`: ϑ in (0, 1), one number or [n].
    - `bound`: k, b0, b1, b2, m1, m2 of (45)-(47).
    - `k0`: K0 > 0, symmetric positive definite; one number, [n] or [n n].
    - `k1`, `k2`: diagonals of K1, K2 > 0, one number or [n].
    - `p`, `q`: exponents of the surface, 0 < p < 1 < q.
    - `r`: exponent of the reaching law, > 1.
    - `delta`: δ in (0, 1], half-width of the smooth core.
    - `layer`: s0 >= 0, rad/s; 0 gives the discontinuous law (44).

    Raises DefinitionError if one of them is out of its range or does not fit the joints.
    """
    return SlidingMode(
        nominal=nominal,
        transformation=PrescribedPerformance(performance, overshoot),
        surface=SmoothFixedTime(k1=k1, k2=k2, p=p, q=q, delta=delta),
        reaching=FixedTimeReaching(gain=k0, exponent=r, layer=layer),
        bound=bound,
    )
