"""The worst-case recursion with delay, noise and s⁺: steps of the law's own plan on many disturbed joints."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from slidax.certify.loop.envelope import SampledEnvelope, worst_case_reach
from slidax.law import EnvelopeFrame, FixedTime, PrescribedPerformance, Sides, SmoothFixedTime
from slidax.law.implicit_steps import Barrier

from .counted import Counted

SAMPLES = 200
LONGEST = 4
"""Largest delay [periods]."""


def drawn(rng: np.random.Generator, joints: int) -> dict:
    """Joints with random envelopes, surfaces, starts and disturbance bounds; one h, H, delay and noise."""
    h = float(10 ** rng.uniform(-3.7, -2.0))
    horizon = h * float(rng.uniform(1.5, 12.0))
    overshoot = float(rng.uniform(0.1, 1.0 - 1e-9))
    final = 10 ** rng.uniform(-4.5, -1.5, joints)
    initial = final * 10 ** rng.uniform(0.3, 3.0, joints)
    deadline = h * rng.uniform(0.2, 1.5, joints) * SAMPLES
    envelope = PrescribedPerformance(FixedTime(initial, final, deadline, float(rng.uniform(2.01, 3.0))), overshoot)
    sign = rng.choice([-1.0, 1.0], joints)
    sides = Sides(jnp.asarray(np.where(sign > 0, -overshoot, -1.0)), jnp.asarray(np.where(sign > 0, 1.0, overshoot)))
    sampled = SampledEnvelope.of(envelope, sides, period=h, horizon=horizon, times=np.arange(SAMPLES) * h)
    surface = SmoothFixedTime(
        k1=rng.uniform(0.05, 2.0, joints),
        k2=rng.uniform(0.05, 2.0, joints),
        p=rng.uniform(0.2, 0.9, joints),
        q=rng.uniform(1.1, 2.0, joints),
        delta=10 ** rng.uniform(-3.0, -0.5, joints),
    )
    delay = float(rng.choice([0.0, 1.0, 2.0, rng.uniform(0.0, LONGEST - 1.0)]))
    size = overshoot * final / horizon**2
    noisy = float(rng.choice([0.0, 1.0]))
    noise = (
        noisy * float(np.min(final)) * 10 ** rng.uniform(-3.0, -1.0),
        noisy * float(np.min(final)) / horizon * 10 ** rng.uniform(-3.0, -1.0),
    )
    return {
        "seen": sampled,
        "surface": surface,
        "missed": size * 10 ** rng.uniform(-2.0, 0.5, joints) * np.ones((SAMPLES, 1)),
        "s_next": rng.choice([0.0, 1.0]) * final * 10 ** rng.uniform(-2.0, 0.0, joints) * np.ones((SAMPLES, 1)),
        "start": sign * initial * overshoot * 10 ** rng.uniform(-6.0, -0.02, joints),
        "speed": initial * overshoot / horizon * rng.uniform(-0.1, 0.1, joints),
        "delay": delay,
        "noise": noise,
    }


@functools.partial(jax.jit)
def _stepped(surface, sides, numbers, each, start):
    """Errors under given disturbances [N n]: a double integrator with delayed, noisy measurements."""
    h, horizon, part, whole = numbers
    lead = horizon - 0.5 * h

    def step(carry, now):
        e, v, eps, before = carry
        radius, ahead, push, s_next, noise_q, noise_v = now
        # Effect of the last disturbances since the measurement: whole periods, and the rest of an older one.
        ages = jnp.arange(float(LONGEST))[:, None]
        share = jnp.clip(part + whole - ages, 0.0, 1.0)
        unseen_v = h * jnp.sum(share * before, axis=0)
        unseen_e = h * h * jnp.sum(share * before * (ages + 0.5 * share), axis=0)
        seen_e, seen_v = e - unseen_e + noise_q, v - unseen_v + noise_v
        y = seen_e + lead * seen_v
        frame = EnvelopeFrame(now=radius, ahead=radius, sides=sides)
        barrier = Barrier(frame, surface, horizon)
        eps = barrier.solve(y + horizon * s_next, eps, barrier.value_and_slope(eps))
        place = frame.psi_and_slope(eps)[0]
        a = ((ahead * place - y) / horizon - seen_v) / horizon + push
        after = e + h * v + 0.5 * h * h * a, v + h * a, eps, jnp.concatenate([push[None], before[:-1]])
        return after, e

    e, v = start
    begun = (e, v, jnp.zeros_like(e), jnp.zeros((LONGEST, e.size)))
    return jax.lax.scan(step, begun, each)[1]


def courses(rng: np.random.Generator, joints: int, kinds: int) -> np.ndarray:
    """Signs of disturbances over time [kinds N n]: outwards on either side, alternating, random, and reversed once."""
    signs = np.empty((kinds, SAMPLES, joints))
    k = np.arange(SAMPLES)[:, None]
    for kind in range(kinds):
        if kind < 2:
            signs[kind] = 1.0 - 2.0 * kind
        elif kind == 2:
            signs[kind] = np.sign(np.sin(10 ** rng.uniform(-2.0, 0.3, joints) * k + rng.uniform(0.0, 6.0, joints)))
        elif kind == 3:
            signs[kind] = rng.choice([-1.0, 1.0], (SAMPLES, joints))
        else:
            signs[kind] = np.where(k < rng.integers(0, SAMPLES, joints), -1.0, 1.0)
    return signs


def judged(seed: int, groups: int, joints: int, count: Counted, kinds: int = 5) -> None:
    """Count the joints of some groups."""
    for group in range(groups):
        rng = np.random.default_rng([seed, group])
        joint_data = drawn(rng, joints)
        envelope, surface, noise = joint_data["seen"], joint_data["surface"], joint_data["noise"]
        e, v = joint_data["start"], joint_data["speed"]
        start = (e + envelope.lead * v, e)
        bound = worst_case_reach(
            envelope, surface, joint_data["missed"], start, joint_data["delay"], noise, joint_data["s_next"]
        )
        sides = Sides(jnp.asarray(envelope.lower), jnp.asarray(envelope.upper))
        numbers = tuple(
            jnp.asarray(number)
            for number in (envelope.period, envelope.horizon, joint_data["delay"] % 1.0, joint_data["delay"] // 1.0)
        )
        below, above = bound.error
        nearest = np.zeros(joints)
        gone = np.zeros(joints, bool)
        for signs in courses(rng, joints, kinds):
            # Noise the other way makes the plan aim outwards; every so often it is anything.
            against = np.where(rng.uniform(size=joints) < 0.5, -signs, rng.choice([-1.0, 1.0], signs.shape))
            each = (
                envelope.now,
                envelope.ahead,
                signs * joint_data["missed"],
                signs * joint_data["s_next"],
                against * noise[0],
                against * noise[1],
            )
            errors = np.asarray(_stepped(surface, sides, numbers, tuple(map(jnp.asarray, each)), (e, v)))
            size = np.maximum(np.where(errors > 0, above, below), 1e-15)
            nearest = np.maximum(nearest, np.max(np.abs(errors) / size, axis=0))
            gone |= np.any(
                (errors >= envelope.upper * envelope.radius) | (errors <= envelope.lower * envelope.radius), axis=0
            )
        where = f"seed {seed}, group {group}"
        count.kept(nearest, 1, where)
        wrong = gone & bound.holds
        count.refused += int((gone & ~bound.holds).sum())
        count.missed += int(wrong.sum())
