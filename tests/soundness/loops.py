"""`loop_rate` on linear arms: the law itself under the worst known disturbances, against its bound."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from slidax.certify.loop.bound_recursion import CertifiedBounds
from slidax.certify.loop.decoupled_bound import DecoupledProblem
from slidax.certify.loop.problem import LoopProblem
from tests.certify.loop.linear_arm import demand, errors, scenario

SAMPLES = 240
KINDS = [(delay, kalman) for delay in (0, 1, 2) for kalman in (False, True)]

LARGER = 8.0
"""Factor by which a disturbance leaves the envelope, if the bound is sharp."""


def worst_pushes(rng, assembly, count, stray):
    """Disturbances at their bound: those with the largest e at some time, by the loop's response, and others."""
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
    """True inertias with κ in a range and couplings at their bound, M⁻¹ M0 = K [m n n]."""
    joints = len(inertia)
    k = rng.choice([kappa[0], kappa[1], np.sqrt(kappa[0] * kappa[1])], (count, joints))
    signs = np.triu(rng.choice([-1.0, 0.0, 1.0], (count, joints, joints)), 1)
    off = coupling * np.min(k, axis=1)[:, None, None] * (signs + np.swapaxes(signs, 1, 2))
    share = k[:, :, None] * np.eye(joints) + off
    root = np.sqrt(inertia)
    # K = M⁻¹ M0 with the couplings scaled so that M is symmetric.
    return root @ np.linalg.inv(share) @ root


def edge(rng, case):
    """Range of κ, couplings before and after scaling for a symmetric M, and w̄ [n]."""
    joints = case.controller.joints
    kappa = [(1.0, 1.0), (0.97, 1.03), (0.9, 1.15)][rng.integers(3)]
    coupling = 0.0 if kappa[0] == 1.0 else float(rng.uniform(0.0, 0.05)) / (joints - 1 or 1)
    root = np.sqrt(np.diagonal(np.asarray(case.controller.nominal.inertia)))
    final = np.asarray(case.controller.step.transformation.performance.final) * np.ones(joints)
    return kappa, coupling, coupling * root[None, :] / root[:, None], 0.3 * final / float(case.controller.horizon) ** 2


def shares_of(bounds: CertifiedBounds, e: np.ndarray) -> np.ndarray:
    """The largest share of its bound that each run reached [m]."""
    below, above = bounds.bounds.error[:, 0], bounds.bounds.error[:, 1]
    e = e[:, : len(below)]
    share: np.ndarray = np.max(np.abs(e) / np.maximum(np.where(e > 0, above, below), 1e-12), axis=(1, 2))
    return share


def left(case, bounds: CertifiedBounds, e: np.ndarray) -> np.ndarray:
    """True for runs that left their envelope at some sample of the bound [m]."""
    late = round(float(bounds.narrowing.times[0] - 0.0) / case.period)
    drawn = case.controller.step.transformation.performance
    times = jnp.asarray(np.arange(e.shape[1]) * case.period)
    radius = np.asarray(jax.vmap(lambda t: jnp.broadcast_to(drawn.radius(t), e.shape[2]))(times))
    outside = (e >= bounds.narrowing.upper * radius) | (e <= bounds.narrowing.lower * radius)
    gone: np.ndarray = outside[:, late : late + len(bounds.share)].any(axis=(1, 2))
    return gone


def judged(seed, delay, kalman, laws, runs, joints=2, count=None):
    """The largest share of its bound that an error reached, and the sharpness for constant disturbances, for each law.

    With a count the runs are repeated with too large disturbances, where the certificate must not hold if a run leaves.
    """
    rng = np.random.default_rng([seed, delay, kalman, joints])
    period, resolution = float(10 ** rng.uniform(-3.3, -2.4)), float(rng.choice([0.0, 1e-6]))
    options = {"delay": delay, "kalman": kalman, "resolution": resolution, "samples": SAMPLES}
    ones = [scenario(rng, **options, joints=joints, period=period) for _ in range(laws)]
    problems = [_problem(rng, case, runs) for case in ones]
    members, pushes = (np.stack([case[k] for case in problems]) for k in (2, 3))
    if count is not None:
        members, pushes = np.concatenate([members] * 2, axis=1), np.concatenate([pushes, LARGER * pushes], axis=1)
    e = errors(ones, members, pushes)
    shares, near, late = [], [], slice(SAMPLES * 3 // 4, None)
    for number, (request, assembly, _, _) in enumerate(problems):
        bounds, own = assembly.certified(), e[number, :runs]
        each = shares_of(bounds, own)
        shares.append(float(each.max()))
        near.append(float(np.max(np.abs(own[:, late])) / np.max(bounds.bounds.error[late])))
        if count is not None:
            where = f"seed {seed}, delay {delay}, kalman {kalman}, law {number}, {joints} joints"
            # At its first sample each run is at its bound.
            count.kept(each, joints, where, nearest=near[-1])
            larger = replace(request, stray=LARGER * np.asarray(request.stray))
            beyond = DecoupledProblem(assembly.subject, larger).certified()
            gone = int(left(ones[number], beyond, e[number, runs:]).sum())
            if float(np.max(beyond.share)) < 1.0:
                count.missed += gone
            else:
                count.refused += gone
    return np.array(shares), np.array(near)


def _problem(rng, case, runs):
    """The demand on a law's loops, its bounds, and arms and disturbances at the edge of the demand."""
    kappa, coupling, scaled, stray = edge(rng, case)
    subject = LoopProblem.of(case)
    assert isinstance(subject, LoopProblem)
    request = demand(case, stray=stray, kappa=kappa, coupling=scaled)
    assembly = DecoupledProblem(subject, request)
    inertia = np.asarray(case.controller.nominal.inertia)
    return request, assembly, arms(rng, inertia, runs, kappa, coupling), worst_pushes(rng, assembly, runs, stray)
