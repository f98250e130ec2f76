"""A motion that stands for all that stay in a range of positions, speeds and accelerations."""

from __future__ import annotations

from typing import Any

import numpy as np

from slidax._errors import DefinitionError, each_of
from slidax.scenarios.base import AbstractDescription, Numbers, said
from slidax.scenarios.true_and_nominal import Arms

ROOM = 0.8
"""Of the range that the motion takes."""

SPREAD = 0.85
"""The slowest joint's frequency over the fastest one's, so that the joints meet in every way."""


class RangeDescription(AbstractDescription):
    """Between which positions the joints move."""

    low: Numbers = said("least positions", "rad or m")
    high: Numbers = said("largest positions", "rad or m")


class WorkspaceDescription(AbstractDescription):
    """Where and how fast the joints move."""

    q: RangeDescription | None = None
    """Positions; the joints' limits if not given."""
    speed: Numbers = said("largest speed", "rad/s or m/s")
    acceleration: Numbers = said("largest acceleration", "rad/s² or m/s²")

    def motion(self, arms: Arms) -> dict[str, Any]:
        """Sinusoids about the middle: as wide as range, speed and acceleration allow, with `A ω <= v`, `A ω² <= a`.

        - `arms`: whose joints.

        Raises DefinitionError if the range is empty, or neither given nor the arm's.
        """
        n = arms.true.joints
        low, high = self._ends(arms, n)
        speed, acceleration = self._each("speed", self.speed, n), self._each("acceleration", self.acceleration, n)
        amplitude = np.minimum(ROOM * 0.5 * (high - low), speed**2 / acceleration)
        slower = np.linspace(1.0, SPREAD, n)
        slower = np.concatenate([slower[::2], slower[1::2]])
        frequency = slower * np.minimum(speed / amplitude, np.sqrt(acceleration / amplitude))
        return {
            "kind": "sinusoid",
            "offset": _rounded(0.5 * (low + high)),
            "amplitude": _rounded(amplitude),
            "frequency": _rounded(frequency),
        }

    def _ends(self, arms: Arms, joints: int) -> tuple[Any, Any]:
        if self.q is not None:
            low, high = self._each("q.low", self.q.low, joints, None), self._each("q.high", self.q.high, joints, None)
        elif arms.limits is not None:
            low, high = np.asarray(arms.limits.lower, float), np.asarray(arms.limits.upper, float)
        else:
            raise DefinitionError("this robot has no limits of its own: give `low` and `high`", where="q")
        if not np.isfinite(low).all() or not np.isfinite(high).all():
            raise DefinitionError("a joint of this robot turns without end: give `low` and `high`", where="q")
        if (low >= high).any():
            joint = int(np.argmax(low >= high))
            raise DefinitionError(
                f"low must be < high; joint {joint + 1} has {low[joint]:g}, {high[joint]:g}", where="q"
            )
        return low, high

    @staticmethod
    def _each(where: str, value: Numbers, joints: int, above: float | None = 0.0) -> Any:
        numbers = np.asarray(value, float)
        if numbers.ndim and len(numbers) != joints:
            message = f"must be one number or one for {each_of(joints, 'joint')}; got {len(numbers)}"
            raise DefinitionError(message, where=where)
        if not np.isfinite(numbers).all() or (above is not None and (numbers <= above).any()):
            raise DefinitionError(f"must be finite{'' if above is None else ' and > 0'}; got {value}", where=where)
        return np.broadcast_to(numbers, (joints,)).astype(float)


def _rounded(values: Any) -> list[float]:
    return [float(f"{value:.4g}") for value in values]
