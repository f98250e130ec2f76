"""Runs of a scenario with other parameter values, and derivatives of its metrics.

Parameters are named by their dotted path in the scenario, such as `scheme.surface.k1`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from slidax.analysis.metric import Metric
from slidax.analysis.metrics import METRICS, TOLERANCE_METRICS, TOOL_METRICS
from slidax.core.errors import DefinitionError, nearest_word
from slidax.scenarios.family import Family
from slidax.scenarios.scenario import Scenario
from slidax.scenarios.uncertain_values import leaf_of
from slidax.scenarios.uncertainty import AbstractSet, Discrete
from slidax.simulation.run import Run
from slidax.simulation.simulate import Parts, value_and_gradient

from .cases import Cases

DIFFERENTIABLE = {item.key: item for item in (*METRICS, *TOLERANCE_METRICS, *TOOL_METRICS) if not item.counts}
"""Metrics that `grad` differentiates by key: all except those that count samples and those of the monitor."""


def sweep(scenario: Scenario, values: Mapping[str, Any], *, log_every: int | None = None) -> Run:
    """Simulate a scenario once for each set of parameter values, and return all runs as one batched `Run`.

        runs = scenario.sweep({"scheme.surface.k1": [0.1, 0.2, 0.4]})

    - `values`: an array for each dotted path of a parameter, whose first axis is the run; all have the same length.
    - `log_every`: n to log every n-th sample; None for no log.

    Raises DefinitionError if a path does not exist, the arrays differ in length, a value is out of its range, or a
    parameter is compiled into the simulation loop and so cannot vary between the runs, such as the period. It is also
    raised for a scenario that `Scenario.replace` changed.
    """
    arrays = {path: np.asarray(array) for path, array in values.items()}
    counts = {path: len(array) if array.ndim else 0 for path, array in arrays.items()}
    if not counts or len(set(counts.values())) != 1 or 0 in counts.values():
        lengths = ", ".join(f"`{path}`: {count}" for path, count in counts.items()) or "none"
        raise DefinitionError(f"every path needs the same number of values, at least one; got {lengths}")
    _require_unchanged(scenario)
    family = _family(scenario, {path: array.tolist() for path, array in arrays.items()})
    return Cases(family).batch(_by_full_path(family, arrays), log_every)


def grad(
    scenario: Scenario, metric: str | Metric[Any] | Callable[[Run], Any], path: str | Sequence[str]
) -> tuple[float, Any]:
    """Return a metric of the scenario's run, for the worst joint, and its derivative with respect to a parameter.

        error, slope = scenario.grad("steady_error", "scheme.surface.k1")

    - `metric`: key of a metric, a metric, or a function that maps a run to a number or an array, whose largest entry is
      differentiated.
    - `path`: dotted path of a parameter, or a list of paths; for a list the derivatives are a mapping by path.

    Raises DefinitionError if the metric has no derivative, a path does not exist, or the parameter is compiled into the
    simulation loop, such as the period. It is also raised for a scenario that `Scenario.replace` changed.
    """
    paths = [path] if isinstance(path, str) else list(path)
    if isinstance(metric, str):
        if metric not in DIFFERENTIABLE:
            raise DefinitionError(
                f"there is no metric with a derivative `{metric}`; {nearest_word(metric, DIFFERENTIABLE)}"
            )
        metric = DIFFERENTIABLE[metric]
    measured = metric
    _require_unchanged(scenario)
    family = _family(scenario, {each: [_own(scenario, each)] for each in paths})
    at = _by_full_path(family, {each: np.asarray(_own(scenario, each), float) for each in paths})
    templates = family.templates(at)
    varies = family.traceable(templates, {full: value[None] for full, value in at.items()})
    fixed = [full for full in at if not varies[full]]
    if fixed:
        raise DefinitionError(
            f"`{fixed[0]}` is compiled into the simulation loop: no metric has a derivative with respect to it"
        )

    def worst(run: Run) -> Any:
        result = jnp.asarray(measured(run))
        larger_is_better = isinstance(measured, Metric) and not measured.least_is_best
        return jnp.min(result) if larger_is_better else jnp.max(result)

    def parts(varied: Any) -> Parts:
        # Numbers that do not depend on the values are computed, and checked, during the trace.
        with jax.ensure_compile_time_eval():
            return family.parts(templates, varied)

    value, slopes = value_and_gradient(
        worst,
        parts,
        at,
        t1=scenario.t1,
        stepping=scenario.stepping,
        log_every=None if isinstance(measured, Metric) else 1,
    )
    derivatives = dict(zip(paths, (np.asarray(slopes[full]) for full in at), strict=True))
    plain = {each: float(slope) if slope.ndim == 0 else slope for each, slope in derivatives.items()}
    return float(value), plain[path] if isinstance(path, str) else plain


TRUE = ("start", "disturbance")
"""Blocks of a scenario with values that the law does not know."""


def _family(scenario: Scenario, choices: Mapping[str, list[Any]]) -> Family:
    """Return the family of scenarios with these choices by path, sorted: a family checks only the ends of a choice."""
    sets: dict[bool, dict[str, AbstractSet]] = {True: {}, False: {}}
    for path, choice in choices.items():
        ordered = sorted(choice, key=lambda value: np.ravel(value).tolist())
        sets[path.split(".")[0] in TRUE][path] = Discrete.model_validate({"choice": ordered})
    return Family.of(scenario.description, sets[True], sets[False])


def _by_full_path(family: Family, arrays: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return the arrays by the family's full paths; the paths in `arrays` may be shortened."""
    true = [path for path in arrays if path.split(".")[0] in TRUE]
    places = dict(zip(true, family.uncertain.sets, strict=True))
    places |= dict(zip((path for path in arrays if path not in true), family.varied.sets, strict=True))
    return {places[path]: array for path, array in arrays.items()}


def _own(scenario: Scenario, path: str) -> Any:
    """Return the scenario's own value at a path."""
    return leaf_of(scenario.description, path, scenario.controller.joints).own_value("grad").tolist()


def _require_unchanged(scenario: Scenario) -> None:
    if scenario.changed:
        raise DefinitionError(
            f"`replace` changed {', '.join(f'`{name}`' for name in scenario.changed)}, which no path describes: use "
            "`scenario.set` in place of `replace`, or `simulate_batch` and `value_and_gradient`"
        )
