"""The paper's printed values, and the rule for verdicts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from slidax.analysis.index_sums import DOI as DOI
from slidax.report.page import significant

from .examples import SCHEMES

TITLE = (
    "Approximate continuous fixed-time terminal sliding mode control with prescribed performance for uncertain "
    "robotic manipulators"
)
JOURNAL = "Nonlinear Dynamics (2022)"


@dataclass(frozen=True)
class Printed:
    """A quantity that the paper prints, with a value for each joint.

    - `quantity`: `settling_time`, `steady_error` or `peak_torque`.
    - `place`: place of the quantity in the paper.
    - `name`: name of the quantity in the paper.
    - `texts`: the values as printed, one per joint.
    - `compared_with`: description of the computed quantity.
    """

    quantity: str
    place: str
    name: str
    texts: tuple[str, ...]
    compared_with: str

    @property
    def values(self) -> tuple[float, ...]:
        """The values as numbers."""
        return tuple(float(text) for text in self.texts)


NAMES = {
    "settling_time": (
        "t_s, actual convergence time",
        "last time with |e| above a band that is not printed, here {band}",
    ),
    "steady_error": ("e_ρ, steady-state error", "largest |e| over the second half of the run"),
    "peak_torque": ("τ_max, maximum control torque", "largest |τ| over the run"),
}
"""Name of each column of Table 3, and description of the computed quantity."""


def _row(scheme: str, *columns: tuple[str, str, str]) -> tuple[Printed, ...]:
    band = significant(SCHEMES[scheme].band, 1)
    return tuple(
        Printed(quantity, "Table 3", name, texts, computed.format(band=band))
        for (quantity, (name, computed)), texts in zip(NAMES.items(), columns, strict=True)
    )


TABLE_3 = {
    "cftsmppc": _row(
        "cftsmppc", ("1.37", "1.35", "1.53"), ("4.92e-11", "6.90e-11", "2.21e-11"), ("12.19", "14.96", "15.17")
    ),
    "nftsmc": _row(
        "nftsmc", ("1.77", "1.47", "1.75"), ("1.89e-5", "1.52e-5", "5.25e-6"), ("39.62", "203.39", "100.52")
    ),
    "anftsmc": _row(
        "anftsmc", ("1.79", "1.47", "1.76"), ("2.81e-6", "4.21e-6", "2.60e-6"), ("26.24", "20.64", "39.44")
    ),
    "sfsmc": _row("sfsmc", ("2.20", "2.12", "2.35"), ("3.08e-4", "1.30e-4", "1.23e-4"), ("23.41", "29.04", "45.37")),
}
"""Table 3 by scheme."""

STEADY_LIMIT = "8e-11"
"""Section 4 on Fig. 7(b): "the convergence accuracy of the steady-state error satisfies |e_i| < 8 × 10⁻¹¹ even with
time-varying external disturbances"."""

ENERGY_SHARE = "8.84"
"""Section 4: the ECI of CFTSMPPC in percent of that of NFTSMC. (The sentence cites Fig. 12; the bars are Fig. 13.)"""

NOT_COVERED = (
    "Figs. 12 to 14: they show bars without values, so there is nothing to compare the computed values with.",
    "The curves of the figures: the paper has no data for them, so they can only be compared by eye.",
    "The laws of the rival schemes: the paper prints only their parameters. The laws come from their sources or were "
    "reconstructed, which may explain differences.",
)
"""Printed content that cannot be compared."""


REPRODUCED = 0.05
"""Largest relative deviation of a computed value that counts as reproduced."""

CLOSE = 0.20
"""Largest relative deviation that counts as close; a larger one differs."""

Kind = Literal["reproduced", "close", "differs", "unchecked"]
KINDS: tuple[Kind, ...] = ("reproduced", "close", "differs", "unchecked")


@dataclass(frozen=True)
class PrintedComparison:
    """The verdict of a comparison with the paper.

    - `kind`: "reproduced", "close", "differs" or "unchecked".
    - `text`: the verdict in words.
    """

    kind: Kind
    text: str


def compare_printed(
    printed: float, computed: float | None, absent: PrintedComparison | None = None
) -> PrintedComparison:
    """Return the verdict on a printed number: reproduced within 5 %, close within 20 %, otherwise different.

    - `printed`: the printed number, > 0.
    - `computed`: the computed quantity; None or nonfinite if missing.
    - `absent`: the verdict for a missing quantity; None for "cannot be checked".
    """
    if computed is None or not math.isfinite(computed):
        return absent or mark_unchecked("the run has no such value")
    deviation = abs(computed / printed - 1.0)
    if deviation <= REPRODUCED + 1e-12:
        return PrintedComparison("reproduced", f"reproduced within {_percent(deviation)}")
    if deviation <= CLOSE + 1e-12:
        return PrintedComparison("close", f"close: {_percent(deviation)} {'above' if computed > printed else 'below'}")
    return PrintedComparison("differs", f"differs: {significant(computed / printed, 2)} times printed")


def compare_limit(limit: float, computed: float | None) -> PrintedComparison:
    """Return the verdict on a printed limit: reproduced if the computed value is below it.

    - `limit`: the printed limit, > 0.
    - `computed`: the computed quantity; None or nonfinite if missing.
    """
    if computed is None or not math.isfinite(computed):
        return mark_unchecked("the run has no such value")
    if computed < limit:
        return PrintedComparison("reproduced", f"holds: {significant(computed, 2)} is below")
    return PrintedComparison("differs", f"does not hold: {significant(computed / limit, 2)} times the limit")


def claim(holds: bool) -> PrintedComparison:
    """Return the verdict on a statement in the paper.

    - `holds`: True if the statement holds.
    """
    return PrintedComparison("reproduced", "holds") if holds else PrintedComparison("differs", "does not hold")


def mark_unchecked(why: str) -> PrintedComparison:
    """Return the verdict if there is nothing to compare.

    - `why`: the reason.
    """
    return PrintedComparison("unchecked", f"cannot be checked: {why}")


def mark_incomparable(why: str) -> PrintedComparison:
    """Return the verdict if the computed number is an artefact of the computation.

    - `why`: the reason.
    """
    return PrintedComparison("unchecked", f"not compared: {why}")


def _percent(fraction: float) -> str:
    """Format a fraction in percent, rounded up to a tenth so that "within" stays true."""
    return f"{max(0.1, math.ceil(fraction * 1000 - 1e-9) / 10):.1f} %"
