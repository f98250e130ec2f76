"""The law at one time."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._types import Command, Envelope, Memory, Reference, Scalar, State
from slidax.numerics import once

from .loop import Loop
from .outcome import Fault, find_fault


class Evaluation(eqx.Module):
    """The law at one time: its input, its answer, and what is wrong."""

    reference: Reference
    command: Command
    envelope: Envelope | None
    fault: Fault


def evaluate(loop: Loop, t: Scalar, state: State, seen: State, memory: Memory, ahead: Scalar) -> Evaluation:
    """The law at one time, checked against the true state; the law itself gets what is measured of it.

    - `loop`: what stays the same.
    - `t`: time [s].
    - `state`: the true one.
    - `seen`: what is measured of it.
    - `memory`: the controller's.
    - `ahead`: time of the next sample [s].
    """
    reference = loop.trajectory.reference(t)
    command = loop.controller(t, seen, reference, loop.trajectory.reference(ahead), memory)
    # Plant, tally and log read the same bits.
    command = eqx.tree_at(lambda c: c.tau, command, once(command.tau))
    return judged(loop, t, state, memory, reference, command)


def judged(loop: Loop, t: Scalar, state: State, memory: Memory, reference: Reference, command: Command) -> Evaluation:
    """An answer of the law, with what is wrong there.

    - `loop`: what stays the same.
    - `t`: time [s].
    - `state`: the true one.
    - `memory`: the controller's before the answer.
    - `reference`: what the joints should do.
    - `command`: the answer.
    """
    envelope = loop.controller.envelope(t, memory)
    finite = jnp.isfinite(command.tau) & jnp.isfinite(state.dq)
    fault = find_fault(t, state.q - reference.q, finite, None if loop.recover else envelope)
    return Evaluation(reference, command, envelope, fault)
