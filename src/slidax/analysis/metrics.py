"""Metrics of a run's error, torque, envelope, tolerance band, tool and monitor; all as a summary or a data frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from slidax.core.errors import DefinitionError, is_traced
from slidax.core.files import json_value
from slidax.simulation.run import Kind, Run, data_frame

from .metric import Metric, array_of, arrays, counting_error, integral, known_values, metric, safe_sqrt, value_of_run

BRIEF_BANDS = (1e-3, 1e-5)
"""The settling bands of the short comparison on a terminal, rad or m."""


def settling_time(run: Run, band: float) -> np.ndarray:
    """Last sample time with the position error |e| above the band [n], s; 0 without one, the run's end if not settled.

    - `band`: one of the run's settling bands, rad or m.

    Raises DefinitionError if the run has no such band, or is traced.
    """
    if is_traced(run.tally):
        raise counting_error("settling_time")
    bands = _bands(run)
    match = np.flatnonzero(np.isclose(bands, band, rtol=1e-9, atol=0.0))
    if not len(match):
        known = ", ".join(f"{b:g}" for b in bands)
        remedy = f"simulate with `bands=({band:g},)`"
        raise DefinitionError(f"the run has no settling band {band:g}, only {known}; {remedy}")
    last = np.maximum(array_of(run.tally.last_above)[..., match[0], :], 0)
    # Rounded to a picosecond: 7614 periods of 1e-4 s are 0.7614 s, not 0.7614000000000001 s.
    return np.round(last * array_of(run.period)[..., None], 12)


def settling_times(run: Run) -> tuple[Metric[np.ndarray], ...]:
    """Return a settling-time metric for each of the run's settling bands."""

    def settled(run: Run, band: float) -> np.ndarray:
        """Last sample time with |e| above the band."""
        return settling_time(run, band)

    metrics = []
    for band in _bands(run):
        function = partial(settled, band=float(band))
        function.__doc__ = settled.__doc__
        brief = bool(np.isclose(band, BRIEF_BANDS, atol=0.0).any())
        name = _named(band)
        key, title = f"settling_time.{name}", f"settled to |e| <= {name}"
        metrics.append(Metric(key, title, "s", function, brief=brief, needs_settling=True, counts=True))
    return tuple(metrics)


@metric("steady error", "{position}", brief=True)
def steady_error(run: Run) -> np.ndarray | None:
    """`max |e|` over the last quarter of the run.

    e is the position error; one value per joint. None if the run ended before its last quarter.
    """
    return known_values(reached_last_quarter(run), array_of(run.tally.steady_error))


@metric("error, rms", "{position}")
def rms_error(run: Run) -> np.ndarray | None:
    """Root mean square of e over the run.

    e is the position error; one value per joint. None if the run has fewer than two samples.
    """
    tally = run.tally
    first, last = array_of(tally.first_error), array_of(tally.last_error)
    samples = array_of(tally.samples)
    duration = arrays(run).maximum(samples - 1, 1).astype(float) * array_of(run.period)
    mean = integral(run, tally.error_square, first**2, last**2) / duration[..., None]
    # For a run without motion, the difference of equal sums may round below zero.
    return known_values(samples > 1, safe_sqrt(arrays(run), mean))


@metric("integral of |e|", "{position} s", brief=True, bars=True)
def iae(run: Run) -> np.ndarray:
    """`∫ |e| dt` over the run.

    e is the position error; one value per joint. By the trapezoidal rule on all samples, so it does not depend
    on the period.
    """
    tally = run.tally
    total = array_of(tally.early_error) + array_of(tally.late_error)
    return integral(run, total, tally.first_error, tally.last_error)


def reached_last_quarter(run: Run) -> Any:
    """True if a run has samples in its last quarter, the window of steady values: [], for a batch [runs]."""
    return array_of(run.tally.samples) > array_of(run.windows.steady)


def _bands(run: Run) -> np.ndarray:
    return np.atleast_2d(run.windows.bands)[0]


def _named(band: float) -> str:
    """The band in the form `1e-3`."""
    mantissa, exponent = f"{band:e}".split("e")
    return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"


@metric("peak torque", "{torque}", brief=True)
def peak_torque(run: Run) -> np.ndarray:
    """`max |τ|` over the run, one value per joint."""
    return array_of(run.tally.peak_torque)


@metric("initial torque", "{torque}")
def initial_torque(run: Run) -> np.ndarray:
    """`|τ(0)|`, the torque of the first sample, one value per joint."""
    return abs(array_of(run.tally.first_torque))


@metric("torque step, max", "{torque}", brief=True)
def max_torque_step(run: Run) -> np.ndarray:
    """`max |τ(k+1) - τ(k)|` over the run, one value per joint."""
    return array_of(run.tally.max_step)


@metric("torque step, steady", "{torque}", brief=True)
def steady_torque_step(run: Run) -> np.ndarray | None:
    """`max |τ(k+1) - τ(k)|` over the last quarter of the run.

    One value per joint. None if the run ended before its last quarter.
    """
    return known_values(reached_last_quarter(run), array_of(run.tally.steady_step))


@metric("torque step, steady, rms", "{torque}")
def steady_torque_step_rms(run: Run) -> np.ndarray | None:
    """Root mean square of `τ(k+1) - τ(k)` over the last quarter of the run.

    One value per joint. None if the run ended before its last quarter.
    """
    xp = arrays(run)
    steps = array_of(run.tally.samples) - 1 - array_of(run.windows.steady)
    square = array_of(run.tally.steady_square) / xp.maximum(steps, 1).astype(float)[..., None]
    return known_values(reached_last_quarter(run), safe_sqrt(xp, square))


@metric("torque energy", "({torque})² s", brief=True, bars=True)
def torque_energy(run: Run) -> np.ndarray:
    """`∫ τ² dt` over the run.

    By the trapezoidal rule on all samples, one value per joint. The heat in a motor's winding is proportional to it.
    """
    first, last = array_of(run.tally.first_torque), array_of(run.tally.last_torque)
    return integral(run, run.tally.torque_square, first**2, last**2)


@metric("torque travel", "{torque}", brief=True, bars=True)
def torque_travel(run: Run) -> np.ndarray:
    """`Σ |τ(k+1) - τ(k)|` over the run, the total variation of the torque.

    For a continuous torque it does not depend on the period; with chattering it grows as the period shrinks.
    """
    return array_of(run.tally.torque_travel)


@metric("samples outside the envelope", "", per_joint=False, counts=True)
def envelope_violations(run: Run) -> np.ndarray | int | None:
    """Number of samples with a joint at or outside its envelope; None for a scheme without one."""
    if not run.has_envelope:
        return None
    violations = array_of(run.tally.violations)
    return violations if violations.ndim else int(violations)


@metric("envelope margin", "of its width", least_is_best=False)
def envelope_margin(run: Run) -> np.ndarray | None:
    """Least distance to the nearer bound over the run, relative to the envelope's width.

    None for a scheme without an envelope, and for a run without a valid first sample.
    """
    return known_values(array_of(run.tally.samples) > 0, array_of(run.tally.margin)) if run.has_envelope else None


@metric("margin of the guarantee", "", per_joint=False, least_is_best=False)
def guarantee_margin(run: Run) -> np.ndarray | float | None:
    """Least relative margin of the monitored guarantee over the run; negative if it fails; None without a monitor.

    The law's monitor checks the assumptions of the envelope's guarantee at each sample, and reports their margin.
    """
    if run.tally.promise is None:
        return None
    margin = array_of(run.tally.promise.margin)
    return value_of_run(arrays(run).isfinite(margin), margin)


@metric("first warning of the monitor", "s", per_joint=False, least_is_best=False, counts=True)
def warned_at(run: Run) -> np.ndarray | float | None:
    """Time of the first warning by the law's monitor [s]; None if there was none, or without a monitor."""
    if run.tally.promise is None:
        return None
    warned = array_of(run.tally.promise.warned)
    return value_of_run(warned >= 0, warned * array_of(run.period))


@metric("samples outside the tolerance band", "", per_joint=False, counts=True)
def tolerance_violations(run: Run) -> np.ndarray | int | None:
    """Number of samples with a joint at or outside the tolerance band; None for a run without one."""
    if run.tally.tolerance is None:
        return None
    outside = array_of(run.tally.tolerance.outside)
    return outside if outside.ndim else int(outside)


@metric("tolerance margin", "of its width", least_is_best=False)
def tolerance_margin(run: Run) -> np.ndarray | None:
    """Least distance to the nearer bound over the run, relative to the band's width; below 0 outside.

    None for a run without a tolerance band, and for a run whose first state is not finite.
    """
    if run.tally.tolerance is None:
        return None
    margin = array_of(run.tally.tolerance.margin)
    return known_values(arrays(run).isfinite(margin).all(axis=-1), margin)


@metric("tool error", "m", per_joint=False)
def tool_error(run: Run) -> np.ndarray | float | None:
    """Largest distance of the tip from its reference position [m]; None without a tool path."""
    if run.tally.tool is None:
        return None
    return value_of_run(array_of(run.tally.samples) > 0, array_of(run.tally.tool.position.error))


@metric("steady tool error", "m", per_joint=False)
def steady_tool_error(run: Run) -> np.ndarray | float | None:
    """Largest distance of the tip from its reference position over the last quarter of the run [m].

    None without a tool path, and if the run ended before its last quarter.
    """
    if run.tally.tool is None:
        return None
    return value_of_run(reached_last_quarter(run), array_of(run.tally.tool.position.steady))


@metric("tool error, rms", "m", per_joint=False)
def rms_tool_error(run: Run) -> np.ndarray | float | None:
    """Root mean square distance of the tip from its reference position [m]; None without a tool path."""
    if run.tally.tool is None:
        return None
    samples = array_of(run.tally.samples)
    return value_of_run(samples > 0, _rms(run, run.tally.tool.position.square))


@metric("tool rotation error", "rad", per_joint=False)
def tool_turn(run: Run) -> np.ndarray | float | None:
    """Largest rotation angle between the tool and its reference orientation [rad].

    None without a tool path, and for a robot without an orientation of its tip.
    """
    turn = None if run.tally.tool is None else run.tally.tool.rotation
    return None if turn is None else value_of_run(array_of(run.tally.samples) > 0, array_of(turn.error))


@metric("steady tool rotation error", "rad", per_joint=False)
def steady_tool_turn(run: Run) -> np.ndarray | float | None:
    """Largest rotation angle between the tool and its reference over the last quarter of the run [rad].

    None as for `tool_turn`, and if the run ended before its last quarter.
    """
    turn = None if run.tally.tool is None else run.tally.tool.rotation
    return None if turn is None else value_of_run(reached_last_quarter(run), array_of(turn.steady))


@metric("tool rotation error, rms", "rad", per_joint=False)
def rms_tool_turn(run: Run) -> np.ndarray | float | None:
    """Root mean square rotation angle between the tool and its reference [rad]; None as for `tool_turn`."""
    turn = None if run.tally.tool is None else run.tally.tool.rotation
    if turn is None:
        return None
    samples = array_of(run.tally.samples)
    return value_of_run(samples > 0, _rms(run, turn.square))


def _rms(run: Run, square: Any) -> Any:
    """Root mean square from a sum of squares over all samples."""
    xp = arrays(run)
    return safe_sqrt(xp, array_of(square) / xp.maximum(array_of(run.tally.samples), 1).astype(float))


METRICS: tuple[Metric[Any], ...] = (
    steady_error,
    rms_error,
    iae,
    peak_torque,
    initial_torque,
    max_torque_step,
    steady_torque_step,
    steady_torque_step_rms,
    torque_energy,
    torque_travel,
    envelope_violations,
    envelope_margin,
)
"""Metrics of every run, in the order of tables. Settling times are not among them: they depend on the run's bands."""

TOLERANCE_METRICS: tuple[Metric[Any], ...] = (tolerance_violations, tolerance_margin)
"""Metrics of a run with a tolerance band."""


TOOL_METRICS: tuple[Metric[Any], ...] = (
    tool_error,
    steady_tool_error,
    rms_tool_error,
    tool_turn,
    steady_tool_turn,
    rms_tool_turn,
)
"""Additional metrics of a run along a tool path; rotations only if the robot defines its tip's orientation."""


MONITOR_METRICS: tuple[Metric[Any], ...] = (guarantee_margin, warned_at)
"""Additional metrics of a run whose law has a monitor."""


def metrics_of(run: Run) -> tuple[Metric[Any], ...]:
    """Every metric of a run, the settling times first."""
    optional = (
        *(metric for metric in TOOL_METRICS if metric(run) is not None),
        *(TOLERANCE_METRICS if run.tally.tolerance is not None else ()),
        *(MONITOR_METRICS if run.tally.promise is not None else ()),
    )
    return (*settling_times(run), *METRICS, *optional)


def summary(run: Run, also: Sequence[Metric[Any]] = ()) -> dict[str, Any]:
    """Return all metrics of a run or a batch by key, as numbers and nested lists.

    A metric per joint is a list with an entry for each joint. For a batch the outer list has an entry for each run.
    Missing and infinite values are None.

    - `also`: further metrics, such as those of a paper.
    """
    values: dict[str, Any] = {}
    for item in (*metrics_of(run), *also):
        value = item(run)
        group, _, name = item.key.partition(".")
        entries = values.setdefault(group, {}) if name else values
        entries[name or group] = json_value(value)
    return values


def metrics_frame(runs: Run | Mapping[str, Run], kind: Kind = "pandas", also: Sequence[Metric[Any]] = ()) -> Any:
    """Return all metrics as a data frame: columns `run`, `metric`, `joint`, `unit`, `value`, a row for each value.

    `run` is the index of a run, from 0, or its name. `joint` is the joint's name, empty for a metric of the run.
    Missing values are NaN in pandas, null in polars.

    - `runs`: a run, a batch from `simulate_batch`, or several runs by name, such as one for each scheme.
    - `kind`: "pandas" or "polars".
    - `also`: further metrics, such as those of a paper.

    Raises DefinitionError if the library is unknown or not installed.
    """
    named = runs if isinstance(runs, Mapping) else _numbered(runs)
    rows = [row for name, run in named.items() for row in _rows(name, run, also)]
    names = ("run", "metric", "joint", "unit", "value")
    columns: dict[str, Any] = dict(zip(names, zip(*rows, strict=True) if rows else [()] * len(names), strict=True))
    if kind == "pandas":
        columns["value"] = np.array([np.nan if value is None else value for value in columns["value"]])
    return data_frame(columns, kind)


def _numbered(runs: Run) -> dict[int, Run]:
    return {0: runs} if not np.ndim(runs.period) else dict(enumerate(runs))


def _rows(name: Any, run: Run, also: Sequence[Metric[Any]]) -> list[tuple[Any, ...]]:
    rows: list[tuple[Any, ...]] = []
    for item in (*metrics_of(run), *also):
        if item.per_joint:
            each = zip(run.joint_names, item.units(run), item.shown(run), strict=True)
            rows += [(name, item.key, joint, unit, value) for joint, unit, value in each]
            continue
        value = item(run)
        number = None if value is None or not np.isfinite(value) else float(value)
        rows.append((name, item.key, "", item.units(run)[0], number))
    return rows
