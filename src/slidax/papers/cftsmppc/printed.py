"""What the paper prints about its own scheme, CFTSMPPC, figure by figure as printed."""

from __future__ import annotations

from dataclasses import dataclass

TITLE = (
    "Approximate continuous fixed-time terminal sliding mode control with prescribed performance for uncertain "
    "robotic manipulators"
)
JOURNAL = "Nonlinear Dynamics (2022)"
DOI = "10.1007/s11071-022-07650-w"


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


BAND = 1e-8
"""The settling band at which the printed times of CFTSMPPC come out; the paper does not print it."""

TABLE_3 = (
    Printed(
        "settling_time",
        "Table 3",
        "t_s, actual convergence time",
        ("1.37", "1.35", "1.53"),
        "last time with |e| above 1e-8, a band that is not printed",
    ),
    Printed(
        "steady_error",
        "Table 3",
        "e_ρ, steady-state error",
        ("4.92e-11", "6.90e-11", "2.21e-11"),
        "largest |e| over the second half of the run",
    ),
    Printed(
        "peak_torque",
        "Table 3",
        "τ_max, maximum control torque",
        ("12.19", "14.96", "15.17"),
        "largest |τ| over the run",
    ),
)

STEADY_LIMIT = "8e-11"
"""Section 4 on Fig. 7(b): "the convergence accuracy of the steady-state error satisfies |e_i| < 8 × 10⁻¹¹ even with
time-varying external disturbances"."""

NOT_COVERED = (
    "Figs. 3 and 4, the curves of FTSMC and FTSMPPC: schemes that the proposed one is compared with.",
    "Figs. 8 to 11, the curves of NFTSMC, ANFTSMC and SFSMC, and their rows in Table 3.",
    "Figs. 12 to 14, the bars of IAE, ECI and AICE: no values are printed, and most of the bars are other schemes'.",
    "The energy, 8.84 % of that of NFTSMC: it needs a run of NFTSMC. (The sentence cites Fig. 12; it is Fig. 13.)",
    "The curves of the figures as such: the paper gives no data for them, so they can be compared by eye only.",
)
"""What it prints that needs more than runs of its own scheme."""
