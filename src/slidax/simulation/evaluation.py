"""Evaluation of the law at one time."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from slidax._types import Command, Envelope, Memory, Reference, Scalar, State
from slidax.numerics import once

from .loop import Loop
from .outcome import Fault, find_fault


class Evaluation(eqx.Module):
    """The law at one time: its reference, its command, its envelope, and a fault."""

    reference: Reference
    command: Command
    envelope: Envelope | None
    fault: Fault


def evaluate(loop: Loop, t: Scalar, state: State, measured: State, memory: Memory, ahead: Scalar) -> Evaluation:
    """Evaluate the law on the measured state, and check the true state.

    - `ahead`: time of the next sample [s].
    """
    reference = loop.trajectory.reference(t)
    command = loop.controller(t, measured, reference, loop.trajectory.reference(ahead), memory)
    # Plant, tally and log read the same bits.
    command = eqx.tree_at(lambda c: c.tau, command, once(command.tau))
    return checked_evaluation(loop, t, state, memory, reference, command)


def checked_evaluation(
    loop: Loop, t: Scalar, state: State, memory: Memory, reference: Reference, command: Command
) -> Evaluation:
    """Return a command of the law with the envelope and the fault at the true state.

    - `memory`: the controller's, before the command.
    """
    envelope = loop.controller.envelope(t, memory)
    finite = jnp.isfinite(command.tau) & jnp.isfinite(state.dq)
    fault = find_fault(t, state.q - reference.q, finite, None if loop.recover else envelope)
    return Evaluation(reference, command, envelope, fault)
