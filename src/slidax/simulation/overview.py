"""Overview of a run as text and HTML: its outcome, and each joint's main results."""

from __future__ import annotations

from collections import Counter
from html import escape

import numpy as np

from slidax._errors import counted

from .run import Run
from .sketch import sketch

SETTLED = 1e-3
"""Error band of the column of settling times, rad or m, if it is one of the run's bands."""

Rows = list[list[str]]
"""A table with heads in its first row and joints in its first column."""


def heading(run: Run) -> str:
    """One line with the joints, the duration, the period and the outcome of one or many runs."""
    many = run.period.ndim > 0
    period, t1 = float(np.ravel(run.period)[0]), float(np.ravel(run.t1)[0])
    kinds = Counter(outcome.kind for outcome in run.outcomes)
    ends = ", ".join(f"{count} {kind}" for kind, count in kinds.items()) if many else next(iter(kinds))
    what = counted(len(run), "run") if many else "Run"
    return f"{what} of {counted(run.joints, 'joint')} to {t1:g} s, sampled every {period:g} s: {ends}"


def remarks(run: Run) -> list[str]:
    """Sentences on bad outcomes, violations and computing time."""
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
    """Each joint's main results with units; the worst of many runs."""
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
    """The overview for a terminal."""
    rows = table(run)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for first, *cells in rows:
        numbers = [cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True)]
        lines.append("  ".join([first.ljust(widths[0]), *numbers]))
    return "\n".join([heading(run), *lines, *remarks(run)])


def as_html(run: Run) -> str:
    """The overview for a notebook, with a picture of a single run's errors."""
    head, *body = [[escape(cell) for cell in row] for row in table(run)]
    rows = ["<tr>" + "".join(f"<th>{cell}</th>" for cell in head) + "</tr>"]
    rows += [f"<tr><th>{row[0]}</th>" + "".join(f"<td>{cell}</td>" for cell in row[1:]) + "</tr>" for row in body]
    sentences = "<br>".join(escape(line) for line in remarks(run))
    picture = "" if run.period.ndim else sketch(run)
    return f"<p><b>{escape(heading(run))}</b></p><table>{''.join(rows)}</table><p>{sentences}</p>{picture}"
