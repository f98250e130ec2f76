"""What gains can be had, and what of both aims."""

from __future__ import annotations

import re

import numpy as np
from sampled_data_figures.loops import DOCS, plain_numbers, save, table, write_table

from slidax.figures import aims_front
from slidax.studies import How, read_study
from slidax.studies.tune import Tune

from .maps import STUDIES

HEAD = ["gains", "steady error [rad]", "steady torque step [N m]", "failed"]
TICKS = {
    "panda-payload": ([50.0, 100.0, 200.0, 400.0], [0.1, 0.2, 0.4, 0.8]),
    "example-4.1-1khz": ([0.2, 0.4, 0.8], [0.05, 0.1, 0.15]),
}
ROW = re.compile(r"^\| (today|front-\d+)(, best)? \| (\S+) \| (\S+) \|", re.MULTILINE)


def make() -> None:
    """Runs both searches for gains, and writes their fronts as tables and pictures."""
    for name in TICKS:
        study = read_study(STUDIES / f"tune-{name}.yaml")
        assert isinstance(study, Tune)
        found = study.run(How())
        rows = []
        for place in (None, *range(len(found.gains))):
            one = found.judged(place)
            best = ", best" if place is not None and place == found.best else ""
            gains = "today" if place is None else f"front-{place + 1}{best}"
            rows.append([gains, *(f"{value:.4g}" for value in one.aims.values()), f"{one.failures} of {one.runs}"])
        write_table("searches.md", f"tune-{name}", table(HEAD, rows))
        draw(name)
        print(f"{name}: {found.lead}", flush=True)
        for aim in found.aims:
            one_aim = found.difference(found.best or 0, aim)
            ends = "" if one_aim.of_mean is None else f", {one_aim.of_mean.lower:.2g} to {one_aim.of_mean.upper:.2g}"
            print(f"  best less today, {aim}: {one_aim.mean:.3g}{ends}", flush=True)


def draw(name: str) -> None:
    """The picture of the table on the page.

    - `name`: of the scenario.
    """
    page = (DOCS / "searches.md").read_text(encoding="utf-8")
    rows = ROW.findall(page.partition(f"<!-- table tune-{name} -->")[2].partition("<!-- end -->")[0])
    numbers = {gains: [1e6 * float(error), float(step)] for gains, _, error, step in rows}
    today = np.array(numbers.pop("today"))
    best = next((k for k, gains in enumerate(numbers) if (gains, ", best") in [row[:2] for row in rows]), None)
    labels = ["steady error  [µrad]", "steady torque step  [N m]"]
    figure = aims_front(labels, np.array(list(numbers.values())), today, best)
    plain_numbers(figure.axes[0], *TICKS[name])
    save(figure, f"tune-{name}")
