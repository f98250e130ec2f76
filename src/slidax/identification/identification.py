"""An arm identified from a log: its parameters with standard errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from slidax.robots import Articulated

from .log import Log


@dataclass(frozen=True)
class Estimated:
    """One number of an arm.

    - `name`: such as `armature` or `payload.mass`.
    - `joint`: its joint's name; empty where it belongs to none.
    - `path`: where it stands in the description of a robot; empty where nothing there depends on it.
    - `unit`: of the value.
    - `value`: what fits best.
    - `standard_error`: of the value.
    - `identifiable`: True if the log determines it more closely than the prior.
    """

    name: str
    joint: str
    path: str
    unit: str
    value: float
    standard_error: float
    identifiable: bool

    @property
    def title(self) -> str:
        """Name and joint: `armature of panda_joint1`."""
        return f"{self.name} of {self.joint}" if self.joint else self.name

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Between which the truth is with this probability, if the model's form is right.

        - `confidence`: in (0, 1).
        """
        half = float(stats.norm.ppf(0.5 + 0.5 * confidence)) * self.standard_error
        return self.value - half, self.value + half


@dataclass(frozen=True, eq=False)
class Identification:
    """An arm as a log shows it.

    - `robot`: with rotors, friction, payload and links as identified.
    - `parameters`: each number with its standard error.
    - `log`: what was read.
    - `cut_off`: of the filter of the equations [Hz].
    - `condition`: of the weighted regressor, over what was believed before: the largest gain over the least.
    - `unseen_directions`: how many combinations of the numbers the log does not show.
    - `lag`, `lag_error`: by how much the torques come after the positions, and its standard error [s].
    - `t`, `measured`, `predicted`: torques in the filter's band, over time [k n].
    - `split`: from which of these samples on the log was held out.
    - `fit_rms`, `held_out_rms`, `measured_rms`: of prediction errors in both parts, and of what was measured, in the
      filter's band [n], N m or N.
    - `warnings`: sentences on the log and on parameters that it supports badly.
    - `seconds`: that it took.
    """

    robot: Articulated
    parameters: tuple[Estimated, ...]
    log: Log
    cut_off: float
    condition: float
    unseen_directions: int
    lag: float
    lag_error: float
    t: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray
    split: int
    fit_rms: np.ndarray
    held_out_rms: np.ndarray
    measured_rms: np.ndarray
    warnings: tuple[str, ...]
    seconds: float

    @property
    def unseen(self) -> tuple[Estimated, ...]:
        """The numbers of which this log says nothing, or too little."""
        return tuple(parameter for parameter in self.parameters if not parameter.identifiable)

    def values(self, name: str) -> np.ndarray:
        """All numbers of a name, in the order of the joints.

        - `name`: such as `armature`.
        """
        return np.array([parameter.value for parameter in self.parameters if parameter.name == name])

    def standard_errors(self, name: str) -> np.ndarray:
        """Their standard errors.

        - `name`: such as `armature`.
        """
        return np.array([parameter.standard_error for parameter in self.parameters if parameter.name == name])

    def as_json(self) -> dict[str, Any]:
        """The output of `slidax identify --json`."""
        return {
            "parameters": [
                {
                    "name": parameter.name,
                    "joint": parameter.joint or None,
                    "path": parameter.path or None,
                    "unit": parameter.unit,
                    "value": parameter.value,
                    "standard_error": parameter.standard_error,
                    "seen": parameter.identifiable,
                }
                for parameter in self.parameters
            ],
            "torque_rms": {"fit": self.fit_rms.tolist(), "held_out": self.held_out_rms.tolist()},
            "measured_rms": self.measured_rms.tolist(),
            "warnings": list(self.warnings),
            "cut_off": self.cut_off,
            "condition": self.condition,
            "unseen_directions": self.unseen_directions,
            "lag": {"value": self.lag, "standard_error": self.lag_error},
        }

    def __str__(self) -> str:
        width = max(len(parameter.title) for parameter in self.parameters)
        lines = [f"{self.robot.name} from {self.log.source}: {len(self.log.t)} samples, band {self.cut_off:.3g} Hz"]
        for parameter in self.parameters:
            half = 0.5 * (parameter.interval()[1] - parameter.interval()[0])
            end = "" if parameter.identifiable else "  not seen in this log"
            lines.append(f"{parameter.title:<{width}}  {parameter.value:>10.4g} ± {half:<8.2g} {parameter.unit}{end}")
        lines.append(f"torque [rms] measured     {_listed(self.measured_rms)}")
        lines.append(f"             error, fit   {_listed(self.fit_rms)}")
        lines.append(f"             held out     {_listed(self.held_out_rms)}")
        lines += [f"warning: {sentence}" for sentence in self.warnings]
        if self.unseen_directions:
            lines.append(f"{self.unseen_directions} combinations of these numbers do not show in this log")
        return "\n".join(lines)

    __repr__ = __str__


def _listed(values: np.ndarray) -> str:
    return " ".join(f"{value:8.3g}" for value in values)
