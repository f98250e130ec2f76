"""How large a torque may be, and how fast it may change."""

from __future__ import annotations

import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from slidax._errors import DefinitionError, as_array, is_traced, require_consistent
from slidax._types import PerJoint, Scalar, Vector


class TorqueLimits(eqx.Module):
    """`|τ| <= torque`, and `|τ - τ₋| <= rate h` from one sample to the next, per joint.

    Held by the drive, and known to a controller that plans with them.

    - `torque`: largest torque, one number or [n], N m or N, > 0; infinite for none.
    - `rate`: fastest change, one number or [n], N m/s or N/s, > 0; infinite for none.

    Raises DefinitionError if one of them is out of its range.
    """

    torque: PerJoint = eqx.field(converter=as_array, default=math.inf)
    rate: PerJoint = eqx.field(converter=as_array, default=math.inf)

    def __check_init__(self) -> None:
        require_consistent(self, "torque", "rate")
        # Not by `require`, which refuses the infinite.
        for field in ("torque", "rate"):
            value = getattr(self, field)
            if is_traced(value) or np.all(np.asarray(value) > 0):
                continue
            numbers = np.atleast_1d(value)
            joint = int(np.argmin(numbers > 0))
            where = f" for joint {joint + 1}" if value.ndim else ""
            raise DefinitionError(
                f"`TorqueLimits.{field}` must be > 0 (infinite for no limit); got {numbers[joint].item():g}{where}"
            )

    def __call__(self, tau: Vector, last: Vector, period: Scalar) -> Vector:
        """The torque nearest to `tau` within `±torque`, and of those within `last ± rate period`, [n], N m or N.

        - `tau`: wanted torque [n], N m or N.
        - `last`: torque of the last sample [n], N m or N, within `±torque`.
        - `period`: time between two samples [s], > 0.
        """
        limited = jnp.clip(tau, -self.torque, self.torque)
        # An infinite rate times a period is kept out of the derivatives.
        finite = jnp.isfinite(self.rate)
        change = jnp.where(finite, jnp.where(finite, self.rate, 0.0) * period, math.inf)
        return jnp.clip(limited, last - change, last + change)
