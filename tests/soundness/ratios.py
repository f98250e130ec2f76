"""`inertia_ratio`: κ drawn from the certified range, and from beyond the range in which a loop is stable."""

from dataclasses import replace

import numpy as np

from slidax.analysis.run_record import joint_loops
from slidax.certify.arm import inertia_ratio

from .counted import Counted
from .linear_arm import demand, scenario

WIDEST = 8.0


def judged(seed: int, laws: int, kappas: int, joints: int, count: Counted) -> None:
    """Count κ of random laws by the largest modulus of the loop's eigenvalues, which must be below 1."""
    for number in range(laws):
        rng = np.random.default_rng([seed, joints, number])
        delay, kalman = int(rng.integers(3)), bool(rng.integers(2))
        case = scenario(rng, delay=delay, kalman=kalman, resolution=0.0, samples=20, joints=joints)
        request = demand(case)
        borne = inertia_ratio(case, request).bound
        low, high = np.asarray(borne["stable_from"]), np.asarray(borne["stable_to"])
        share = rng.uniform(0.5, 0.999, joints)
        within = replace(request, kappa=np.stack([low**share, high**share]))
        verdict = inertia_ratio(case, within)
        assert verdict.holds, verdict.statement
        loops = joint_loops(case)
        for _ in range(kappas // joints):
            drawn = np.exp(rng.uniform(*np.log(within.kappa)))
            radii = [loop.radius(float(kappa)) for loop, kappa in zip(loops, drawn, strict=True)]  # type: ignore[union-attr]
            count.kept(radii, joints, f"law {number}, {joints} joints", slack=0.0)
        joint = int(rng.integers(joints))
        beyond = np.stack([low**share, high**share])
        down = bool(rng.integers(2)) and low[joint] > 1.0 / 60.0
        end = low[joint] / rng.uniform(1.001, WIDEST) if down else high[joint] * rng.uniform(1.001, WIDEST)
        beyond[0 if down else 1, joint] = end
        if inertia_ratio(case, replace(request, kappa=beyond)).holds:
            count.missed += 1
        else:
            count.refused += 1
