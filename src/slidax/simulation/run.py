"""Run: the result of a simulation, its log as columns or a data frame, and its overview as text and HTML."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from importlib import import_module
from typing import Any, Literal, NamedTuple, TypeAlias

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from slidax.core.errors import DefinitionError, count_noun, is_traced
from slidax.core.types import Envelope, Reference, Scalar, State

from .outcome import Excursion, Fault, Outcome, describe_outcome
from .plant import FreeBody
from .tally import Tally, Windows

PER = {"q": "", "dq": "/s", "q_d": "", "dq_d": "/s", "ddq_d": "/s²", "e": "", "lower": "", "upper": ""}
"""Suffixes to the unit of a joint's position."""


def columns_of(run: Run, labels: Sequence[str]) -> dict[str, tuple[np.ndarray, str]]:
    """Return the columns of a single run's log by name, each with its unit: sample, time, state, reference, error, ...

    - `labels`: suffix of the column names for each joint, such as `_1` for `q_1`.

    Raises DefinitionError for a run without a log, and for a batch.
    """
    log = run.log
    if log is None:
        raise DefinitionError("this run has no log: simulate with `log_every=1`")
    if run.period.ndim:
        raise DefinitionError(f"a batch of {len(run)} runs has no single log: take one run, such as `runs[0]`")
    groups: dict[str, Any] = {
        "q": log.state.q,
        "dq": log.state.dq,
        "q_d": log.reference.q,
        "dq_d": log.reference.dq,
        "ddq_d": log.reference.ddq,
        "e": log.e,
        "tau": log.tau,
    }
    if log.envelope is not None:
        groups |= {"lower": log.envelope.lower, "upper": log.envelope.upper}
    groups |= log.signals
    columns = {"k": (np.asarray(log.k), ""), "t": (np.asarray(log.t), "s")}
    for name, array in groups.items():
        values = np.asarray(array)
        if values.ndim == 1:
            columns[name] = values, ""
            continue
        flat = values.reshape(len(values), -1)
        wide = labels if flat.shape[1] == len(labels) else [f"_{k + 1}" for k in range(flat.shape[1])]
        for k, label in enumerate(wide):
            columns[f"{name}{label}"] = flat[:, k], _unit(name, run, k)
    return columns


def _unit(name: str, run: Run, joint: int) -> str:
    if name == "tau":
        return run.torque_units[joint]
    return run.joint_units[joint] + PER[name] if name in PER else ""


Kind = Literal["pandas", "polars"]
"""Library of the data frame."""

KINDS = ("pandas", "polars")


def data_frame(columns: Mapping[str, Any], kind: Kind = "pandas", units: Mapping[str, str] | None = None) -> Any:
    """Return a data frame from columns of equal length. pandas keeps the units in `attrs`; polars drops them.

    - `columns`, `units`: values and units by the column's name.
    - `kind`: library of the data frame.

    Raises DefinitionError if the library is unknown or not installed.
    """
    if kind not in KINDS:
        raise DefinitionError(f'the kind of a data frame must be "pandas" or "polars"; got "{kind}"')
    try:
        if kind == "polars":
            import polars

            return polars.DataFrame({name: _flat(values) for name, values in columns.items()})
        import pandas
    except ImportError:
        raise DefinitionError(
            f"a data frame of {kind} needs {kind}, which is not installed: pip install 'slidax[frame]'"
        ) from None
    frame = pandas.DataFrame(dict(columns))
    if units is not None:
        frame.attrs["units"] = dict(units)
    return frame


def _flat(values: Any) -> Any:
    return np.ascontiguousarray(values) if isinstance(values, np.ndarray) else list(values)


AnyArray: TypeAlias = Array | np.ndarray
"""A JAX array inside a transformation, a NumPy array in a finished run."""


class Log(eqx.Module):
    """Logged samples; every array has the sample as its first axis.

    - `k`: number of the sample.
    - `t`: time [s].
    - `state`: the true state, not the measured one.
    - `reference`, `envelope`: the controller's reference and envelope; `envelope` is None for a scheme without one.
    - `tau`: torque command within the actuator's limits, before its dead time and lag [N m or N]; if the measurement
      was lost, the previous command.
    - `signals`: the controller's internal quantities by name. If the measurement was lost, they belong to a command
      that was not applied.
    - `valid`: False for rows after the end of the run, which only a batch or a traced run has.
    """

    k: Int[AnyArray, "..."]
    t: Float[AnyArray, "..."]
    state: State
    reference: Reference
    tau: Float[AnyArray, "..."]
    signals: Mapping[str, Float[AnyArray, "..."]]
    envelope: Envelope | None
    valid: Bool[AnyArray, "..."]

    @property
    def e(self) -> Float[AnyArray, "..."]:
        """Error `q - q_d`, rad or m."""
        return self.state.q - self.reference.q

    @property
    def de(self) -> Float[AnyArray, "..."]:
        """Velocity error `q̇ - q̇_d`, rad/s or m/s."""
        return self.state.dq - self.reference.dq

    def without_padding(self) -> Log:
        """Return the log of a single run, with its valid samples only."""
        valid = np.asarray(self.valid)
        return jax.tree.map(lambda x: np.asarray(x)[valid], self)


class RunTiming(NamedTuple):
    """Computing time of a run.

    - `compile_s`: time for tracing and compiling [s]; near 0 for the second run with equal shapes.
    - `run_s`: time for the run itself [s].
    """

    compile_s: float
    run_s: float


class Run(eqx.Module):
    """A finished simulation, or a batch from `simulate_batch`, whose arrays have the run as their first axis.

    A batch has a length, `runs[i]` is one of its runs, and `for run in runs` iterates over them.

    - `log`: the logged samples; None without a log.
    - `tally`: statistics of all samples, from which the metrics are computed.
    - `windows`: time windows of the statistics, and the settling bands.
    - `fault`: the first fault, as arrays; see `outcome`.
    - `excursion`: samples outside the envelope, as arrays; None if the first of them ends a run.
    - `state`: the true state at the last sample without a fault.
    - `period`: time between samples [s].
    - `t1`: requested end [s].
    - `joint_units`: unit of each joint's position, "rad" or "m".
    - `joint_names`: name of each joint.
    - `has_envelope`: True if the scheme has an envelope.
    - `timing`: computing time; None for a batch, and inside a transformation.
    - `load`: motion of a released payload; only with a `MujocoPlant`.
    """

    log: Log | None
    tally: Tally
    windows: Windows
    fault: Fault
    excursion: Excursion | None
    state: State
    period: Scalar
    t1: Scalar
    joint_units: tuple[str, ...] = eqx.field(static=True)
    joint_names: tuple[str, ...] = eqx.field(static=True)
    has_envelope: bool = eqx.field(static=True)
    timing: RunTiming | None = eqx.field(static=True, default=None)
    load: FreeBody | None = None

    @property
    def plot(self) -> Any:
        """Figures of the run: `run.plot.errors()`, `run.plot.errors(ax=ax)`, `run.plot.torques()` and others."""
        return import_module("slidax.report.figures.run_plots").RunPlots(self)

    @property
    def joints(self) -> int:
        return len(self.joint_units)

    @property
    def torque_units(self) -> tuple[str, ...]:
        """Unit of each joint's torque: "N m" for a revolute joint, "N" for a prismatic one."""
        return tuple("N m" if unit == "rad" else "N" for unit in self.joint_units)

    @property
    def outcome(self) -> Outcome:
        """Outcome of a single run.

        Raises DefinitionError for a batch, which has `outcomes`, and inside a JAX transformation.
        """
        if self.period.ndim:
            raise DefinitionError(
                f"a batch of {len(self)} runs has no single outcome: read `outcomes`, or `outcome` of one run, such as "
                "`runs[0]`"
            )
        if is_traced(self.fault):
            raise DefinitionError("inside `jit`, `vmap` and `grad` there is no outcome yet: read `fault`")
        return describe_outcome(
            self.fault,
            self.excursion,
            int(self.tally.violations),
            float(self.period),
            self.joint_units,
            self.joint_names,
        )

    @property
    def outcomes(self) -> list[Outcome]:
        """Outcome of each run; one entry for a single run."""
        if not self.period.ndim:
            return [self.outcome]
        ends = jax.tree.map(np.asarray, (self.fault, self.excursion, self.tally.violations, self.period))
        each = (jax.tree.map(lambda x, k=k: x[k], ends) for k in range(len(self)))
        return [
            describe_outcome(fault, excursion, int(outside), float(period), self.joint_units, self.joint_names)
            for fault, excursion, outside, period in each
        ]

    def __len__(self) -> int:
        """Number of runs in a batch."""
        if not self.period.ndim:
            raise TypeError("a single run has no length; `simulate_batch` returns a batch")
        return int(self.period.shape[0])

    def __bool__(self) -> bool:
        """True for every outcome, so that a run never counts as empty."""
        return True

    def __getitem__(self, which: int | slice) -> Run:
        """Return one run of a batch, with its valid samples only, or several runs for a slice."""
        if isinstance(which, slice):
            return _select(self, which)
        count = len(self)
        if not -count <= which < count:
            raise IndexError(f"there are {count} runs; got {which}")
        run = _select(self, which)
        if run.log is None or run.period.ndim or is_traced(run.log):
            return run
        return eqx.tree_at(lambda run: run.log, run, run.log.without_padding())

    def __iter__(self) -> Iterator[Run]:
        return (self[k] for k in range(len(self)))

    def __repr__(self) -> str:
        return as_text(self) if self._is_known else eqx.tree_pformat(self)

    def _repr_html_(self) -> str | None:
        """HTML for a notebook."""
        return as_html(self) if self._is_known else None

    @property
    def _is_known(self) -> bool:
        kind = self.fault.kind
        return isinstance(kind, jax.Array | np.ndarray | np.generic) and not is_traced(self) and self.period.ndim < 2

    def frame(self, kind: Kind = "pandas", joints: Literal["names", "numbers"] = "names") -> Any:
        """Return the log as a data frame, with a row per sample and columns such as `q[panda_joint1]`.

        The units of a pandas data frame are in its `attrs`.

        - `joints`: "names" for `q[panda_joint1]`, "numbers" for `q_1`, as in Parquet logs.

        Raises DefinitionError without a log, for a batch, or if the library is not installed.
        """
        columns = self._columns(joints)
        units = {name: unit for name, (_, unit) in columns.items()}
        return data_frame({name: values for name, (values, _) in columns.items()}, kind, units)

    def units(self, joints: Literal["names", "numbers"] = "names") -> dict[str, str]:
        """Return the units of the columns of `frame`, by name. Raises DefinitionError as `frame` does."""
        return {name: unit for name, (_, unit) in self._columns(joints).items()}

    def _columns(self, joints: str) -> dict[str, tuple[np.ndarray, str]]:
        if joints not in ("names", "numbers"):
            raise DefinitionError(f'`joints` must be "names" or "numbers"; got "{joints}"')
        named = joints == "names"
        return columns_of(self, [f"[{name}]" if named else f"_{k + 1}" for k, name in enumerate(self.joint_names)])


def _select(run: Run, which: int | slice) -> Run:
    # NumPy takes the slices, since JAX would compile a slice for each shape.
    return jax.tree.map(lambda x: x[which] if is_traced(x) else np.asarray(x)[which, ...], run)


WIDTH, HEIGHT, POINTS = 640, 70, 640
"""Size of one joint's panel in pixels, and the largest number of drawn samples."""


def sketch(run: Run) -> str:
    """Draw each joint's error and envelope over time in a panel, as SVG; empty for a run without a log."""
    log = run.log
    if log is None or not len(log.t):
        return ""
    thin = slice(None, None, -(-len(log.t) // POINTS))
    t, e = np.asarray(log.t)[thin], np.asarray(log.e)[thin]
    bounds = None
    if log.envelope is not None:
        bounds = np.stack([np.asarray(log.envelope.lower)[thin], np.asarray(log.envelope.upper)[thin]])
    x = WIDTH * t / max(float(run.t1), 1e-300)
    panels = []
    for joint, (name, unit) in enumerate(zip(run.joint_names, run.joint_units, strict=True)):
        extremes = e[:, joint] if bounds is None else np.concatenate([e[:, joint], *bounds[..., joint]])
        size = max(float(np.abs(extremes).max()), 1e-300)

        def points(x: np.ndarray, y: np.ndarray, size: float = size) -> str:
            return " ".join(f"{a:.1f},{HEIGHT / 2 * (1 - b / size):.1f}" for a, b in zip(x, y, strict=True))

        band = ""
        if bounds is not None:
            around = points(np.append(x, x[::-1]), np.append(bounds[0, :, joint], bounds[1, ::-1, joint]))
            band = f'<polygon points="{around}" fill="#E9EEF4" stroke="#6B7785" stroke-width=".6"/>'
        line = f'<polyline points="{points(x, e[:, joint])}" fill="none" stroke="#0072B2"/>'
        label = f'<text x="{WIDTH - 4}" y="12" text-anchor="end">{escape(name)}: error up to {size:.3g} {unit}</text>'
        panels.append(f'<g transform="translate(0 {joint * (HEIGHT + 8)})">{band}{line}{label}</g>')
    height = len(panels) * (HEIGHT + 8)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" '
        f'font-size="11" font-family="sans-serif">{"".join(panels)}</svg>'
    )


SETTLED = 1e-3
"""Error band of the table's settling times, rad or m; the table has them if the run has this band."""

Rows = list[list[str]]
"""Rows of a table's cells: headings in the first row, joints in the first column."""


def heading(run: Run) -> str:
    """Return a line with the number of joints, the duration, the period and the outcome of a run or a batch."""
    many = run.period.ndim > 0
    period, t1 = float(np.ravel(run.period)[0]), float(np.ravel(run.t1)[0])
    kinds = Counter(outcome.kind for outcome in run.outcomes)
    ends = ", ".join(f"{count} {kind}" for kind, count in kinds.items()) if many else next(iter(kinds))
    what = count_noun(len(run), "run") if many else "Run"
    return f"{what} of {count_noun(run.joints, 'joint')} to {t1:g} s, sampled every {period:g} s: {ends}"


def remarks(run: Run) -> list[str]:
    """Return sentences on at most three bad outcomes, on samples outside the bounds, and on the computing time."""
    remarks = [outcome.message for outcome in run.outcomes if not outcome.ok][:3]
    if run.has_envelope:
        outside, samples = int(np.sum(run.tally.violations)), int(np.sum(run.tally.samples))
        remarks.append(f"Samples outside the envelope: {outside} of {samples}.")
    if run.tally.tolerance is not None:
        outside, samples = int(np.sum(run.tally.tolerance.outside)), int(np.sum(run.tally.samples))
        remarks.append(f"Samples outside the tolerance band: {outside} of {samples}.")
    if run.timing is not None:
        remarks.append(f"Simulated in {run.timing.run_s:.3g} s, after {run.timing.compile_s:.3g} s to compile.")
    return remarks


def table(run: Run) -> Rows:
    """Return a table with the main results of each joint and their units; for a batch, the worst of its runs."""
    tally, windows = run.tally, run.windows
    many = tuple(range(np.ndim(run.period)))
    samples = np.expand_dims(np.asarray(tally.samples), -1)
    steady = np.expand_dims(np.asarray(windows.steady), -1)
    period = np.expand_dims(np.asarray(run.period), -1)
    columns = [
        ("steady error", np.where(samples > steady, tally.steady_error, np.nan), ""),
        ("peak torque", np.where(samples > 0, tally.peak_torque, np.nan), "torque"),
        ("torque step, steady", np.where(samples > steady + 1, tally.steady_step, np.nan), "torque"),
    ]
    band = np.flatnonzero(np.isclose(np.reshape(windows.bands, (-1, np.shape(windows.bands)[-1]))[0], SETTLED))
    if band.size:
        last = np.asarray(tally.last_above)[..., band[0], :]
        settled = np.where(last < samples - 1, np.maximum(last, 0) * period, np.nan)
        columns.insert(0, (f"settled to {SETTLED:g}", settled, "s"))
    worst = [(name, np.max(values, axis=many), unit) for name, values, unit in columns]
    if run.has_envelope:
        worst.append(("envelope margin", np.min(np.asarray(tally.margin), axis=many), "of its width"))
    rows = [["worst" if many else "", *(name for name, *_ in worst)]]
    for joint, (name, unit, torque) in enumerate(zip(run.joint_names, run.joint_units, run.torque_units, strict=True)):
        units = {"": unit, "torque": torque}
        rows.append([name, *(_cell(values[joint], units.get(of, of)) for _, values, of in worst)])
    return rows


def _cell(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}" if np.isfinite(value) else "-"


def as_text(run: Run) -> str:
    """Return the overview for a terminal."""
    rows = table(run)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for first, *cells in rows:
        numbers = [cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True)]
        lines.append("  ".join([first.ljust(widths[0]), *numbers]))
    return "\n".join([heading(run), *lines, *remarks(run)])


def as_html(run: Run) -> str:
    """Return the overview for a notebook, with a figure of the errors for a single run."""
    head, *body = [[escape(cell) for cell in row] for row in table(run)]
    rows = ["<tr>" + "".join(f"<th>{cell}</th>" for cell in head) + "</tr>"]
    rows += [f"<tr><th>{row[0]}</th>" + "".join(f"<td>{cell}</td>" for cell in row[1:]) + "</tr>" for row in body]
    sentences = "<br>".join(escape(line) for line in remarks(run))
    picture = "" if run.period.ndim else sketch(run)
    return f"<p><b>{escape(heading(run))}</b></p><table>{''.join(rows)}</table><p>{sentences}</p>{picture}"
