"""A closed loop, ready to be simulated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from slidax._types import State
from slidax.controllers import AbstractController
from slidax.simulation import Engine, MujocoPlant, Plant, Run, simulate
from slidax.trajectories import AbstractTrajectory

if TYPE_CHECKING:
    from .description import ScenarioDescription


@dataclass(frozen=True)
class Scenario:
    """The parts of a closed loop, and how long and how finely it is simulated.

    - `name`, `robot`, `scheme`: what the scenario, its robot and its scheme are called.
    - `description`: the validated file it was built from.
    - `plant`, `controller`, `trajectory`, `state0`: the parts.
    - `t1`, `period`, `mode`, `integrator`, `substeps`, `log_every`, `outside`, `engine`: as in `simulate`.
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
    period: float
    mode: Literal["held", "continuous"]
    integrator: Callable[..., Any]
    substeps: int
    log_every: int
    outside: Literal["raise", "recover"] = "raise"
    engine: Engine = "auto"

    def simulate(self, *, log_every: int | None = 0, throw: bool = False, progress: bool | None = None) -> Run:
        """The run of this scenario.

        - `log_every`: log one in so many samples, None for no log; the scenario's own if 0.
        - `throw`: raise OutcomeError on a bad outcome.
        - `progress`: a bar on the terminal; None shows it for long runs.

        Raises DefinitionError if the parts do not fit each other.
        """
        return simulate(
            self.plant,
            self.controller,
            self.trajectory,
            self.state0,
            t1=self.t1,
            period=self.period,
            mode=self.mode,
            integrator=self.integrator,
            substeps=self.substeps,
            log_every=self.log_every if log_every == 0 else log_every,
            outside=self.outside,
            engine=self.engine,
            throw=throw,
            progress=progress,
        )
