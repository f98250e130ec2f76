"""No certified bound is exceeded: the law itself on random arms, with the worst pushes that are known of."""

from __future__ import annotations

import numpy as np
import pytest

from slidax.certificates.loop.assembled import Assembly
from slidax.certificates.loop.subject import Subject
from tests.certificates.loop.linear_arm import demand, errors, scenario

SAMPLES = 240
KINDS = [(delay, kalman) for delay in (0, 1, 2) for kalman in (False, True)]


def worst_pushes(rng, assembly, count, stray):
    """Pushes at the edge: those of the largest e at some time, up to then by the loop's response, and others."""
    pushes = np.empty((count, SAMPLES + 1, 2))
    kernel = assembly.signed_error
    for i in range(count):
        for joint in range(2):
            kind = rng.integers(4)
            if kind == 0:
                until = rng.integers(SAMPLES // 2, SAMPLES)
                signs = np.sign(kernel[joint])[: until + 1][::-1]
                path = np.concatenate([np.full(until + 1 - signs.size, signs[0]), signs, np.full(SAMPLES - until, 1.0)])
            elif kind == 1:
                path = np.full(SAMPLES + 1, 1.0)
            elif kind == 2:
                path = np.sign(np.sin(10 ** rng.uniform(-2.0, 0.3) * np.arange(SAMPLES + 1) + rng.uniform(0.0, 6.0)))
            else:
                path = rng.choice([-1.0, 1.0], SAMPLES + 1)
            pushes[i, :, joint] = rng.choice([-1.0, 1.0]) * stray * path
    return pushes


def arms(rng, inertia, count, kappa, coupling):
    """True inertias with κ in a range and as much coupling as is said [m n n]."""
    k = rng.choice([kappa[0], kappa[1], np.sqrt(kappa[0] * kappa[1])], (count, 2))
    off = coupling * np.min(k, axis=1) * rng.choice([-1.0, 0.0, 1.0], count)
    share = np.stack([np.stack([k[:, 0], off], axis=1), np.stack([off, k[:, 1]], axis=1)], axis=1)
    root = np.sqrt(inertia)
    # K = M⁻¹ M0 with the couplings scaled so that M is symmetric.
    return root @ np.linalg.inv(share) @ root


def judged(seed, delay, kalman, laws, runs):
    """The largest share of its bound that an error came to, and how near the steady one came, for each law."""
    shares, near = [], []
    for number in range(laws):
        rng = np.random.default_rng([seed, delay, kalman, number])
        resolution = float(rng.choice([0.0, 1e-6]))
        one = scenario(rng, delay=delay, kalman=kalman, resolution=resolution, samples=SAMPLES)
        inertia = np.asarray(one.controller.nominal.inertia)
        # Of equal inertias the coupling is what K says; of others it is that times the root of their ratio.
        ratio = np.sqrt(np.max(np.diagonal(inertia)) / np.min(np.diagonal(inertia)))
        kappa = [(1.0, 1.0), (0.97, 1.03), (0.9, 1.15)][rng.integers(3)]
        coupling = 0.0 if kappa[0] == 1.0 else float(rng.uniform(0.0, 0.05))
        stray = (
            0.3
            * float(np.min(one.controller.step.transformation.performance.final))
            / float(one.controller.horizon) ** 2
        )
        subject = Subject.of(one)
        assert isinstance(subject, Subject)
        assembly = Assembly(subject, demand(one, stray=stray, kappa=kappa, coupling=coupling * ratio))
        found = assembly.certified()
        pushes = worst_pushes(rng, assembly, runs, stray)
        e = errors(one, arms(rng, inertia, runs, kappa, coupling), pushes)[:, : found.bounds.error.shape[0]]
        below, above = found.bounds.error[:, 0], found.bounds.error[:, 1]
        shares.append(float(np.max(np.abs(e) / np.maximum(np.where(e > 0, above, below), 1e-12))))
        late = slice(SAMPLES * 3 // 4, None)
        near.append(float(np.max(np.abs(e[:, late])) / np.max(found.bounds.error[late])))
    return np.array(shares), np.array(near)


@pytest.mark.parametrize(("delay", "kalman"), [(0, False), (1, True)])
def test_no_error_of_the_law_itself_exceeds_its_bound(delay, kalman):
    shares, near = judged(1, delay, kalman, laws=2, runs=100)
    assert shares.max() <= 1.0 + 1e-6
    assert np.median(near) > 1.0 / 3.0


@pytest.mark.full
@pytest.mark.parametrize(("delay", "kalman"), KINDS)
def test_no_error_exceeds_its_bound_in_many_cases(delay, kalman):
    shares, near = judged(2, delay, kalman, laws=34, runs=500)
    assert shares.max() <= 1.0 + 1e-6
    assert np.median(near) > 1.0 / 3.0
