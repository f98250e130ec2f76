"""Uncertainty sets for tests, and the demand computed directly."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from pydantic import TypeAdapter

from slidax.core.types import State
from slidax.law import SampledData
from slidax.scenarios import Scenario
from slidax.scenarios.family import Family
from slidax.scenarios.load import alter
from slidax.scenarios.uncertainty import Uncertainty


def with_set(scenario: Scenario, uncertainty: dict[str, Any], changes: dict[str, Any]) -> tuple[Scenario, Family]:
    changed = alter(scenario, changes)
    return changed, Family.of(changed.description, TypeAdapter(Uncertainty).validate_python(uncertainty))


def member(family: Family, seed: int) -> Any:
    """The plant of one random member, as a scenario file defines it."""
    cube = np.random.default_rng(seed).uniform(size=(1, family.space.dimensions))
    values = {path: some[0] for path, some in family.space.values(cube).items()}
    plant = family.case(values).as_it_is().moving().plant
    return getattr(plant, "own", plant)


def asked_by(scenario: Scenario) -> Any:
    """Return a function from a member, times and deviations q and dq from the reference to w* [N n]."""
    law, h = scenario.controller, scenario.period
    robot, rubbed = law.nominal, jnp.zeros(law.joints)
    adaptation = law.adaptation if isinstance(law, SampledData) else None
    memory = None if adaptation is None else adaptation.init(scenario.state0)

    @eqx.filter_jit
    def answers(plant: Any, times: Any, q: Any, dq: Any) -> Any:
        return jax.vmap(lambda *args: at(plant, *args))(times, q, dq)

    def at(plant: Any, t: Any, q: Any, dq: Any) -> Any:
        now, later = (scenario.trajectory.reference(args) for args in (t, t + h))
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
