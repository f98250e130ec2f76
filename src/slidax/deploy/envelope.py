"""The errors and their envelope as a function for displays, separate from the step."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from slidax._types import Reference, Scalar, State, Vector
from slidax.codegen.trace import trace

from .guarded_step import GuardedStep
from .members import Member
from .programs import Function, Place, Step, measurement, references
from .step_memory import StepMemory

MEANINGS = {
    "error": "errors e",
    "lower": "lower bounds of the errors",
    "upper": "upper bounds of the errors",
    "margin": "distance of the errors to the nearer bound, as a share of the envelope's width; below 0 outside",
}


def envelope_members(joints: int) -> list[Member]:
    """The members of the structure that the function fills."""
    return [Member(name, "f64", (joints,), meaning) for name, meaning in MEANINGS.items()]


def envelope_function(guard: GuardedStep, step: Step) -> Function | None:
    """From parameters, memory before a step and sample to `envelope->`; None if the law has no envelope.

    Raises DefinitionError if there is no native code for it.
    """
    vector, scalar = jnp.zeros(guard.joints), jnp.zeros(())
    state, reference = State(vector, vector), Reference(vector, vector, vector)
    memory = jax.eval_shape(guard.init, scalar, state, reference)
    if jax.eval_shape(guard.envelope, scalar, memory) is None:
        return None

    def envelope(guard: GuardedStep, memory: StepMemory, t: Scalar, state: State, now: Reference) -> list[Vector]:
        bounds = guard.envelope(t, memory)
        assert bounds is not None
        e = state.q - guard.wanted_then(now)
        lower, upper = (jnp.broadcast_to(bound, e.shape) for bound in (bounds.lower, bounds.upper))
        return [e, lower, upper, jnp.minimum(e - lower, upper - e) / (upper - lower)]

    inputs = (
        [Place("parameters->", member) for member in step.parameters]
        + [Place("memory->", member) for member in step.memory]
        + [Place("measurement->", member) for member in measurement(guard.joints)]
        + [Place("reference->", member) for member in references(guard.joints)[:3]]
    )
    names = ("", "memory", "t", "", "reference")
    program = trace(envelope, guard, memory, scalar, state, reference, names=names)
    return Function(program, inputs, [Place("envelope->", member) for member in envelope_members(guard.joints)])
