"""Sets of scenarios for the tests, and what is asked of the loops by the plainest way."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from pydantic import TypeAdapter

from slidax._types import State
from slidax.controllers import SampledData
from slidax.scenarios import Scenario
from slidax.scenarios.family import Family
from slidax.scenarios.load import altered
from slidax.scenarios.uncertainty.mapping import Uncertainty


def with_set(scenario: Scenario, uncertainty: dict[str, Any], changes: dict[str, Any]) -> tuple[Scenario, Family]:
    changed = altered(scenario, changes)
    return changed, Family.of(changed.description, TypeAdapter(Uncertainty).validate_python(uncertainty))


def member(family: Family, seed: int) -> Any:
    """The plant of one member, drawn at random, as a scenario file would have it."""
    cube = np.random.default_rng(seed).uniform(size=(1, family.space.dimensions))
    values = {path: some[0] for path, some in family.space.values(cube).items()}
    plant = family.case(values).as_it_is().moving().plant
    return getattr(plant, "own", plant)


def asked_by(scenario: Scenario) -> Any:
    """From a member, times and states beside the reference by q and dq to w* [N n]: each by solving once."""
    law, h = scenario.controller, scenario.period
    robot, rubbed = law.nominal, jnp.zeros(law.joints)
    adaptation = law.adaptation if isinstance(law, SampledData) else None
    memory = None if adaptation is None else adaptation.init(scenario.state0)

    @eqx.filter_jit
    def answers(plant: Any, times: Any, q: Any, dq: Any) -> Any:
        return jax.vmap(lambda *one: at(plant, *one))(times, q, dq)

    def at(plant: Any, t: Any, q: Any, dq: Any) -> Any:
        now, later = (scenario.trajectory.reference(one) for one in (t, t + h))
        ddq = (later.dq - now.dq) / h
        believed, friction = robot, rubbed
        if adaptation is not None:
            believed, friction = adaptation.robot(robot, memory), adaptation.friction(memory, now.dq)
        state = State(q=now.q + q, dq=now.dq + dq)
        true = plant.at(t)
        known = believed.mass(state.q) @ ddq + believed.bias(state.q, state.dq) + friction
        needed = true.mass(state.q) @ ddq + true.bias(state.q, state.dq) + true.friction(state.dq)
        return jnp.linalg.solve(believed.mass(state.q), known - needed + plant.disturbance(t, state))

    return answers
