"""Tool error of a run whose joints follow a tool path."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from slidax._types import Scalar, Vector
from slidax.numerics import vector_norm
from slidax.robots import AbstractRobot, Articulated, Coupled, Scara, TwoLink


class Off(eqx.Module):
    """An error over all samples; each [], in its unit.

    - `error`: maximum.
    - `steady`: maximum in the last quarter of the run.
    - `square`: sum of squares.
    """

    error: Scalar
    steady: Scalar
    square: Scalar

    @staticmethod
    def begin() -> Off:
        """Before the first sample."""
        nothing = jnp.zeros(())
        return Off(error=nothing, steady=nothing, square=nothing)

    def add(self, size: Scalar, running: Bool[Array, ""], steady: Bool[Array, ""]) -> Off:
        """Add a sample if `running`, and to the last quarter if `steady`."""
        return Off(
            error=jnp.where(running, jnp.maximum(self.error, size), self.error),
            steady=jnp.where(steady, jnp.maximum(self.steady, size), self.steady),
            square=jnp.where(running, self.square + size * size, self.square),
        )


class Tool(eqx.Module):
    """Error of the tool relative to the reference.

    - `place`: distance of the tip, m.
    - `turn`: rotation angle, rad; None for a robot without an orientation of its tip.
    """

    place: Off
    turn: Off | None

    @staticmethod
    def begin(robot: AbstractRobot) -> Tool:
        """Before the first sample."""
        turns = isinstance(robot, Articulated | Coupled | Scara | TwoLink)
        return Tool(place=Off.begin(), turn=Off.begin() if turns else None)

    def add(
        self, robot: AbstractRobot, q: Vector, wanted: Vector, running: Bool[Array, ""], steady: Bool[Array, ""]
    ) -> Tool:
        """Add a sample with the actual and the wanted joint positions [n], rad or m."""
        away = vector_norm(robot.tip(q) - robot.tip(wanted))
        turn = self.turn
        if turn is not None:
            assert isinstance(robot, Articulated | Coupled | Scara | TwoLink)
            angle = turned(robot.tip_frame(q)[0], robot.tip_frame(wanted)[0])
            turn = turn.add(angle, running, steady)
        return Tool(place=self.place.add(away, running, steady), turn=turn)


def turned(axes: Float[Array, "3 3"], others: Float[Array, "3 3"]) -> Scalar:
    """Rotation angle between two frames with axes as columns, in [0, π], rad; accurate for small angles."""
    x, y, z = (jnp.cross(others[:, k], axes[:, k]) for k in range(3))
    # Half the sum of these is the axis times the sine; the trace is 1 + 2 cos.
    return jnp.arctan2(vector_norm(0.5 * (x + y + z)), 0.5 * (jnp.sum(axes * others) - 1.0))
