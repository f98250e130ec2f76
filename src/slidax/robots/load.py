"""A payload that the tip carries for part of a run."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._errors import DefinitionError
from slidax.parts import AbstractPart, Scalar, parameter, piece

from .articulated import Articulated
from .coupled import Coupled
from .payload import Payload
from .robot import AbstractRobot


class Load(AbstractPart):
    """The tip carries `payload` for `attached <= t < released`.

    Joint velocities are continuous: at pick-up the body has the tip's velocity, as when both rest, and keeps it at
    release.
    """

    payload: Payload = piece("what is carried")
    attached: Scalar = parameter("from when it is carried", "s", default=0.0)
    released: Scalar = parameter("until when it is carried", "s", "(attached, inf]", default=float("inf"))

    def on(self, robot: AbstractRobot, t: Scalar) -> AbstractRobot:
        """Return the arm at time t [s], with this payload in addition to its permanent one.

        Raises DefinitionError for an arm without a tip frame.
        """
        if isinstance(robot, Coupled):
            return eqx.tree_at(lambda coupled: coupled.arm, robot, self.on(robot.arm, t))
        if not isinstance(robot, Articulated):
            raise DefinitionError(f"a {type(robot).__name__} has no tip to carry a load; only an articulated arm has")
        carried = jnp.where((t >= self.attached) & (t < self.released), 1.0, 0.0)
        return eqx.tree_at(lambda arm: arm.payload, robot, robot.payload.joined(self.payload.times(carried)))
