"""A closed loop as a compiled program, for thousands of runs without their logs."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from slidax.codegen import c_code, trace
from slidax.scenarios.scenario import Scenario
from slidax.simulation.loop import begin, sample
from slidax.simulation.simulate import BatchRequest
from slidax.simulation.stepping import Stepping

COMPILER = ["cc", "-O2", "-march=native", "-ffp-contract=off"]
RESULTS = "peak", "outside", "lost", "steady"
"""Largest error [rad] and samples outside from a given time on, 1 for a run that ends outside, and the largest error of
the last samples [rad]."""


class CompiledLoop:
    """The closed loop of a scenario's law, whose arm and motion follow from the values of a run.

    - `define`: map from the values to plant, law, motion and state, as of `simulate_batch`.
    - `example`: values of one run.
    - `folder`: of the program.
    """

    def __init__(
        self,
        scenario: Scenario,
        define: Callable[[Any], Any],
        example: dict[str, np.ndarray],
        t1: float,
        folder: Path,
    ) -> None:
        self.period = scenario.period
        self.samples = round(t1 / self.period) + 1
        self.names = sorted(example)
        shapes = {name: np.shape(example[name]) for name in self.names}
        request = BatchRequest(define, t1, Stepping.of(scenario.stepping, {}), 1, ())

        def unpacked(row: jax.Array) -> dict[str, jax.Array]:
            values, at = {}, 0
            for name, shape in shapes.items():
                size = int(np.prod(shape))
                values[name], at = row[at : at + size].reshape(shape), at + size
            return values

        def begun(row: jax.Array) -> Any:
            return begin(*request.start(unpacked(row)))[0]

        row = jnp.asarray(self._rows({name: np.asarray(value)[None] for name, value in example.items()})[0])
        leaves, tree = jax.tree.flatten(eqx.filter_eval_shape(begun, row))

        def packed(carry: Any) -> jax.Array:
            return jnp.concatenate([jnp.asarray(leaf).astype(float).reshape(-1) for leaf in jax.tree.leaves(carry)])

        def step(row: jax.Array, state: jax.Array) -> tuple[jax.Array, jax.Array]:
            ends = np.cumsum([leaf.size for leaf in leaves])[:-1]
            parts = zip(jnp.split(state, ends), leaves, strict=True)
            carry = jax.tree.unflatten(tree, [part.reshape(leaf.shape).astype(leaf.dtype) for part, leaf in parts])
            after, log = sample(request.start(unpacked(row))[0], carry)
            assert log.envelope is not None
            return packed(after), jnp.concatenate([log.e, log.envelope.lower, log.envelope.upper])

        self.size = sum(leaf.size for leaf in leaves)
        self.joints = scenario.plant.robot.joints
        self.program = folder / "loop"
        sources = [Path(__file__).with_suffix(".c")]
        for name, traced in (
            ("first", trace(lambda row: packed(begun(row)), row, named=False)),
            ("step", trace(step, row, jnp.zeros(self.size), named=False)),
        ):
            sources.append(folder / f"{name}.c")
            sources[-1].write_text(c_code(traced, name))
        subprocess.run([*COMPILER, *sources, "-lm", "-o", self.program], check=True)

    def _rows(self, values: dict[str, np.ndarray]) -> np.ndarray:
        runs = len(values[self.names[0]])
        return np.concatenate([np.asarray(values[name], float).reshape(runs, -1) for name in self.names], axis=1)

    def measured(
        self, values: dict[str, np.ndarray], since: np.ndarray, tail: float, workers: int | None = None
    ) -> dict[str, np.ndarray]:
        """Return `RESULTS` of each run.

        - `since`: time from which peak and samples outside count [runs], s.
        - `tail`: time before the end over which the steady error is taken [s].
        - `workers`: processes; None for one for each processor.
        """
        rows = self._rows(values)
        numbers = len(rows), rows.shape[1], self.size, self.joints, self.samples, round(tail / self.period)
        words = [str(number) for number in (*numbers, workers or os.cpu_count())]
        first = np.ceil(since / self.period - 1e-6)[:, None]
        done = subprocess.run(
            [self.program, *words], input=np.hstack([first, rows]).tobytes(), stdout=subprocess.PIPE, check=True
        )
        return dict(zip(RESULTS, np.frombuffer(done.stdout).reshape(len(rows), -1).T, strict=True))
