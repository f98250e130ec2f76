"""A closed loop, ready to be simulated."""

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


# Equal only to itself: its arrays have no one answer, and compiled batches are found by it.
@dataclass(frozen=True, eq=False)
class Scenario:
    """The parts of a closed loop, and how long and how finely it is simulated.

    - `name`, `robot`, `scheme`: what the scenario, its robot and its scheme are called.
    - `description`: the validated file it was built from.
    - `plant`, `controller`, `trajectory`, `state0`: the parts.
    - `t1`, `stepping`, `log_every`: as in `simulate`.
    - `tolerance`: what a run is judged by, whatever the scheme promises; None for nothing.
    - `changed`: what `replace` changed, so that it is no longer what `description` says.
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
        """The same with other parts.

            scenario.replace(state0=State([0.2, 0.8]), t1=2.0, mode="held", period=2e-4)

        - `changes`: fields of the scenario, and of its `Stepping`, by name.

        Raises DefinitionError if there is no such field, or the parts do not fit each other.
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
        made = replace(self, **others, stepping=stepping, changed=changed)
        require_fitting(*made.parts, stepping=stepping)
        return made

    @property
    def parts(self) -> Parts:
        """Plant, controller, trajectory, start, and the tolerance band if any, in the order that `simulate` takes."""
        parts = self.plant, self.controller, self.trajectory, self.state0
        return parts if self.tolerance is None else (*parts, self.tolerance)

    def simulate(self, *, log_every: int | None = 0, throw: bool = False, progress: bool | None = None) -> Run:
        """The run of this scenario.

        - `log_every`: log one in so many samples, None for no log; the scenario's own if 0.
        - `throw`: raise OutcomeError on a bad outcome.
        - `progress`: a bar on the terminal; None shows it for long runs.

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
        """Many runs of this scenario with other parts, as one `Run`.

            scenario.simulate_batch(lambda one, q: one.replace(state0=State(q)), starts)

        - `define`: from this scenario and what varies, for one run, to the scenario of that run, by `replace`.
        - `varied`: a pytree of arrays with the run as their first axis.
        - `log_every`, `threads`: as in `simulate_batch`.

        Raises DefinitionError if the parts do not fit each other, or a run has another end or stepping than this.
        """
        of_one = _PartsOfOne(self, define)
        return simulate_batch(of_one, varied, t1=self.t1, stepping=self.stepping, log_every=log_every, threads=threads)


@dataclass(frozen=True)
class _PartsOfOne:
    """From what varies to the parts of one run; equal for the same scenario and function, which are compiled once."""

    scenario: Scenario
    define: Callable[[Scenario, Any], Scenario]

    def __call__(self, given: Any) -> Parts:
        made = self.define(self.scenario, given)
        if (made.t1, made.stepping) != (self.scenario.t1, self.scenario.stepping):
            raise DefinitionError("all runs of a batch have one `t1` and one stepping: replace them before")
        return made.parts
