"""Actuators: torque and rate limits, dead time, a first-order lag, gains and cross-talk."""

from __future__ import annotations

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax.core.errors import DefinitionError, as_array, static_value
from slidax.core.linear_algebra import matvec
from slidax.core.parameter import parameter, piece
from slidax.core.part import AbstractPart
from slidax.core.types import Matrix, PerJoint, Scalar, Vector


class TorqueLimits(AbstractPart):
    """Limits of each joint's torque and torque rate: `|τ| <= torque` and `|τ - τ₋| <= rate h`.

    τ₋ is the torque at the last sample, h the time since then. The drive enforces the limits; a controller may know and
    use them.
    """

    torque: PerJoint = parameter("largest torque", "N m or N", "(0, inf]", default=math.inf)
    rate: PerJoint = parameter("fastest change of the torque", "N m/s or N/s", "(0, inf]", default=math.inf)

    def __call__(self, tau: Vector, last: Vector, period: Scalar) -> Vector:
        """Return the torque nearest to `tau` within `last ± rate period` and `±torque`, [n], N m or N.

        If the last torque was beyond the torque limit, that limit takes precedence over the rate limit.

        - `tau`: requested torque [n], N m or N.
        - `last`: torque at the last sample [n], N m or N.
        - `period`: time between two samples [s], > 0.
        """
        # Keep an infinite rate out of the derivatives.
        finite = jnp.isfinite(self.rate)
        change = jnp.where(finite, jnp.where(finite, self.rate, 0.0) * period, math.inf)
        lower, upper = (jnp.clip(last + side, -self.torque, self.torque) for side in (-change, change))
        return jnp.clip(tau, lower, upper)


class ActuatorMap(AbstractPart):
    """Map from the drives' commands c to joint torques, `τ = G c`: gains on G's diagonal, cross-talk elsewhere."""

    matrix: Matrix = parameter("G", "N m or N per N m or N")
    inverse: Matrix = parameter("G⁻¹")

    @classmethod
    def of(cls, matrix: Any) -> ActuatorMap:
        """Return the map with its inverse.

        - `matrix`: G [n n] of `τ = G c`, with commands c and joint torques τ.

        Raises DefinitionError if G is not square or not finite, or if a diagonal entry (a gain) does not exceed the sum
        of the absolute other entries of its row (cross-talk).
        """
        gains = static_value(as_array(matrix))
        if gains.ndim != 2 or gains.shape[0] != gains.shape[1]:
            raise DefinitionError(f"must be a square matrix; got shape {list(gains.shape)}")
        if not np.isfinite(gains).all():
            row, column = np.argwhere(~np.isfinite(gains))[0]
            raise DefinitionError(f"must be finite numbers; row {row + 1}, column {column + 1} is not")
        rest = np.abs(gains).sum(axis=1) - 2.0 * np.diag(gains)
        if (rest >= 0.0).any():
            row = int(np.argmax(rest))
            raise DefinitionError(
                f"each gain must exceed the sum of its row's cross-talk; in row {row + 1} the gain is "
                f"{gains[row, row]:g} and the cross-talk {np.abs(gains[row]).sum() - np.abs(gains[row, row]):g}"
            )
        return cls(as_array(gains), as_array(np.linalg.inv(gains)))

    def torque(self, command: Vector) -> Vector:
        """Return the torques of the joints for a command, both [n], N m or N."""
        return matvec(self.matrix, command)

    def command(self, tau: Vector) -> Vector:
        """Return the command for torques of the joints, both [n], N m or N."""
        return matvec(self.inverse, tau)

    def within(self, limits: TorqueLimits) -> TorqueLimits:
        """Return limits of joint torques: within these, no command exceeds `limits`, for any signs of the torques.

        Joints without a limit do not reduce the limits of others.

        - `limits`: limits of the commands.
        """

        def box(limit: PerJoint) -> Vector:
            size = jnp.diagonal(self.matrix) * limit
            used = jnp.where(jnp.isfinite(limit), jnp.abs(self.inverse) @ jnp.where(jnp.isfinite(size), size, 0.0), 0.0)
            # A little less, so that rounding does not reach the limit.
            return size * (1.0 - 1e-9) / jnp.maximum(jnp.max(used / limit), 1.0)

        return TorqueLimits(box(limits.torque), box(limits.rate))


class ActuatorMemory(eqx.Module):
    """Memory of an `Actuator`.

    - `commands`: the last m commands [m n], newest first, N m or N; m is the dead time in whole periods, rounded up,
      plus 1.
    - `lagged`: command after dead time and lag at the start of the period [n], N m or N.
    """

    commands: Float[Array, "m n"]
    lagged: Vector


class Actuator(AbstractPart):
    """A drive: it limits a command, holds it for a period, delays it by `dead_time`, and lags, `T τ̇ + τ = command`.

    With a fractional dead time, the active command changes within the period. Between changes the lag is integrated
    exactly, by an exponential.
    """

    limits: TorqueLimits = piece("limits of the command", default_factory=TorqueLimits)
    time_constant: PerJoint = parameter("T of a first-order lag", "s", ">= 0", "(0 for no lag)", default=0.0)
    dead_time: float = parameter(
        "dead time, also fractional; a new value recompiles the loop, since it sets the number of stored commands",
        "sampling periods",
        "[0, 100]",
        default=0.0,
        static=True,
        converter=float,
    )
    map: ActuatorMap | None = piece("map from commands to joint torques; None if they are equal", default=None)

    @property
    def change(self) -> float:
        """Time within a period at which the next command becomes active, as a fraction of the period, in [0, 1)."""
        return self.dead_time - math.floor(self.dead_time)

    def init(self, tau: Vector) -> ActuatorMemory:
        """Return the memory of a drive in steady state at a torque, clipped to its limits.

        - `tau`: torque of the joints [n], N m or N.
        """
        tau = jnp.clip(self.command(tau), -self.limits.torque, self.limits.torque)
        return ActuatorMemory(commands=jnp.broadcast_to(tau, (math.ceil(self.dead_time) + 1, *tau.shape)), lagged=tau)

    def command(self, tau: Vector) -> Vector:
        """Return the command for torques of the joints, both [n], N m or N."""
        return tau if self.map is None else self.map.command(tau)

    def set(self, tau: Vector, period: Scalar, memory: ActuatorMemory) -> tuple[Vector, ActuatorMemory]:
        """Set a command at a sample. Return the limited command, [n], N m or N, and the memory after it.

        - `tau`: commanded torque [n], N m or N.
        - `period`: time since the last sample, and to the next [s], > 0.
        - `memory`: from `init`, or from `set` at the last sample.
        """
        lagged = self._lagged(memory, period, period)
        limited = self.limits(tau, memory.commands[0], period)
        return limited, ActuatorMemory(commands=jnp.concatenate([limited[None], memory.commands[:-1]]), lagged=lagged)

    def delivered(self, memory: ActuatorMemory, elapsed: Scalar, period: Scalar) -> Vector:
        """Return the torques on the joints, [n], N m or N.

        - `memory`: from `set` at the last sample.
        - `elapsed`: time since that sample [s], in [0, period].
        - `period`: time between two samples [s], > 0.
        """
        lagged = self._lagged(memory, elapsed, period)
        return lagged if self.map is None else self.map.torque(lagged)

    def _lagged(self, memory: ActuatorMemory, elapsed: Scalar, period: Scalar) -> Vector:
        """Return the command after dead time and lag, `elapsed` after the last sample [n], N m or N."""
        if not self.change:
            return self._lag_response(memory.commands[-1], memory.lagged, elapsed)
        until = self.change * period
        at_change = self._lag_response(memory.commands[-1], memory.lagged, jnp.minimum(elapsed, until))
        after = self._lag_response(memory.commands[-2], at_change, jnp.maximum(elapsed - until, 0.0))
        return jnp.where(elapsed < until, at_change, after)

    def _lag_response(self, command: Vector, start: Vector, elapsed: Scalar) -> Vector:
        """Return the lag's response to a constant command, `elapsed` after it had the value `start` [n], N m or N."""
        lags = self.time_constant > 0
        left = jnp.where(lags, jnp.exp(-elapsed / jnp.where(lags, self.time_constant, 1.0)), 0.0)
        return command + left * (start - command)
