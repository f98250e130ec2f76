"""What a run whose joints lead a tool shows of that tool."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from slidax._types import Scalar, Vector
from slidax.numerics import vector_norm
from slidax.robots import AbstractRobot, Articulated, Coupled, Scara, TwoLink


class Off(eqx.Module):
    """How far something is off, over all samples; each [], in its unit.

    - `error`: the most.
    - `steady`: the most in the last quarter of the run.
    - `square`: sum of its squares.
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
        """The same with one more sample.

        - `size`: how far it is off now.
        - `running`: whether the sample counts.
        - `steady`: whether it also counts as one of the last quarter.
        """
        return Off(
            error=jnp.where(running, jnp.maximum(self.error, size), self.error),
            steady=jnp.where(steady, jnp.maximum(self.steady, size), self.steady),
            square=jnp.where(running, self.square + size * size, self.square),
        )


class Tool(eqx.Module):
    """How far the tool is from where and how the reference has it.

    - `place`: of the tip, m.
    - `turn`: the angle of the rotation between, rad; None for a robot that does not say how its tip is turned.
    """

    place: Off
    turn: Off | None

    @staticmethod
    def begin(robot: AbstractRobot) -> Tool:
        """Before the first sample.

        - `robot`: whose tip the tool is.
        """
        turns = isinstance(robot, Articulated | Coupled | Scara | TwoLink)
        return Tool(place=Off.begin(), turn=Off.begin() if turns else None)

    def add(
        self, robot: AbstractRobot, q: Vector, wanted: Vector, running: Bool[Array, ""], steady: Bool[Array, ""]
    ) -> Tool:
        """The same with one more sample.

        - `robot`: whose tip the tool is.
        - `q`, `wanted`: positions of the joints, as they are and as they should be [n], rad or m.
        - `running`, `steady`: as in `Off.add`.
        """
        away = vector_norm(robot.tip(q) - robot.tip(wanted))
        turn = self.turn
        if turn is not None:
            assert isinstance(robot, Articulated | Coupled | Scara | TwoLink)
            angle = turned(robot.tip_frame(q)[0], robot.tip_frame(wanted)[0])
            turn = turn.add(angle, running, steady)
        return Tool(place=self.place.add(away, running, steady), turn=turn)


def turned(axes: Float[Array, "3 3"], others: Float[Array, "3 3"]) -> Scalar:
    """The angle of the rotation between two frames, in [0, π], rad; exact for small angles, too.

    - `axes`, `others`: axes of the frames, as columns.
    """
    x, y, z = (jnp.cross(others[:, k], axes[:, k]) for k in range(3))
    # Half the sum of these is the axis times the sine; the trace is 1 + 2 cos.
    return jnp.arctan2(vector_norm(0.5 * (x + y + z)), 0.5 * (jnp.sum(axes * others) - 1.0))
