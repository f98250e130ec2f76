"""The fixed-time scheme without an envelope that the paper cites as [23]."""

from __future__ import annotations

from typing import Any

from slidax.reaching import FixedTimeReaching, UncertaintyBound
from slidax.robots import AbstractRobot
from slidax.surfaces import LinearCoreFixedTime
from slidax.transformations import Unconstrained

from .sliding_mode import SlidingMode


def ftsmc(
    nominal: AbstractRobot,
    *,
    bound: UncertaintyBound,
    k0: Any = 1.0,
    k1: Any = 1.5,
    k2: Any = 1.0,
    p: Any = 0.5,
    q: Any = 1.2,
    r: Any = 1.2,
    delta: Any = 0.01,
    layer: Any = 0.0,
) -> SlidingMode:
    """Fixed-time terminal sliding mode control (FTSMC), [23].

    `s = ė + K1 Ŝ^p(e) + K2 Sig^q(e)` with `ŝ^p` of (78); `τ0 = M0 q̈_d + C0 q̇ + G0`;
    `τ1 = -K0 Sig^r(s) - M0 (K1 F̂^p(e) + K2 H^q(e)) ė`; `u = (k + b0 + b2‖q̇‖² + γ‖τ0 + τ1‖)/(1 - γ)`;
    `τ = τ0 + τ1 - u s/(‖s‖ + s0)`.

    The paper prints its parameters, not its law: the form follows from (34)-(47), (78), (79); reconstructed, confidence
    medium in the details. Defaults are those of Table 1. It lists no boundary layer, hence the unit vector; but the
    paper's figure 4 looks like a run with `layer=0.05`.

    - `nominal`: the robot as the law knows it.
    - `bound`: k, b0, b2, m1, m2 of (45)-(47); the law of [23] has no b1, so its `position` should be 0.
    - `k0`: K0 > 0, symmetric positive definite; one number, [n] or [n n].
    - `k1`, `k2`: diagonals of K1, K2 > 0, one number or [n], rad^(1-p)/s and rad^(1-q)/s.
    - `p`, `q`: exponents of the surface, 0 < p < 1 < q.
    - `r`: exponent of the reaching law, > 1.
    - `delta`: δ in (0, 1], half-width of the straight core.
    - `layer`: s0 >= 0, rad/s; 0 gives the discontinuous law.

    Raises DefinitionError if one of them is out of its range or does not fit the joints.
    """
    return SlidingMode(
        nominal=nominal,
        transformation=Unconstrained(),
        surface=LinearCoreFixedTime(k1=k1, k2=k2, p=p, q=q, delta=delta),
        reaching=FixedTimeReaching(gain=k0, exponent=r, layer=layer),
        bound=bound,
    )
