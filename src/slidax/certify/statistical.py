"""The certificate `statistical`: a bound of the failure rate from random runs, and a search for the worst case."""

from __future__ import annotations

from typing import Any

import numpy as np

from slidax.scenarios.scenario import Scenario

from .certificate import Assumption, Verdict
from .uncertainty_set import family_of

NAME, TITLE = "statistical", "holds in random runs of the uncertainty set"

RUNS = 300
"""Default number of random runs."""

SEARCHED = 1.0
"""Number of runs in the search for the worst case, relative to the number of random runs."""

STEADY = ("steady_error", "steady_torque_step")
"""Metrics whose largest value over all random runs is reported, if no run ended early."""

KEPT, APART = 4, 0.25
"""Number of reported worst cases, and the least distance between two cases of the search as a share of the set.

The first case is the worst random run; the others are from the search.
"""


def statistical(scenario: Scenario, runs: int = RUNS, seed: int = 0, confidence: float = 0.99) -> Verdict:
    """Bound the probability p that a run of the set leaves the envelope, by the exact interval of Clopper and Pearson.

    - `runs`: number n of random runs. `seed`: their seed. `confidence`: c of the bound.

    If k of n runs leave the envelope, the bound `upper` solves `Pr(X <= k | p = upper) = 1 - c`, where X is the number
    of n runs that leave it. For k = 0 `upper = 1 - (1-c)^(1/n)`. A search (CMA-ES, then quasi-Newton steps) minimises
    the margin to the envelope with as many further runs. Its result is not a probability, and a search without failures
    proves nothing.

    Raises DefinitionError if a set is empty or the search's package is not installed.
    """
    return statistical_with_cases(scenario, runs, seed, confidence)[0]


def statistical_with_cases(
    scenario: Scenario, runs: int = RUNS, seed: int = 0, confidence: float = 0.99
) -> tuple[Verdict, dict[str, Any]]:
    """Return the verdict of `statistical`, and its worst cases.

    The cases are a dict: for each dotted path of the scenario an array of uncertain values, whose first axis is the
    case. There are at most `KEPT` cases, the worst first. The dict is empty if the certificate does not apply.
    """
    if runs < 1:
        return Verdict(NAME, TITLE, None, None, {}, (), "left out: no runs were requested"), {}
    family = family_of(scenario)
    if family is None or not family.space.dimensions:
        text = "the scenario has no uncertainty, so all runs are the same: write a block `uncertainty`"
        return Verdict(NAME, TITLE, None, None, {}, (), text), {}
    from slidax.studies.cases import StudyTask, points
    from slidax.studies.falsify import MARGIN, rank_badness
    from slidax.studies.predicates import ENVELOPE, Predicate
    from slidax.studies.runner import BatchEvaluator, Runner
    from slidax.studies.search import search_lowest
    from slidax.studies.statistics import clopper_pearson

    simulation = scenario.description.simulation
    samples = round(simulation.t1 / simulation.period)
    runner = Runner(StudyTask.of(family, simulation.engine), Runner.rows_of_chunk(samples))
    every = BatchEvaluator(runner, family)
    drawn = every.points(points(seed, 0, runs, family.space.dimensions))
    if np.isnan(drawn["margin"]).all() and not np.asarray(drawn["outcome"]).any():
        text = "the scheme has no envelope to leave: write a `tolerance`"
        return Verdict(NAME, TITLE, None, None, {}, (), text), {}
    failures = int((~Predicate(ENVELOPE).holds(drawn)).sum())
    upper = clopper_pearson(failures, runs, confidence, side="upper").upper
    lows = search_lowest(
        lambda cube: rank_badness(every.points(cube), MARGIN),
        family.space.dimensions,
        evaluations=max(round(SEARCHED * runs), 10),
        seed=seed,
        keep=KEPT - 1,
        distance=APART,
    )
    searched, margins = every.rows - runs, rank_badness(every.table, MARGIN)
    worst, searched_worst = float(margins.min()), float(margins[runs:].min(initial=np.inf))
    rows = dict.fromkeys(int(np.argmax(margins == low)) for low in (float(margins[:runs].min()), *lows.values))
    kept = [every.values_of(row) for row in sorted(rows, key=lambda row: float(margins[row]))]
    bound: dict[str, Any] = {
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
        f"Of {runs} random runs {outside} left the envelope: the probability of leaving it is below {upper:.2g} at "
        f"{100 * confidence:g} % confidence. The worst of {searched} searched runs has a margin of "
        f"{searched_worst:.3g}."
    )
    if failures == 0 and worst <= 0.0:
        statement += " The search found a case that leaves the envelope."
    assumptions = (
        Assumption("the real arm behaves as the simulation", "assumed"),
        Assumption("the uncertain values are distributed as the set says", "assumed"),
        Assumption(f"{runs} random runs stay inside the envelope, seed {seed}", "fails" if failures else "tested"),
        Assumption(
            f"{searched} runs of a search for the worst case stay inside the envelope",
            "tested" if searched_worst > 0.0 else "fails",
            searched_worst,
        ),
    )
    cases = {path: np.stack([np.asarray(case[path]) for case in kept]) for path in kept[0]}
    return Verdict(NAME, TITLE, holds, worst, bound, assumptions, statement), cases
