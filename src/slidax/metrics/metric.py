"""What a metric is: a number of a finished run, with what tables and figures say of it."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from slidax.simulation import Run

Value = TypeVar("Value", covariant=True)


@dataclass(frozen=True)
class Metric(Generic[Value]):
    """A metric, called like the function that computes it: `metrics.peak_torque(run)`.

    A batch has the run as first axis. What a run does not have is None; of a batch it is masked.

    - `key`: its place in `summary` and in JSON; a dot in it opens a group.
    - `title`: a few words for tables.
    - `unit`: `{position}` stands for the joint's own unit, `{torque}` for that of its torque.
    - `function`: from a run to the value; the first line of its docstring says how it is computed.
    - `least_is_best`: whether less is better.
    - `per_joint`: whether there is one value per joint, or one for the whole run.
    - `brief`: whether the short comparison on a terminal shows it.
    - `bars`: whether the report of a comparison draws it.
    - `needs_settling`: whether it is a time that means nothing if it lies at the end of the run.
    - `source`: a DOI; tables show the metric for scenarios of this source only.
    """

    key: str
    title: str
    unit: str
    function: Callable[[Run], Value]
    least_is_best: bool = True
    per_joint: bool = True
    brief: bool = False
    bars: bool = False
    needs_settling: bool = False
    source: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "__doc__", self.function.__doc__)

    def __call__(self, run: Run) -> Value:
        """The value.

        - `run`: a finished run, or a batch.
        """
        return self.function(run)

    @property
    def meaning(self) -> str:
        """How it is computed, in a few words."""
        return inspect.cleandoc(self.function.__doc__ or "").partition("\n")[0].replace("`", "").rstrip(".")

    def units(self, run: Run) -> list[str]:
        """Its unit for each joint.

        - `run`: of the arm.
        """
        pairs = zip(run.joint_units, run.torque_units, strict=True)
        return [self.unit.format(position=position, torque=torque).replace("(N)", "N") for position, torque in pairs]

    def shown(self, run: Run) -> list[float | None]:
        """Its values in a table, one per joint; None where there is none.

        - `run`: a finished run.
        """
        values: Any = self(run)
        if values is None:
            return [None] * run.joints
        last = (int(run.tally.samples) - 1) * float(run.period)
        missing = ~np.isfinite(values) | (self.needs_settling & (values >= last - 1e-9))
        return [None if absent else float(value) for value, absent in zip(values, missing, strict=True)]


def metric(title: str, unit: str, *, key: str = "", **how: Any) -> Callable[[Callable[[Run], Value]], Metric[Value]]:
    """Makes a metric of the function below it.

    - `title`, `unit`, `how`: as in `Metric`.
    - `key`: the function's name if not given.
    """
    return lambda function: Metric(key or function.__name__, title, unit, function, **how)


def where(known: Any, values: np.ndarray) -> np.ndarray | None:
    """The values of a run, or None if they are not known; those of a batch, masked where they are not.

    - `known`: [] or [runs].
    - `values`: [n] or [runs n].
    """
    known = np.asarray(known)
    if known.ndim == 0:
        return values if known else None
    masked: np.ndarray = np.ma.masked_array(values, np.broadcast_to(~known[..., None], values.shape))
    return masked


def of_the_run(known: Any, value: np.ndarray) -> np.ndarray | float | None:
    """One number of a run, or None if it is not known; those of a batch, masked where they are not.

    - `known`: [] or [runs].
    - `value`: [] or [runs].
    """
    if value.ndim == 0:
        return float(value) if known else None
    masked: np.ndarray = np.ma.masked_array(value, ~np.asarray(known))
    return masked


def integral(run: Run, total: Any, first: Any, last: Any) -> np.ndarray:
    """The integral over the run by the trapezoidal rule, [n] or [runs n].

    - `run`: whose period it is.
    - `total`: the sum over all samples.
    - `first`, `last`: the first and the last sample, of which half counts.
    """
    return np.asarray(run.period)[..., None] * (np.asarray(total) - 0.5 * (np.asarray(first) + np.asarray(last)))
