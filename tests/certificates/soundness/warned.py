"""The monitor on linear arms: no run leaves its envelope that was not warned of before."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from slidax.controllers.sampled_data.monitor import Monitor
from slidax.simulation import Plant, simulate_batch
from tests.certificates.loop.linear_arm import Changing, LinearArm, scenario

from .counted import Counted

SAMPLES = 240


def judged(seed: int, laws: int, runs: int, joints: int, count: Counted) -> None:
    """Counts runs that leave by whether they were warned of at an earlier sample, or at the same.

    - `seed`: of all that is drawn.
    - `laws`, `runs`: how many, and of each law.
    - `joints`: of the arms.
    - `count`: in which they are counted: warned as refused, not warned as missed.
    """
    for number in range(laws):
        rng = np.random.default_rng([seed, joints, number])
        kalman = bool(rng.integers(2))
        one = scenario(rng, delay=0, kalman=kalman, resolution=0.0, samples=SAMPLES, joints=joints)
        law = one.controller
        watched = law.__class__(**{**vars(law), "monitor": Monitor(share=1.0, led=1.0)})
        final = np.asarray(law.step.transformation.performance.final) * np.ones(joints)
        size = final / float(law.horizon) ** 2 * 10 ** rng.uniform(-2.0, 2.0, (runs, 1, 1))
        turning = np.sign(np.sin(10 ** rng.uniform(-2.0, 0.3, (runs, 1, joints)) * np.arange(SAMPLES + 1)[:, None]
                                 + rng.uniform(0.0, 6.0, (runs, 1, joints))))  # fmt: skip
        kappa = 2.0 ** rng.uniform(-1.0, 1.0, (runs, joints))
        inertia = np.asarray(law.nominal.inertia)
        torques = np.einsum("ij,mkj->mki", inertia, size * turning)

        def define(given, one=one, watched=watched):
            mass, torque = given
            return Plant(LinearArm(mass), Changing(torque, one.period)), watched, one.trajectory, one.state0

        run = simulate_batch(
            define,
            (jnp.asarray(inertia[None] / kappa[:, :, None]), jnp.asarray(torques)),
            t1=one.t1,
            stepping=one.replace(outside="recover", substeps=4).stepping,
            log_every=1,
            threads=1,
        )
        log = run.log
        outside = ((log.e >= log.envelope.upper) | (log.e <= log.envelope.lower)).any(axis=-1)
        warned = np.asarray(log.signals["assumption_violated"]) > 0
        left = outside.any(axis=1)
        first = np.argmax(outside, axis=1)
        before = np.array([flags[: k + 1].any() for flags, k in zip(warned, first, strict=True)])
        count.joints.add(joints)
        count.refused += int((left & before).sum())
        count.missed += int((left & ~before).sum())
        if (left & ~before).any():
            count.notes.append(f"law {number}, {joints} joints, kalman {kalman}: {int((left & ~before).sum())} unwarned")
