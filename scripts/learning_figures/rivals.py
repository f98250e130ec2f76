"""Other laws with the same estimator, prediction, limits and learning."""

from __future__ import annotations

import numpy as np
from sampled_data_figures.loops import small, steady_error, steady_step, table, write_table

from slidax import scenarios

from .runs import ARMS, NOMINAL, TRUE, run

SCHEMES = ("cftsmppc", "slotine_li_ppc", "slotine_li", "super_twisting", "computed_torque", "gravity_pd")


def make() -> None:
    """Simulates each law in all 16 pairs of nominal and true rotors, and writes the table of docs/learning.md."""
    rows = []
    for name in ARMS:
        final = scenarios.load(name).controller.step.transformation.performance.final
        for scheme in SCHEMES:
            changes = {} if scheme == "cftsmppc" else {"scheme.name": scheme}
            runs = [run(name, nominal, true, changes) for true in TRUE for nominal in NOMINAL]
            errors = [steady_error(one) for one in runs]
            rows.append(
                [
                    name.removesuffix("-payload"),
                    f"`{scheme}`",
                    f"{sum(error < 0.3 * float(final) for error in errors)} of {len(errors)}",
                    small(float(np.min(errors))),
                    small(float(np.median(errors))),
                    small(float(np.max(errors))),
                    f"{max(steady_step(one) for one in runs):.2g}",
                ]
            )
    head = ["arm", "scheme", "steady within .3 ρ∞", "least error [rad]", "median", "largest", "largest step [N m]"]
    write_table("learning.md", "rivals", table(head, rows))
