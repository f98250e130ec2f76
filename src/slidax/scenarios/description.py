"""A scenario file as a whole."""

from __future__ import annotations

from typing import Literal

import jax.numpy as jnp

from slidax._errors import DefinitionError, located, parameter
from slidax._types import State
from slidax.numerics import runge_kutta_4, semi_implicit_euler
from slidax.simulation import Plant

from .base import Description
from .disturbances import DisturbanceDescription
from .robots import RobotDescription
from .scenario import Scenario
from .schemes import SchemeDescription
from .trajectories import TrajectoryDescription

INTEGRATORS = {"rk4": runge_kutta_4, "semi_implicit_euler": semi_implicit_euler}


class StartDescription(Description):
    """The state at t = 0."""

    q: list[float]
    """Positions, one entry per joint [rad or m]."""
    dq: list[float] | None = None
    """Velocities, one entry per joint [rad/s or m/s]; at rest if not given."""

    def build(self) -> State:
        """The state."""
        q = parameter(self.q)
        return State(q=q, dq=jnp.zeros_like(q) if self.dq is None else parameter(self.dq))


class SimulationDescription(Description):
    """How time passes."""

    mode: Literal["continuous", "held"] = "held"
    """`held`: torque held over a period; `continuous`: the law at every stage of the integrator."""
    integrator: Literal["rk4", "semi_implicit_euler"] = "rk4"
    """One step of the plant."""
    period: float
    """Time between two samples [s]; in continuous mode the integrator's step."""
    substeps: int = 1
    """Integrator steps per period in held mode."""
    t1: float
    """End [s], a whole number of periods."""
    log_every: int = 10
    """One in how many samples is written to the log; metrics count all."""
    engine: Literal["auto", "xla"] = "auto"
    """What computes; `auto` takes the fastest there is."""


class ScenarioDescription(Description):
    """One closed loop: who moves, what it should do, what disturbs it, who commands it."""

    title: str
    """One line for a person."""
    source: str = ""
    """Where the numbers come from."""
    robot: RobotDescription
    """The arm that moves, and the arm as the law knows it."""
    trajectory: TrajectoryDescription
    """What the joints should do."""
    disturbance: DisturbanceDescription = DisturbanceDescription()
    """What pushes the joints from outside."""
    start: StartDescription
    """The state at t = 0."""
    scheme: SchemeDescription
    """Who commands the joints."""
    simulation: SimulationDescription
    """How time passes."""

    def build(self, name: str) -> Scenario:
        """The scenario with all its parts.

        - `name`: what to call it.

        Raises DefinitionError, with the path of the field, if a part cannot be.
        """
        with located("robot"):
            true, nominal = self.robot.build()
        with located("trajectory"):
            trajectory = self.trajectory.build()
        with located("disturbance"):
            disturbance = self.disturbance.build()
        with located("scheme"):
            controller = self.scheme.build(nominal)
        with located("start"):
            state0 = self.start.build()
            for field, value in (("q", state0.q), ("dq", state0.dq)):
                if value.shape != (true.joints,):
                    raise DefinitionError(
                        f"must have one entry for each of the {true.joints} joints; got {len(value)}", where=field
                    )
        simulation = self.simulation
        return Scenario(
            name=name,
            robot=self.robot.kind,
            scheme=self.scheme.name,
            description=self,
            plant=Plant(true, disturbance),
            controller=controller,
            trajectory=trajectory,
            state0=state0,
            t1=simulation.t1,
            period=simulation.period,
            mode=simulation.mode,
            integrator=INTEGRATORS[simulation.integrator],
            substeps=simulation.substeps,
            log_every=simulation.log_every,
        )
