"""Metrics as functions of a run: definition, units, batches and traced runs."""

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

    A batch has the run as first axis. Missing values are None; those of a batch are masked. Inside `jit`, `vmap`
    and `grad`, where this is not known yet, it is NaN.

    - `key`: its place in `summary` and in JSON; a dot in it opens a group.
    - `title`: a few words for tables.
    - `unit`: `{position}` stands for the joint's own unit, `{torque}` for that of its torque.
    - `function`: from a run to the value; the first line of its docstring says how it is computed.
    - `least_is_best`: whether less is better.
    - `per_joint`: whether there is one value per joint, or one for the whole run.
    - `brief`: whether the short comparison on a terminal shows it.
    - `bars`: whether the report of a comparison draws it.
    - `needs_settling`: whether it is a time that means nothing if it lies at the end of the run.
    - `counts`: True if it counts samples, and so has no derivative.
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
    counts: bool = False
    source: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "__doc__", self.function.__doc__)

    def __call__(self, run: Run) -> Value:
        """The value.

        - `run`: a finished run, or a batch; also inside `jit`, `vmap` and `grad`.

        Raises DefinitionError inside these if the metric counts samples, or computes with NumPy.
        """
        if not is_traced(run.tally):
            return self.function(run)
        if self.counts:
            raise counting_error(self.key)
        try:
            return self.function(run)
        except (jax.errors.TracerArrayConversionError, jax.errors.ConcretizationTypeError) as error:
            raise DefinitionError(
                f"`{self.key}` is computed by NumPy, which has no derivatives and cannot be traced: compute it by "
                "`slidax.analysis.arrays(run)` in place of `numpy`, or take it of the finished run"
            ) from error

    @property
    def meaning(self) -> str:
        """The formula in a few words, for tables."""
        return inspect.cleandoc(self.function.__doc__ or "").partition("\n")[0].replace("`", "").rstrip(".")

    def units(self, run: Run) -> list[str]:
        """Its unit for each joint."""
        pairs = zip(run.joint_units, run.torque_units, strict=True)
        return [self.unit.format(position=position, torque=torque).replace("(N)", "N") for position, torque in pairs]

    def shown(self, run: Run) -> list[float | None]:
        """Its values in a table, one per joint; None where there is none."""
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


def counting_error(name: str) -> DefinitionError:
    """The refusal of a metric that counts samples, inside `jit`, `vmap` and `grad`.

    - `name`: of the metric.
    """
    return DefinitionError(
        f"`{name}` counts samples, so that it has no derivative and no value inside `jit`, `vmap` or `grad`: take it "
        "of the finished run, and differentiate another metric, such as `rms_error`"
    )


def arrays(run: Run) -> Any:
    """Return NumPy for a finished run, and JAX's twin of NumPy inside `jit`, `vmap` and `grad`.

    - `run`: the run that a metric looks at.
    """
    return jnp if is_traced(run.tally) else np


def array_of(value: Any) -> np.ndarray:
    """A number of a run's tally as NumPy's; as it is inside `jit`, `vmap` and `grad`.

    - `value`: one number, or an array.
    """
    return value if is_traced(value) else np.asarray(value)


def safe_sqrt(xp: Any, square: Any) -> Any:
    """The square root, whose derivative at 0 is 0 in place of infinity.

    - `xp`: NumPy, or JAX's.
    - `square`: >= 0 but for rounding.
    """
    positive = square > 0.0
    return xp.where(positive, xp.sqrt(xp.where(positive, square, 1.0)), 0.0)


def known_values(known: Any, values: np.ndarray) -> np.ndarray | None:
    """The values of a run, or None if they are not known; those of a batch, masked where they are not.

    - `known`: [] or [runs].
    - `values`: [n] or [runs n]; of a traced run they are NaN where they are not known.
    """
    if is_traced((known, values)):
        return _traced_where(jnp.asarray(known)[..., None], values)
    known = np.asarray(known)
    if known.ndim == 0:
        return values if known else None
    return np.ma.masked_array(values, np.broadcast_to(~known[..., None], values.shape))


def value_of_run(known: Any, value: np.ndarray) -> np.ndarray | float | None:
    """One number of a run, or None if it is not known; those of a batch, masked where they are not.

    - `known`: [] or [runs].
    - `value`: [] or [runs]; of a traced run it is NaN where it is not known.
    """
    if is_traced((known, value)):
        return _traced_where(known, value)
    if value.ndim == 0:
        return float(value) if known else None
    return np.ma.masked_array(value, ~np.asarray(known))


def _traced_where(known: Any, values: Any) -> np.ndarray:
    array: Any = jnp.where(known, values, jnp.nan)
    # A traced array of JAX stands for one of NumPy.
    return array


def integral(run: Run, total: Any, first: Any, last: Any) -> np.ndarray:
    """The integral over the run by the trapezoidal rule, [n] or [runs n].

    - `run`: whose period it is.
    - `total`: the sum over all samples.
    - `first`, `last`: the first and the last sample, of which half counts.
    """
    return array_of(run.period)[..., None] * (array_of(total) - 0.5 * (array_of(first) + array_of(last)))


def short_names(names: Sequence[str]) -> list[str]:
    """The names without the words that all of them begin or end with: `panda_joint1` is `joint1`.

    A name that would be left without a letter keeps its words.

    - `names`: of the joints.
    """
    before = _shared(names)
    after = _shared([name[::-1] for name in names])
    for start, end in ((before, after), (before, 0), (0, after)):
        short = [name[start : len(name) - end] for name in names]
        if all(re.search("[^\\W\\d_]", name) for name in short):
            return short
    return list(names)


def _shared(names: Sequence[str]) -> int:
    """Length of the words that all names begin with, including the separator."""
    words = [re.findall("[^ _/.-]*[ _/.-]+", name) for name in names]
    alike = takewhile(lambda same: len(set(same)) == 1, zip(*words, strict=False)) if len(names) > 1 else ()
    return sum(len(same[0]) for same in alike)
