"""The monitor on linear arms: each run that leaves its envelope was warned about before."""

import jax.numpy as jnp
import numpy as np

from slidax.core.types import State
from slidax.law.sampled.monitor import Monitor
from slidax.simulation import Plant

from .batches import simulated
from .counted import Counted
from .linear_arm import Changing, LinearArm, scenario

SAMPLES = 240


def _watched(law):
    return law.__class__(**{**vars(law), "monitor": Monitor(share=1.0, led=1.0)})


def judged(seed: int, laws: int, runs: int, joints: int, count: Counted, *, kalman: bool = False) -> None:
    """Count runs that leave their envelope by whether a warning came before, or at the same sample."""
    rng = np.random.default_rng([seed, joints, kalman])
    period = float(10 ** rng.uniform(-3.3, -2.4))
    options = {"delay": 0, "kalman": kalman, "resolution": 0.0, "samples": SAMPLES}
    scenarios = [scenario(rng, **options, joints=joints, period=period) for _ in range(laws)]
    first = scenarios[0]
    watched = [_watched(item.controller) for item in scenarios]
    final = np.stack([np.asarray(item.step.transformation.performance.final) * np.ones(joints) for item in watched])
    horizon = np.array([float(item.horizon) for item in watched])
    size = final[:, None, None] / horizon[:, None, None, None] ** 2 * 10 ** rng.uniform(-2.0, 2.0, (laws, runs, 1, 1))
    shape = (laws, runs, 1, joints)
    k = np.arange(SAMPLES + 1)[:, None]
    turning = np.sign(np.sin(10 ** rng.uniform(-2.0, 0.3, shape) * k + rng.uniform(0.0, 6.0, shape)))
    kappa = 2.0 ** rng.uniform(-1.0, 1.0, (laws, runs, joints))
    inertia = np.stack([np.asarray(item.nominal.inertia) for item in watched])
    torques = np.einsum("lij,lmkj->lmki", inertia, size * turning)
    starts = np.repeat(np.stack([np.asarray(item.state0.q) for item in scenarios])[:, None], runs, axis=1)

    def parts(law, options):
        mass, torque, q = options
        arm = Plant(LinearArm(mass), Changing(torque, first.period))
        return arm, law, first.trajectory, State(q=q, dq=jnp.zeros(law.joints))

    stepping = first.replace(outside="recover", substeps=4).stepping
    arms = inertia[:, None] / kappa[:, :, :, None]
    run = simulated(watched, (arms, torques, starts), parts, t1=first.t1, stepping=stepping)
    log = run.log
    outside = ((log.e >= log.envelope.upper) | (log.e <= log.envelope.lower)).any(axis=-1)
    # A sample that the gate rejects is a warning of its own: nothing else is computed from it.
    warned = (np.asarray(log.signals["assumption_violated"]) > 0) | (np.asarray(log.signals["rejected"]) > 0)
    left = outside.any(axis=1)
    when = np.argmax(outside, axis=1)
    before = np.array([flags[: k + 1].any() for flags, k in zip(warned, when, strict=True)])
    count.joints.add(joints)
    count.refused += int((left & before).sum())
    count.missed += int((left & ~before).sum())
    if (left & ~before).any():
        count.notes.append(f"{joints} joints, kalman {kalman}: {int((left & ~before).sum())} unwarned")
