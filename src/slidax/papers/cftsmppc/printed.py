"""The printed values of the paper."""

from __future__ import annotations

from dataclasses import dataclass

from slidax.reports import significant

from ..indices import DOI as DOI
from .schemes import SCHEMES

TITLE = (
    "Approximate continuous fixed-time terminal sliding mode control with prescribed performance for uncertain "
    "robotic manipulators"
)
JOURNAL = "Nonlinear Dynamics (2022)"


@dataclass(frozen=True)
class Printed:
    """A printed quantity with one value per joint.

    - `quantity`: its key: `settling_time`, `steady_error` or `peak_torque`.
    - `place`: where it is printed.
    - `name`: what it is called there.
    - `texts`: the values as printed, one per joint.
    - `compared_with`: what was computed for the comparison.
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
"""Names of the columns of Table 3, and the computed quantity for each."""


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
    "Figs. 12 to 14 as such: they print bars without values, so the computed ones stand for themselves.",
    "The curves of the figures as such: the paper gives no data for them, so they can be compared by eye only.",
    "The laws of the schemes that it compares with: it prints their parameters only. They were sourced or "
    "reconstructed, and what differs may be the reconstruction.",
)
"""Printed content that cannot be compared."""
