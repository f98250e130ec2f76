"""What gains can be had, and what of both aims."""

from __future__ import annotations

import numpy as np
from sampled_data_figures.loops import save, table, write_table

from slidax.figures import aims_front
from slidax.studies import How, read_study
from slidax.studies.tune import Tune

from .maps import STUDIES

LABELS = ["steady error  [rad]", "steady torque step  [N m]"]


def make() -> None:
    """Runs both searches for gains, and writes their fronts as tables and pictures."""
    for name in ("panda-payload", "example-4.1-1khz"):
        study = read_study(STUDIES / f"tune-{name}.yaml")
        assert isinstance(study, Tune)
        found = study.run(How())
        rows = []
        for place in (None, *range(len(found.gains))):
            one = found.judged(place)
            best = ", best" if place is not None and place == found.best else ""
            numbers = [f"{value:.4g}" for value in one.aims.values()]
            rows.append(
                ["today" if place is None else f"front-{place + 1}{best}", *numbers, f"{one.failures} of {one.runs}"]
            )
        write_table("searches.md", f"tune-{name}", table(["gains", *LABELS, "failed"], rows))
        front = np.array([list(found.judged(place).aims.values()) for place in range(len(found.gains))])
        save(aims_front(LABELS, front, np.array(list(found.judged(None).aims.values())), found.best), f"tune-{name}")
        print(f"{name}: {found.lead}", flush=True)
        for aim in found.aims:
            one = found.difference(found.best or 0, aim)
            ends = "" if one.of_mean is None else f", {one.of_mean.lower:.2g} to {one.of_mean.upper:.2g}"
            print(f"  best less today, {aim}: {one.mean:.3g}{ends}", flush=True)
