"""One scheme among those that are compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.controllers import SampledData
from slidax.scenarios import Scenario
from slidax.simulation import Run


@dataclass(frozen=True)
class Rival:
    """One scheme among those that are compared.

    - `scenario`: what was simulated.
    - `run`: its run.
    - `outside`: how many of its samples were outside its envelope, or for a scheme without one outside the envelope of
      the comparison; None if there is none.
    """

    scenario: Scenario
    run: Run
    outside: int | None = None

    @property
    def form(self) -> str:
        """`sampled-data` for a law that is made for its period, `printed` for one as its source prints it."""
        return "sampled-data" if isinstance(self.scenario.controller, SampledData) else "printed"

    @property
    def end(self) -> float:
        """Time of the last sample [s]."""
        return max(0, int(self.run.tally.samples) - 1) * float(self.run.period)

    @classmethod
    def simulated(cls, scenario: Scenario, judge: Scenario, *, logged: bool) -> Rival:
        """The run of a scheme, with its samples outside an envelope counted.

        - `scenario`: what to simulate.
        - `judge`: whose envelope counts for a scheme without one.
        - `logged`: whether the run keeps the log that its scenario asks for.
        """
        # Of every sample, since metrics count all of them too.
        run = scenario.simulate(log_every=1)
        outside = int(run.tally.violations) if run.has_envelope else _outside(judge, run)
        kept = jax.tree.map(lambda x: x[:: scenario.log_every].copy(), run.log) if logged else None
        return cls(scenario, eqx.tree_at(lambda r: r.log, run, kept), outside)


def _outside(judge: Scenario, run: Run) -> int | None:
    """How many logged samples have a joint at or outside the envelope that another scheme draws."""
    law, start = judge.controller, jnp.zeros(())
    memory = law.init(start, judge.state0, judge.trajectory.reference(start))
    if run.log is None or law.envelope(start, memory) is None:
        return None
    bounds: Any = jax.jit(jax.vmap(law.envelope, (0, None)))(jnp.asarray(run.log.t), memory)
    inside = (np.asarray(bounds.lower) < run.log.e) & (run.log.e < np.asarray(bounds.upper))
    return int(np.sum(~inside.all(axis=1)))
