"""The inputs that a law reads, from its program."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from slidax._types import Memory, Reference, Scalar, State
from slidax.codegen.trace import trace
from slidax.controllers import AbstractController


def read_by(controller: AbstractController) -> frozenset[str]:
    """Names of the arrays that a law reads, at the start or later: of `state.q`, `state.dq`, `now.q`, ..., `next.ddq`.

    Raises DefinitionError if there is no native code for it.
    """
    vector, scalar = jnp.zeros(controller.joints), jnp.zeros(())
    state, reference = State(vector, vector), Reference(vector, vector, vector)
    memory = jax.eval_shape(controller.init, scalar, state, reference)

    def first(t: Scalar, state: State, now: Reference) -> Memory:
        return controller.init(t, state, now)

    def later(t: Scalar, state: State, now: Reference, following: Reference, memory: Memory) -> Any:
        return controller(t, state, now, following, memory), controller.envelope(t, memory)

    read: set[str] = set()
    for function, arguments, names in (
        (first, (scalar, state, reference), ("t", "state", "now")),
        (later, (scalar, state, reference, reference, memory), ("t", "state", "now", "next", "memory")),
    ):
        program = trace(function, *arguments, names=names, named=False)
        read |= {program.inputs[value.data[0]].name for value in program.body.values if value.op == "input"}
    return frozenset(name for name in read if name.startswith(("state.", "now.", "next.")))
