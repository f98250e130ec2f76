"""Inputs and answers of a guarded step at every sample of its scenario's closed loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np

from slidax._types import Command, Envelope, Memory, Reference, Scalar, State
from slidax.controllers import AbstractController
from slidax.simulation import simulate

from .guarded_step import GuardedStep
from .samples import Sample
from .step_memory import StepMemory

if TYPE_CHECKING:
    from slidax.scenarios import Scenario


@dataclass(frozen=True)
class Recording:
    """Samples of a closed loop, each array with the sample as first axis.

    - `samples`: the step's inputs.
    - `tau`: the torque commanded [k n]; an actuator may have delivered another one.
    - `status`: of each sample.
    """

    samples: Sample
    tau: np.ndarray
    status: np.ndarray


class _Recorded(AbstractController):
    """A guarded step that logs its inputs and answers."""

    guard: GuardedStep

    @property
    def joints(self) -> int:
        return self.guard.joints

    def init(self, t: Scalar, state: State, reference: Reference) -> StepMemory:
        return self.guard.init(t, state, reference)

    def __call__(
        self, t: Scalar, state: State, reference_now: Reference, reference_next: Reference, memory: StepMemory
    ) -> Command:
        command, status = self.guard.step(t, state, reference_now, reference_next, memory)
        got = jax.tree.leaves(Sample(memory, t, state, reference_now, reference_next))
        signals = {f"{k:03}": leaf.astype(float) for k, leaf in enumerate(got)}
        signals |= {"status": status.astype(float), "tau": command.tau}
        return Command(tau=command.tau, memory=command.memory, signals=signals)

    def envelope(self, t: Scalar, memory: Memory) -> Envelope | None:
        return self.guard.envelope(t, memory)


def recorded(scenario: Scenario, guard: GuardedStep, t1: float | None = None) -> Recording:
    """Run a scenario's closed loop until `t1` [s] and record the step's inputs and answers."""
    run = simulate(
        scenario.plant,
        _Recorded(guard),
        scenario.trajectory,
        scenario.state0,
        t1=scenario.t1 if t1 is None else t1,
        stepping=scenario.stepping,
        mode="held",
        outside="recover",
        engine="auto",
        progress=False,
    )
    assert run.log is not None
    t, state = jnp.zeros(()), scenario.state0
    reference = scenario.trajectory.reference(t)
    like = Sample(jax.eval_shape(guard.init, t, state, reference), t, state, reference, reference)
    logged = [np.asarray(run.log.signals[f"{k:03}"]) for k in range(len(jax.tree.leaves(like)))]
    arrays = [values.astype(leaf.dtype) for values, leaf in zip(logged, jax.tree.leaves(like), strict=True)]
    samples: Sample = jax.tree.unflatten(jax.tree.structure(like), arrays)
    return Recording(samples, np.asarray(run.log.signals["tau"]), np.asarray(run.log.signals["status"]).astype(int))
