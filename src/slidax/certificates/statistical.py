"""How often the promise is broken in simulation, at most, and the worst that a search finds."""

from __future__ import annotations

from typing import Any

import numpy as np

from slidax.scenarios import Scenario

from .members import family_of
from .verdict import Assumption, Verdict

NAME, TITLE = "statistical", "holds in runs drawn from the uncertain set"

RUNS = 300
"""Drawn by chance, unless another number is asked for."""

SEARCHED = 1.0
"""Runs of the search for the worst case, as a share of those that are drawn."""

STEADY = ("steady_error", "steady_torque_step")
"""Of which the largest of all drawn runs is told, if none ended early."""

KEPT, APART = 4, 0.25
"""Of the worst cases: the worst of those that are drawn, and those of the search that differ by so much of a set."""


def statistical(scenario: Scenario, runs: int = RUNS, seed: int = 0, confidence: float = 0.99) -> Verdict:
    """`p <= upper` by the exact interval of Clopper and Pearson for the rate p at which a run of the set leaves.

    With k of n runs outside, `Pr(X <= k | p = upper) = 1 - confidence`; for k = 0 that is `upper = 1 - (1-c)^(1/n)`.
    The search (CMA-ES, then quasi-Newton steps) looks for the least margin with as many runs again. What it finds is no
    probability; that it finds nothing is no proof.

    - `scenario`: with its block `uncertainty`.
    - `runs`: how many are drawn; as many are searched.
    - `seed`: of both.
    - `confidence`: of the bound.

    Raises DefinitionError if a set is empty or the search's package is not installed.
    """
    return tried(scenario, runs, seed, confidence)[0]


def tried(
    scenario: Scenario, runs: int = RUNS, seed: int = 0, confidence: float = 0.99
) -> tuple[Verdict, dict[str, Any]]:
    """The certificate `statistical`, and its worst cases by path, the worst first, at most `KEPT`.

    - `scenario`, `runs`, `seed`, `confidence`: as of `statistical`.

    Raises DefinitionError if a set is empty or the search's package is not installed.
    """
    if runs < 1:
        return Verdict(NAME, TITLE, None, None, {}, (), "left out: no runs are asked for"), {}
    family = family_of(scenario)
    if family is None or not family.space.dimensions:
        text = "the scenario says of nothing that it is uncertain, so that all runs are the same: write `uncertainty`"
        return Verdict(NAME, TITLE, None, None, {}, (), text), {}
    from slidax.studies import Predicate
    from slidax.studies.asked import Asked
    from slidax.studies.falsify import MARGIN, badness
    from slidax.studies.points import points
    from slidax.studies.predicate import ENVELOPE
    from slidax.studies.runner import Runner
    from slidax.studies.search import lowest
    from slidax.studies.statistics import clopper_pearson
    from slidax.studies.task import Task

    simulation = scenario.description.simulation
    samples = round(simulation.t1 / simulation.period)
    runner = Runner(Task.of(family, simulation.engine), Runner.rows_of_chunk(samples))
    every = Asked(runner, family)
    drawn = every.points(points(seed, 0, runs, family.space.dimensions))
    if np.isnan(drawn["margin"]).all() and not np.asarray(drawn["outcome"]).any():
        text = "the scheme draws no envelope, so that there is nothing to leave: write a `tolerance`"
        return Verdict(NAME, TITLE, None, None, {}, (), text), {}
    failures = int((~Predicate(ENVELOPE).holds(drawn)).sum())
    upper = clopper_pearson(failures, runs, confidence, side="upper").upper
    lows = lowest(
        lambda cube: badness(every.points(cube), MARGIN),
        family.space.dimensions,
        evaluations=max(round(SEARCHED * runs), 10),
        seed=seed,
        keep=KEPT - 1,
        distance=APART,
    )
    searched, margins = every.rows - runs, badness(every.table, MARGIN)
    worst = float(margins.min())
    rows = dict.fromkeys(int(np.argmax(margins == one)) for one in (float(margins[:runs].min()), *lows.values))
    kept = [every.values_of(row) for row in sorted(rows, key=lambda row: float(margins[row]))]
    found: dict[str, Any] = {
        "probability": upper,
        "confidence": confidence,
        "runs": runs,
        "failures": failures,
        "worst_margin": worst,
        "searched": searched,
        **{name: float(np.max(drawn[name])) for name in STEADY if np.isfinite(drawn.get(name, np.nan)).all()},
    }
    holds = failures == 0 and worst > 0.0
    outside = "none" if not failures else str(failures)
    statement = (
        f"Of {runs} runs of the set {outside} left the envelope, so that it is left with a probability below "
        f"{upper:.2g} at {100 * confidence:g} % confidence; the worst of {searched} searched runs has a margin of "
        f"{worst:.3g}."
    )
    if failures == 0 and worst <= 0.0:
        statement += " The search found a case that leaves it."
    assumptions = (
        Assumption("the arm is as it is simulated", "assumed"),
        Assumption("what is uncertain is distributed as the set says", "assumed"),
        Assumption(
            f"the envelope is kept in {runs} runs that were drawn, seed {seed}", "fails" if failures else "tested"
        ),
        Assumption(
            f"the envelope is kept in {searched} runs of a search for the worst",
            "tested" if worst > 0.0 else "fails",
            worst,
        ),
    )
    cases = {path: np.stack([np.asarray(one[path]) for one in kept]) for path in kept[0]}
    return Verdict(NAME, TITLE, holds, worst, found, assumptions, statement), cases
