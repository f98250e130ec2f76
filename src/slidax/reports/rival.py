"""The run of one scheme in a comparison."""

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
    """The run of one scheme in a comparison.

    - `scenario`, `run`: the simulated scenario and its run.
    - `outside`: samples outside the scheme's envelope, or for a scheme without one outside the comparison's envelope;
      None if there is none.
    """

    scenario: Scenario
    run: Run
    outside: int | None = None

    @property
    def form(self) -> str:
        """`sampled-data` for a law that is designed for its sample time, `printed` for one as its source prints it."""
        return "sampled-data" if isinstance(self.scenario.controller, SampledData) else "printed"

    @property
    def end(self) -> float:
        """Time of the last sample [s]."""
        return max(0, int(self.run.tally.samples) - 1) * float(self.run.period)

    @classmethod
    def simulated(cls, scenario: Scenario, judge: Scenario, *, logged: bool) -> Rival:
        """Simulate a scheme and count its samples outside the envelope.

        - `scenario`: to simulate.
        - `judge`: has the envelope for a scheme without one.
        - `logged`: keep the log that the scenario requests.
        """
        # Of every sample, since metrics count all of them too.
        run = scenario.simulate(log_every=1)
        outside = int(run.tally.violations) if run.has_envelope else _outside(judge, run)
        kept = jax.tree.map(lambda x: x[:: scenario.log_every].copy(), run.log) if logged else None
        return cls(scenario, eqx.tree_at(lambda r: r.log, run, kept), outside)


def _outside(judge: Scenario, run: Run) -> int | None:
    """Logged samples with a joint at or outside another scheme's envelope."""
    law, start = judge.controller, jnp.zeros(())
    memory = law.init(start, judge.state0, judge.trajectory.reference(start))
    if run.log is None or law.envelope(start, memory) is None:
        return None
    bounds: Any = jax.jit(jax.vmap(law.envelope, (0, None)))(jnp.asarray(run.log.t), memory)
    inside = (np.asarray(bounds.lower) < run.log.e) & (run.log.e < np.asarray(bounds.upper))
    return int(np.sum(~inside.all(axis=1)))
