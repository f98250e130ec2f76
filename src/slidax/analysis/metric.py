"""Metrics as functions of a run: their definition, their units, and their values for batches and inside `jit`."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Any, Generic, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from slidax.core.errors import DefinitionError, is_traced
from slidax.simulation.run import Run

Value = TypeVar("Value", covariant=True)


@dataclass(frozen=True)
class Metric(Generic[Value]):
    """A metric, called like the function that computes it: `metrics.peak_torque(run)`.

    For a batch the first axis is the run. A missing value is None, and masked in a batch. Inside `jit`, `vmap` and
    `grad` it is NaN, since tracing cannot tell which values are missing.

    - `key`: key in `summary` and in JSON; a dot separates a group from a name.
    - `title`: a short title for tables.
    - `unit`: unit; `{position}` stands for the unit of the joint, `{torque}` for the unit of its torque.
    - `function`: returns the value for a run; the first line of its docstring states the formula.
    - `least_is_best`: True if smaller is better.
    - `per_joint`: True for a value per joint, False for a single value per run.
    - `brief`: True if the short comparison on a terminal shows the metric.
    - `bars`: True if a comparison report plots the metric.
    - `needs_settling`: True for a settling time; tables omit a value at the run's end, since the run did not settle.
    - `counts`: True if the metric counts samples, and so has no derivative.
    - `source`: a DOI; tables show the metric only for scenarios of this source.
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
    counts: bool = False
    source: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "__doc__", self.function.__doc__)

    def __call__(self, run: Run) -> Value:
        """Return the metric's value.

        - `run`: a finished run or a batch, or a traced run inside `jit`, `vmap` and `grad`.

        Raises DefinitionError for a traced run if the metric counts samples or uses NumPy.
        """
        if not is_traced(run.tally):
            return self.function(run)
        if self.counts:
            raise counting_error(self.key)
        try:
            return self.function(run)
        except (jax.errors.TracerArrayConversionError, jax.errors.ConcretizationTypeError) as error:
            raise DefinitionError(
                f"`{self.key}` uses NumPy, which cannot be traced and has no derivatives: compute it with "
                "`slidax.analysis.arrays(run)` in place of `numpy`, or for the finished run"
            ) from error

    @property
    def meaning(self) -> str:
        """First line of the docstring, without its code marks and period, for tables."""
        return inspect.cleandoc(self.function.__doc__ or "").partition("\n")[0].replace("`", "").rstrip(".")

    def units(self, run: Run) -> list[str]:
        """The metric's unit for each joint of a run."""
        pairs = zip(run.joint_units, run.torque_units, strict=True)
        return [self.unit.format(position=position, torque=torque).replace("(N)", "N") for position, torque in pairs]

    def shown(self, run: Run) -> list[float | None]:
        """The values of a run for a table, one per joint; None for a missing value."""
        values: Any = self(run)
        if values is None:
            return [None] * run.joints
        last = (int(run.tally.samples) - 1) * float(run.period)
        missing = ~np.isfinite(values) | (self.needs_settling & (values >= last - 1e-9))
        return [None if absent else float(value) for value, absent in zip(values, missing, strict=True)]


def metric(title: str, unit: str, *, key: str = "", **how: Any) -> Callable[[Callable[[Run], Value]], Metric[Value]]:
    """Decorator that turns a function into a metric.

    - `title`, `unit`: as in `Metric`.
    - `key`: as in `Metric`; by default the function's name.
    - `how`: further fields of `Metric`.
    """
    return lambda function: Metric(key or function.__name__, title, unit, function, **how)


def counting_error(name: str) -> DefinitionError:
    """Return the error for a metric that counts samples, if it is used inside `jit`, `vmap` or `grad`.

    - `name`: key of the metric.
    """
    return DefinitionError(
        f"`{name}` counts samples, and so has no derivative and no value inside `jit`, `vmap` or `grad`: compute it "
        "for the finished run, and differentiate another metric, such as `rms_error`"
    )


def arrays(run: Run) -> Any:
    """Return `numpy` for a finished run, and `jax.numpy` inside `jit`, `vmap` and `grad`.

    - `run`: the run that a metric evaluates.
    """
    return jnp if is_traced(run.tally) else np


def array_of(value: Any) -> np.ndarray:
    """Convert a value of `run.tally` to NumPy; inside `jit`, `vmap` and `grad` return it unchanged.

    - `value`: a scalar or an array from the tally, the sums and extremes that the simulation updates at each sample.
    """
    return value if is_traced(value) else np.asarray(value)


def safe_sqrt(xp: Any, square: Any) -> Any:
    """Square root with derivative 0, instead of infinity, at 0.

    - `xp`: `numpy` or `jax.numpy`.
    - `square`: >= 0 up to rounding.
    """
    positive = square > 0.0
    return xp.where(positive, xp.sqrt(xp.where(positive, square, 1.0)), 0.0)


def known_values(known: Any, values: np.ndarray) -> np.ndarray | None:
    """Return a metric's values per joint, with those of runs without a value marked as missing.

    Missing is None for a run, masked for a batch, and NaN inside `jit`, `vmap` and `grad`.

    - `known`: True for a run whose values are known, [] or [runs].
    - `values`: the metric's values, [n] or [runs n].
    """
    if is_traced((known, values)):
        return _traced_where(jnp.asarray(known)[..., None], values)
    known = np.asarray(known)
    if known.ndim == 0:
        return values if known else None
    return np.ma.masked_array(values, np.broadcast_to(~known[..., None], values.shape))


def value_of_run(known: Any, value: np.ndarray) -> np.ndarray | float | None:
    """Return a metric's value per run, with that of runs without a value marked as missing, as in `known_values`.

    - `known`: True for a run whose value is known, [] or [runs].
    - `value`: the metric's value, [] or [runs].
    """
    if is_traced((known, value)):
        return _traced_where(known, value)
    if value.ndim == 0:
        return float(value) if known else None
    return np.ma.masked_array(value, ~np.asarray(known))


def _traced_where(known: Any, values: Any) -> np.ndarray:
    array: Any = jnp.where(known, values, jnp.nan)
    # A traced JAX array takes the place of a NumPy array.
    return array


def integral(run: Run, total: Any, first: Any, last: Any) -> np.ndarray:
    """Integral of a signal over the run by the trapezoidal rule, [n] or [runs n].

    - `run`: the run, whose period is the step.
    - `total`: sum of the signal over all samples.
    - `first`, `last`: the signal at the first and the last sample, which count half.
    """
    return array_of(run.period)[..., None] * (array_of(total) - 0.5 * (array_of(first) + array_of(last)))


def short_names(names: Sequence[str]) -> list[str]:
    """Return names without the words that all begin or end with: `panda_joint1` becomes `joint1`.

    Common words stay if a name would have no letter without them.

    - `names`: names of the joints.
    """
    before = _common_length(names)
    after = _common_length([name[::-1] for name in names])
    for start, end in ((before, after), (before, 0), (0, after)):
        short = [name[start : len(name) - end] for name in names]
        if all(re.search("[^\\W\\d_]", name) for name in short):
            return short
    return list(names)


def _common_length(names: Sequence[str]) -> int:
    """Length of the words that all names begin with, including the separator."""
    words = [re.findall("[^ _/.-]*[ _/.-]+", name) for name in names]
    alike = takewhile(lambda same: len(set(same)) == 1, zip(*words, strict=False)) if len(names) > 1 else ()
    return sum(len(same[0]) for same in alike)
