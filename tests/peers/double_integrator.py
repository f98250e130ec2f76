"""One joint without bias, the double integrator, and the laws on it that OpenSMC and slidax both have.

OpenSMC's error is `x_ref - x` where slidax has `q - q_d` (its NFTSMC excepted, which has slidax's), so that with the
same gains its sliding variable is that of slidax with the other sign; the torque is the same.
"""

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from opensmc.controllers import NFTSMC, ClassicalSMC, FixedTimeSMC
from opensmc.plants import DoubleIntegrator
from opensmc.reaching import Saturation
from opensmc.reaching import SuperTwisting as SuperTwistingReaching
from opensmc.simulator import Simulator

from slidax import simulate
from slidax.arms import AbstractRobot
from slidax.core.errors import as_array
from slidax.core.types import Scalar, State
from slidax.law import (
    AbstractController,
    Linear,
    LinearCoreFixedTime,
    SlidingMode,
    SlotineLi,
    SuperTwisting,
    TwoPowerReaching,
    UncertaintyBound,
    Unconstrained,
)
from slidax.motions import ConstantPosture
from slidax.plant import Constant as ConstantForce
from slidax.simulation import Plant

NEXT_TO_ONE = float(np.nextafter(1.0, 2.0))
NEXT_TO_NOTHING = 1e-300
"""For a parameter of slidax that must be positive and whose term OpenSMC does not have: far beneath any rounding."""


class OneJoint(AbstractRobot):
    """`J q̈ = τ + τ_d`: a slide on a level rail."""

    joint_units: ClassVar[tuple[str, ...]] = ("m",)
    joint_names: ClassVar[tuple[str, ...]] = ("joint 1",)
    inertia: Scalar = eqx.field(converter=as_array, default=1.0)

    def mass(self, q):
        return self.inertia * jnp.eye(1)

    def bias(self, q, dq):
        return jnp.zeros_like(q)

    def friction(self, dq):
        return jnp.zeros_like(dq)

    def potential(self, q):
        return jnp.zeros(())

    def tip(self, q):
        return jnp.concatenate([q, jnp.zeros(2)])


class Pair(NamedTuple):
    """The same law twice.

    - `peer`: makes OpenSMC's, whose memory is in the object.
    - `ours`: slidax's.
    - `sign`: of OpenSMC's sliding variable relative to slidax's.
    - `inertia`: of the joint that both are for.
    - `accelerates`: whether OpenSMC's law takes the reference acceleration; if not, they agree where that is zero.
    - `reach`: errors below this, where both formulas are the same.
    """

    peer: Callable[[], Any]
    ours: AbstractController
    sign: float = -1.0
    inertia: float = 1.0
    accelerates: bool = False
    reach: float = 3.0


def robust(size: float) -> UncertaintyBound:
    """A robust torque of constant size."""
    return UncertaintyBound(1.0, 1.0, 0.0, 0.0, 0.0, size)


J = 1.7
CLASSICAL = Pair(
    lambda: ClassicalSMC(c=4.0, k=3.0, eta=2.0, J=J),
    SlotineLi(OneJoint(J), Unconstrained(), Linear(4.0), damping=3.0 * J, gain=2.0 * J, layer=0.0),
    inertia=J,
    accelerates=True,
)
BOUNDARY_LAYER = Pair(
    lambda: ClassicalSMC(reaching=Saturation(k=6.0, phi=0.5), c=4.0, J=J),
    SlotineLi(OneJoint(J), Unconstrained(), Linear(4.0), damping=0.0, gain=6.0 * J, layer=0.5),
    inertia=J,
    accelerates=True,
)
FIXED_TIME = Pair(
    lambda: FixedTimeSMC(c=4.0, alpha=3.0, beta=2.0, p=0.6, q=1.4),
    SlidingMode(
        OneJoint(),
        Unconstrained(),
        Linear(4.0),
        TwoPowerReaching(k1=2.0, k2=3.0, v1=1.4, v2=0.6),
        robust(NEXT_TO_NOTHING),
    ),
)
NONSINGULAR_FAST_TERMINAL = Pair(
    lambda: NFTSMC(alpha=5.0, beta=2.0, gamma=1.4, k1=10.0, k2=3.0, rho=0.714, eta=1.0, delta=0.1),
    SlidingMode(
        OneJoint(),
        Unconstrained(),
        # With δ = 1 the straight core of Ŝ^p is the linear term for all errors below 1.
        LinearCoreFixedTime(k1=5.0, k2=2.0, p=0.5, q=1.4, delta=1.0),
        TwoPowerReaching(k1=10.0, k2=3.0, v1=NEXT_TO_ONE, v2=0.714, layer=0.1),
        robust(1.0),
    ),
    sign=1.0,
    reach=1.0,
)
PAIRS = {
    "classical": CLASSICAL,
    "boundary_layer": BOUNDARY_LAYER,
    "fixed_time": FIXED_TIME,
    "nonsingular_fast_terminal": NONSINGULAR_FAST_TERMINAL,
}


def super_twisting(period: float) -> Pair:
    """The super-twisting law for one sampling period, which OpenSMC's must be told."""
    return Pair(
        lambda: ClassicalSMC(reaching=SuperTwistingReaching(k1=3.0, k2=2.2, dt=period), c=4.0),
        SuperTwisting(OneJoint(), Unconstrained(), Linear(4.0), k1=3.0, k2=2.2),
    )


GOAL, START, PUSH = 0.3, (-0.4, 0.5), 0.8
"""A set-point, a start and a constant disturbance for closed loops."""


def by_opensmc(pair: Pair, period: float, steps: int, method: str = "rk4", push: Any = PUSH) -> dict[str, np.ndarray]:
    """The closed loop by OpenSMC's own simulator."""
    # Its number of steps is int(T/dt), so half a step is added that is cut off again.
    simulator = Simulator(dt=period, T=(steps + 0.5) * period, method=method)
    force = push if callable(push) else lambda t: push
    return simulator.run(
        pair.peer(),
        DoubleIntegrator(J=pair.inertia),
        ref_fn=lambda t: np.array([GOAL, 0.0]),
        dist_fn=lambda t: np.array([0.0, force(t)]),
        x0=np.array(START),
    )


def by_slidax(pair: Pair, period: float, steps: int, disturbance: Any = None, **options: Any) -> Any:
    """The same closed loop by `slidax.simulate`: the finished run."""
    return simulate(
        Plant(OneJoint(pair.inertia), disturbance or ConstantForce([PUSH])),
        pair.ours,
        ConstantPosture([GOAL]),
        State(q=jnp.array(START[:1]), dq=jnp.array(START[1:])),
        t1=steps * period,
        period=period,
        progress=False,
        **options,
    )
