"""Golden samples: the step's answers in Python to samples of a run, to random ones and to bad ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from slidax._types import Command

from .guarded_step import GuardedStep
from .recording import recorded
from .samples import Sample, answer, broken, random_samples
from .status import HELD
from .step_memory import Status

if TYPE_CHECKING:
    from slidax.scenarios import Scenario

OF_A_RUN, RANDOM, BAD = 200, 200, 100
"""Number of samples of each kind."""

TOLERANCE = {"double": 1e-12, "float": 1e-6}
"""Between Python and C, relative to the size of the compared quantity."""

PERTURBATIONS = 4
SLACK = 30.0
"""Tolerance of results that depend on the inputs' last digits: this multiple of their sensitivity."""

LOOSE, NO_MATTER = 0.1, 1e30
"""For a law that searches with looser tolerances in floats: tolerance of its torque in a run, and of all else. Outside
its envelope such a law differs, as its distance to the edge is larger.
"""


@dataclass(frozen=True)
class Golden:
    """Samples with their answers.

    - `rows`: for each sample the numbers of the measurement, the reference, the memory before, the command and the
      memory after, each a list in the order of the members.
    - `within`: for each sample, the tolerance of each member of the command, and of the memory.
    """

    rows: list[list[list[Any]]]
    statuses: list[int]
    within: list[list[list[float]]]


def golden(scenario: Scenario, guard: GuardedStep, real: str, *, same: bool) -> Golden:
    """Answers of a step to samples of its scenario's closed loop, to random ones and to bad ones.

    - `real`: "double", or "float" for a program that computes in floats.
    - `same`: True if that program has all constants of this one.
    """
    drawn = random_samples(guard, scenario.trajectory, scenario.period, scenario.t1, RANDOM + BAD, seed=1)
    good, bad = (jax.tree.map(lambda x, part=part: x[part], drawn) for part in (slice(RANDOM), slice(RANDOM, None)))
    run = _of_the_run(scenario, guard)
    samples: Sample = jax.tree.map(lambda *parts: jnp.concatenate(parts), run, good, broken(bad))
    last_digit = 2.0**-51
    if real == "float":
        guard, samples = _rounded((guard, samples))
        last_digit = 2.0**-23
    command, status = answer(guard, samples)
    off, firm = sensitivity(guard, samples, command, status, last_digit)
    parts = (
        (samples.t, samples.state),
        (samples.now, samples.following),
        samples.memory,
        (command.tau, command.signals),
        command.memory,
    )
    rows = [_numbers(part) for part in parts]
    allowed = np.maximum(TOLERANCE[real] * sizes(command), SLACK * np.minimum(off, NO_MATTER))
    if not same:
        allowed = np.full_like(allowed, NO_MATTER)
        allowed[:OF_A_RUN, 0] = LOOSE * sizes(command)[:OF_A_RUN, 0]
        firm = [k for k in firm if k < OF_A_RUN or int(status[k]) & HELD]
    # A command's leaves: the torque, the memory, the signals.
    kept = len(jax.tree.leaves(command.memory))
    return Golden(
        rows=[[part[k] for part in rows] for k in firm],
        statuses=[int(status[k]) for k in firm],
        within=[[[allowed[k, 0], *allowed[k, 1 + kept :]], [*allowed[k, 1 : 1 + kept]]] for k in firm],
    )


def _of_the_run(scenario: Scenario, guard: GuardedStep) -> Sample:
    """The first samples of the closed loop, and others spread over all of it."""
    samples = recorded(scenario, guard).samples
    count = len(samples.t)
    first = min(OF_A_RUN // 4, count - 1)
    which = np.concatenate([np.arange(first), np.linspace(first, count - 1, OF_A_RUN - first).astype(int)])
    return jax.tree.map(lambda values: jnp.asarray(values[which]), samples)


def _rounded(tree: Any) -> Any:
    """Round to floats, stored as doubles."""
    return jax.tree.map(
        lambda x: x.astype(jnp.float32).astype(x.dtype) if jnp.issubdtype(x.dtype, jnp.inexact) else x, tree
    )


def sensitivity(
    guard: GuardedStep, samples: Sample, command: Command, status: Status, last_digit: float
) -> tuple[np.ndarray, list[int]]:
    """Change of each leaf of the command with the inputs' last digit, and the samples whose status does not change.

    - `last_digit`: relative to the number.
    """
    rng = np.random.default_rng(3)

    def nudged(x: Any) -> Any:
        if not jnp.issubdtype(x.dtype, jnp.inexact):
            return x
        return x * (1.0 + last_digit * rng.choice([-1.0, 1.0], x.shape))

    worst = np.zeros((len(status), len(jax.tree.leaves(command))))
    firm = np.ones(len(status), bool)
    for _ in range(PERTURBATIONS):
        moved, other = answer(jax.tree.map(nudged, guard), jax.tree.map(nudged, samples))
        firm &= np.asarray(other) == np.asarray(status)
        with np.errstate(invalid="ignore"):
            change = jax.tree.map(lambda a, b: np.asarray(a, float) - np.asarray(b, float), moved, command)
        worst = np.fmax(worst, sizes(change))
    return worst, np.flatnonzero(firm).tolist()


def sizes(tree: Any) -> np.ndarray:
    """Largest finite number in each leaf for each sample, by rows; 0 if there is none."""
    leaves = [np.abs(np.asarray(leaf, float)).reshape(len(leaf), -1) for leaf in jax.tree.leaves(tree)]
    return np.stack([np.where(np.isfinite(leaf), leaf, 0.0).max(1) for leaf in leaves], axis=1)


def _numbers(tree: Any) -> list[list[Any]]:
    """One list per sample: its numbers in the order of the tree's leaves, each leaf a list or a number."""
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]

    def row(k: int) -> list[Any]:
        return [leaf[k].ravel().tolist() if leaf.ndim > 1 else leaf[k].item() for leaf in leaves]

    return [row(k) for k in range(len(leaves[0]))]
