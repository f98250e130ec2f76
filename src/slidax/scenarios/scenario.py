"""A closed loop, ready for simulation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

from slidax._errors import DefinitionError, nearest
from slidax._types import State
from slidax.controllers import AbstractController
from slidax.simulation import MujocoPlant, Parts, Plant, Run, Stepping, require_fitting, simulate, simulate_batch
from slidax.trajectories import AbstractTrajectory
from slidax.transformations import PrescribedPerformance

if TYPE_CHECKING:
    from .description import ScenarioDescription


# Equal only to itself: arrays have no single equality, and it is the key of compiled batches.
@dataclass(frozen=True, eq=False)
class Scenario:
    """The parts of a closed loop, with the duration and the time steps of its simulation.

    - `name`, `robot`, `scheme`: names of the scenario, its robot and its scheme.
    - `description`: the validated file.
    - `t1`, `stepping`, `log_every`: as in `simulate`.
    - `tolerance`: tolerance band of a run, independent of the scheme's envelope; None for none.
    - `changed`: fields that `replace` changed, so that they differ from `description`.
    """

    name: str
    robot: str
    scheme: str
    description: ScenarioDescription
    plant: Plant | MujocoPlant
    controller: AbstractController
    trajectory: AbstractTrajectory
    state0: State
    t1: float
    stepping: Stepping
    log_every: int | None = 1
    tolerance: PrescribedPerformance | None = None
    changed: tuple[str, ...] = ()

    @property
    def period(self) -> float:
        """Time between two samples [s]."""
        return self.stepping.period

    def replace(self, **changes: Any) -> Scenario:
        """Return the scenario with other parts.

            scenario.replace(state0=State([0.2, 0.8]), t1=2.0, mode="held", period=2e-4)

        - `changes`: fields of the scenario, and of its `Stepping`, by name.

        Raises DefinitionError if a field does not exist, or the parts do not fit each other.
        """
        of_stepping = {field.name for field in fields(Stepping)}
        names = {field.name for field in fields(self)} - {"description", "changed"}
        for name in changes:
            if name not in names | of_stepping:
                raise DefinitionError(f"a scenario has no field `{name}`; {nearest(name, names | of_stepping)}")
        steps = {name: value for name, value in changes.items() if name in of_stepping}
        others = {name: value for name, value in changes.items() if name in names}
        stepping = Stepping.of(others.pop("stepping", self.stepping), steps)
        changed = tuple(dict.fromkeys([*self.changed, *changes]))
        scenario = replace(self, **others, stepping=stepping, changed=changed)
        require_fitting(*scenario.parts, stepping=stepping)
        return scenario

    @property
    def parts(self) -> Parts:
        """Plant, controller, trajectory, start, and the tolerance band if any, in the order of `simulate`."""
        parts = self.plant, self.controller, self.trajectory, self.state0
        return parts if self.tolerance is None else (*parts, self.tolerance)

    def simulate(self, *, log_every: int | None = 0, throw: bool = False, progress: bool | None = None) -> Run:
        """Simulate the scenario.

        - `log_every`: number of samples per log entry, None for no log, 0 for the scenario's own number.
        - `throw`: raise OutcomeError on a bad outcome.
        - `progress`: True for a progress bar on the terminal; None shows it for long runs.

        Raises DefinitionError if the parts do not fit each other.
        """
        every = self.log_every if log_every == 0 else log_every
        return simulate(
            *self.parts, t1=self.t1, stepping=self.stepping, log_every=every, throw=throw, progress=progress
        )

    def simulate_batch(
        self,
        define: Callable[[Scenario, Any], Scenario],
        varied: Any,
        *,
        log_every: int | None = None,
        threads: int | None = None,
    ) -> Run:
        """Simulate many runs of the scenario with other parts, as one `Run`.

            scenario.simulate_batch(lambda scenario, q: scenario.replace(state0=State(q)), starts)

        - `define`: from this scenario and the varied values of one run to the scenario of that run, by `replace`.
        - `varied`: a pytree of arrays with the run as their first axis.
        - `log_every`, `threads`: as in `simulate_batch`.

        Raises DefinitionError if the parts do not fit each other, or a run has another end or stepping than this.
        """
        parts = _PartsOfRun(self, define)
        return simulate_batch(parts, varied, t1=self.t1, stepping=self.stepping, log_every=log_every, threads=threads)


@dataclass(frozen=True)
class _PartsOfRun:
    """From the varied values to the parts of one run; equal instances share compiled code."""

    scenario: Scenario
    define: Callable[[Scenario, Any], Scenario]

    def __call__(self, varied: Any) -> Parts:
        scenario = self.define(self.scenario, varied)
        if (scenario.t1, scenario.stepping) != (self.scenario.t1, self.scenario.stepping):
            raise DefinitionError("all runs of a batch have one `t1` and one stepping: replace them before")
        return scenario.parts
