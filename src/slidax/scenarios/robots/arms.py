"""What the description of a robot becomes."""

from __future__ import annotations

from typing import NamedTuple

from slidax.robots import AbstractRobot, Articulated, JointLimits, Load


class Arms(NamedTuple):
    """The arm that moves, and the arm as the law knows it.

    - `true`, `nominal`: the robots.
    - `load`: what the true one carries for some time.
    """

    true: AbstractRobot
    nominal: AbstractRobot
    load: Load | None = None

    @property
    def limits(self) -> JointLimits | None:
        """Of the joints, by their data sheet; None if it has none."""
        return self.nominal.limits if isinstance(self.nominal, Articulated) else None
