"""The scheme that the paper compares with its own: the same law on the older surface."""

from __future__ import annotations

from typing import Any

from slidax.performance import AbstractPerformance
from slidax.reaching import FixedTimeReaching, UncertaintyBound
from slidax.robots import AbstractRobot
from slidax.surfaces import LinearCoreFixedTime
from slidax.transformations import PrescribedPerformance

from .sliding_mode import SlidingMode


def ftsmppc(
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
    """Fixed-time terminal sliding mode control with prescribed performance (FTSMPPC).

    CFTSMPPC, eqs. (40)-(45), (51), with `ŝ^p` of (78) in place of the smooth `s^p` of (29). The paper prints its
    parameters, not its law: reconstructed, confidence medium. Defaults are those of Table 1.

    - `nominal`: the robot as the law knows it.
    - `performance`: ρ(t); the paper's is `FixedTime`.
    - `overshoot`: ϑ in (0, 1), one number or [n].
    - `bound`: k, b0, b1, b2, m1, m2 of (45)-(47).
    - `k0`: K0 > 0, symmetric positive definite; one number, [n] or [n n].
    - `k1`, `k2`: diagonals of K1, K2 > 0, one number or [n], rad/s or m/s.
    - `p`, `q`: exponents of the surface, 0 < p < 1 < q.
    - `r`: exponent of the reaching law, > 1.
    - `delta`: δ in (0, 1], half-width of the straight core.
    - `layer`: s0 >= 0, rad/s; 0 gives the discontinuous law (44).

    Raises DefinitionError if one of them is out of its range or does not fit the joints.
    """
    return SlidingMode(
        nominal=nominal,
        transformation=PrescribedPerformance(performance, overshoot),
        surface=LinearCoreFixedTime(k1=k1, k2=k2, p=p, q=q, delta=delta),
        reaching=FixedTimeReaching(gain=k0, exponent=r, layer=layer),
        bound=bound,
    )
