"""The torque of a sampled law within the limits of the drives."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from slidax.core.linear_algebra import nearest_in_box, solve_symmetric
from slidax.core.powers import vector_norm
from slidax.core.types import Matrix, Scalar, Vector
from slidax.plant.actuators import TorqueLimits


def compensated_share(lumped: Vector, cover: Scalar | None, limits: TorqueLimits) -> Scalar:
    """Return the share of the estimated disturbance torque `M0 ŵ` that the law compensates, 0 to 1.

    The compensated torque is limited by the law's own bound or, without one, by the torque limits.

    - `lumped`: `M0 ŵ` [n], N m or N.
    - `cover`: the law's bound of the norm ‖M0 ŵ‖, N m; None without one.
    """
    if cover is None:
        return 1.0 / jnp.maximum(jnp.max(jnp.abs(lumped) / limits.torque), 1.0)
    size = vector_norm(lumped)
    return jnp.where(size > cover, cover / jnp.maximum(size, cover), 1.0)


def within_limits(
    wanted: Vector, last: Vector, m0: Matrix, limits: TorqueLimits, period: Scalar
) -> tuple[Vector, Vector, Bool[Array, ""]]:
    """Return the torque within the limits, the acceleration that they withhold, and True if they withhold none.

    Of all torques within the limits, the result has the accelerations that are nearest to those of `wanted`.

    - `wanted`, `last`: this sample's torque before the limits, and the torque of the last sample [n], N m or N.
    - `m0`: inertia matrix M0 [n n].
    - `period`: h [s].
    """
    endless = jnp.full_like(wanted, jnp.inf)
    lower, upper = limits(-endless, last, period), limits(endless, last, period)
    free = jnp.all((wanted >= lower) & (wanted <= upper))

    def limited() -> tuple[Vector, Vector]:
        tau = nearest_in_box(wanted, lower, upper, m0)
        return tau, solve_symmetric(m0, wanted - tau)

    tau, withheld = jax.lax.cond(free, lambda: (wanted, jnp.zeros_like(wanted)), limited)
    return tau, withheld, free
