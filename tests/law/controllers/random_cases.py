"""Random admissible closed loops of the sampled-data law: gains, arms, periods, disturbances and starts."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from slidax.arms import Scara, TwoLink
from slidax.core.types import State
from slidax.law import FixedTime, Measured, SampledData, UncertaintyBound, cftsmppc, sampled_data
from slidax.plant import Harmonic
from slidax.simulation import Plant, Run, simulate_batch
from tests.paper_examples import MOTION_4_1, MOTION_4_2, SCARA, TWO_LINK

PERIODS = (1e-4, 2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3)
T1 = 1.2
"""The end [s]; the deadlines come before it."""


class Arm(NamedTuple):
    robot: TwoLink | Scara
    motion: object
    bound: tuple[float, float]
    strength: float
    """How large disturbances are, N m."""


ARMS = {
    "two_link": Arm(TWO_LINK, MOTION_4_1, (0.09, 0.2), 6.0),
    "scara": Arm(SCARA, MOTION_4_2, (0.9, 1.1), 2.0),
}


def draw(arm: Arm, period: float, cases: int, seed: int) -> dict[str, jnp.ndarray]:
    """The numbers of so many cases, each with the case as its first axis.

    - `arm`: whose.
    - `period`: h [s].
    - `cases`: how many.
    - `seed`: another seed draws others.
    """
    rng, n = np.random.default_rng(seed), arm.robot.joints

    def flat(low: float, high: float, *shape: int) -> jnp.ndarray:
        return jnp.asarray(rng.uniform(low, high, (cases, *shape)))

    def log(low: float, high: float, *shape: int) -> jnp.ndarray:
        return 10.0 ** flat(np.log10(low), np.log10(high), *shape)

    error = flat(-0.4, 0.4, n)
    return {
        "k1": log(0.1, 1.0), "k2": log(0.3, 1.5), "p": flat(0.3, 0.8), "q": flat(1.05, 1.6),
        "delta": log(0.005, 0.1), "k0": log(0.01, 10.0), "r": flat(1.05, 2.0),
        # Half of them have the set-valued unit vector.
        "layer": jnp.where(flat(0, 1) < 0.5, 0.0, log(1e-3, 1e-1)),
        "overshoot": flat(0.1, 0.8),
        "final": log(5e-4, 3e-2),
        "initial": (jnp.abs(error) + 0.03) * flat(1.2, 3.0, n),
        "deadline": flat(0.5, 0.9),
        "horizon": period * flat(1.0, 6.0),
        "gain": jnp.where(flat(0, 1) < 0.5, 0.0, flat(0.1, 0.5)),
        "model": flat(0.75, 1.25),
        "error": error, "speed": flat(-0.3, 0.3, n),
        "amplitude": arm.strength * flat(-1.0, 1.0, n), "frequency": log(0.5, 60.0), "phase": flat(0.0, 6.0, n),
    }  # fmt: skip


def controller(arm: Arm, period: float, x: dict[str, jnp.ndarray]) -> SampledData:
    """The law of one case.

    - `arm`: whose.
    - `period`: h [s].
    - `x`: the numbers of the case.
    """
    low, high = arm.bound
    robot = arm.robot
    nominal = jax.tree.map(lambda leaf: leaf, robot)
    nominal = type(robot)(**{k: v * x["model"] if k in ("masses", "inertias") else v for k, v in vars(nominal).items()})
    law = cftsmppc(
        nominal,
        performance=FixedTime(x["initial"], jnp.minimum(x["final"], 0.5 * x["initial"].min()), x["deadline"], 2.01),
        overshoot=x["overshoot"],
        bound=UncertaintyBound(low, high, 12.0, 2.2, 2.8, 1.0),
        gain=x["k0"],
        exponent=x["r"],
        **{k: x[k] for k in ("k1", "k2", "p", "q", "delta", "layer")},
    )
    estimator = Measured(x["gain"])
    return sampled_data(law, period=period, horizon=x["horizon"], estimator=estimator)


def runs(arm: Arm, period: float, numbers: dict[str, jnp.ndarray]) -> Run:
    """All cases, simulated; the runs go on outside the envelope.

    - `arm`: whose.
    - `period`: h [s].
    - `numbers`: of the cases.
    """
    reference = arm.motion.reference(jnp.zeros(()))

    def define(x):
        start = State(q=reference.q + x["error"], dq=reference.dq + x["speed"])
        plant = Plant(arm.robot, Harmonic(x["amplitude"], x["frequency"], x["phase"]))
        return plant, controller(arm, period, x), arm.motion, start

    t1 = round(T1 / period) * period
    return simulate_batch(define, numbers, t1=t1, period=period, substeps=2, log_every=1, outside="recover")
