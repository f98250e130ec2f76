"""`loop_rate` on linear arms: the law itself under the worst pushes that are known of, against its bound."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from slidax.certificates.loop.assembled import Assembly, Certified
from slidax.certificates.loop.subject import Subject
from tests.certificates.loop.linear_arm import demand, errors, scenario

SAMPLES = 240
KINDS = [(delay, kalman) for delay in (0, 1, 2) for kalman in (False, True)]

LARGER = 8.0
"""A push so many times as large as what is certified leaves the envelope, or would not be near the edge."""


def worst_pushes(rng, assembly, count, stray):
    """Pushes at the edge: those of the largest e at some time, up to then by the loop's response, and others."""
    joints = len(stray)
    pushes = np.empty((count, SAMPLES + 1, joints))
    kernel = assembly.signed_error
    for i in range(count):
        for joint in range(joints):
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
            pushes[i, :, joint] = rng.choice([-1.0, 1.0]) * stray[joint] * path
    return pushes


def arms(rng, inertia, count, kappa, coupling):
    """True inertias with κ in a range and couplings at their edge, M⁻¹ M0 = K [m n n]."""
    joints = len(inertia)
    k = rng.choice([kappa[0], kappa[1], np.sqrt(kappa[0] * kappa[1])], (count, joints))
    signs = np.triu(rng.choice([-1.0, 0.0, 1.0], (count, joints, joints)), 1)
    off = coupling * np.min(k, axis=1)[:, None, None] * (signs + np.swapaxes(signs, 1, 2))
    share = k[:, :, None] * np.eye(joints) + off
    root = np.sqrt(inertia)
    # K = M⁻¹ M0 with the couplings scaled so that M is symmetric.
    return root @ np.linalg.inv(share) @ root


def edge(rng, one):
    """How wrong the inertia may be, how large a push, and couplings as M's symmetry makes them of the arm's inertias.

    κ's range, the couplings before and after they are scaled, and w̄ [n].
    """
    joints = one.controller.joints
    kappa = [(1.0, 1.0), (0.97, 1.03), (0.9, 1.15)][rng.integers(3)]
    coupling = 0.0 if kappa[0] == 1.0 else float(rng.uniform(0.0, 0.05)) / (joints - 1 or 1)
    root = np.sqrt(np.diagonal(np.asarray(one.controller.nominal.inertia)))
    final = np.asarray(one.controller.step.transformation.performance.final) * np.ones(joints)
    return kappa, coupling, coupling * root[None, :] / root[:, None], 0.3 * final / float(one.controller.horizon) ** 2


def shares_of(found: Certified, e: np.ndarray) -> np.ndarray:
    """The largest share of its bound that each run came to [m].

    - `found`: the bound.
    - `e`: of the runs [m N n].
    """
    below, above = found.bounds.error[:, 0], found.bounds.error[:, 1]
    e = e[:, : len(below)]
    share: np.ndarray = np.max(np.abs(e) / np.maximum(np.where(e > 0, above, below), 1e-12), axis=(1, 2))
    return share


def left(one, found: Certified, e: np.ndarray) -> np.ndarray:
    """Which runs left their envelope at some sample that the bound is about [m].

    - `one`: their scenario.
    - `found`: the bound, of which only times and sides are used.
    - `e`: of the runs [m N n].
    """
    late = round(float(found.narrowing.times[0] - 0.0) / one.period)
    drawn = one.controller.step.transformation.performance
    times = jnp.asarray(np.arange(e.shape[1]) * one.period)
    radius = np.asarray(jax.vmap(lambda t: jnp.broadcast_to(drawn.radius(t), e.shape[2]))(times))
    outside = (e >= found.narrowing.upper * radius) | (e <= found.narrowing.lower * radius)
    gone: np.ndarray = outside[:, late : late + len(found.share)].any(axis=(1, 2))
    return gone


def judged(seed, delay, kalman, laws, runs, joints=2, count=None):
    """The largest share of its bound that an error came to, and how near the steady one came, for each law.

    With a count the same runs are tried again with pushes that are too large, where the certificate must not hold if
    one leaves.
    """
    rng = np.random.default_rng([seed, delay, kalman, joints])
    period, resolution = float(10 ** rng.uniform(-3.3, -2.4)), float(rng.choice([0.0, 1e-6]))
    given = {"delay": delay, "kalman": kalman, "resolution": resolution, "samples": SAMPLES}
    ones = [scenario(rng, **given, joints=joints, period=period) for _ in range(laws)]
    made = [_one(rng, one, runs) for one in ones]
    members, pushes = (np.stack([one[k] for one in made]) for k in (2, 3))
    if count is not None:
        members, pushes = np.concatenate([members] * 2, axis=1), np.concatenate([pushes, LARGER * pushes], axis=1)
    e = errors(ones, members, pushes)
    shares, near, late = [], [], slice(SAMPLES * 3 // 4, None)
    for number, (asked, assembly, _, _) in enumerate(made):
        found, own = assembly.certified(), e[number, :runs]
        each = shares_of(found, own)
        shares.append(float(each.max()))
        near.append(float(np.max(np.abs(own[:, late])) / np.max(found.bounds.error[late])))
        if count is not None:
            where = f"seed {seed}, delay {delay}, kalman {kalman}, law {number}, {joints} joints"
            # At its first sample each run is at its bound.
            count.kept(each, joints, where, nearest=near[-1])
            larger = replace(asked, stray=LARGER * np.asarray(asked.stray))
            beyond = Assembly(assembly.subject, larger).certified()
            gone = int(left(ones[number], beyond, e[number, runs:]).sum())
            if float(np.max(beyond.share)) < 1.0:
                count.missed += gone
            else:
                count.refused += gone
    return np.array(shares), np.array(near)


def _one(rng, one, runs):
    """What is asked of a law's loops, its bounds, and arms and pushes at the edge of that."""
    kappa, coupling, scaled, stray = edge(rng, one)
    subject = Subject.of(one)
    assert isinstance(subject, Subject)
    asked = demand(one, stray=stray, kappa=kappa, coupling=scaled)
    assembly = Assembly(subject, asked)
    inertia = np.asarray(one.controller.nominal.inertia)
    return asked, assembly, arms(rng, inertia, runs, kappa, coupling), worst_pushes(rng, assembly, runs, stray)
