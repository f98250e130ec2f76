"""Random motions of an identified arm: how many of them a certified law tracks within its bound."""

from __future__ import annotations

import argparse
import dataclasses
import time
from functools import cache
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import slidax.arms as arms
from slidax.certify.motion.admission import admit, certified_law
from slidax.certify.motion.body_points import BodyPoints
from slidax.certify.motion.certified_law import CertifiedLaw
from slidax.certify.motion.joint_loop import JointLoop
from slidax.certify.motion.tracking_bound import ArmUncertainty
from slidax.identify import excite, identify
from slidax.motions import Streamed, StreamFilter
from slidax.scenarios import load
from tests.certify.motion import cases
from tests.identify.recorded import recorded

from .shared import ROOT

RATES = {"panda": 1e3, "ur5e": 5e2}
SLOWEST = 2.0
"""Largest factor on a motion's time that counts."""


@cache
def identified_arm(name: str, seconds: float) -> tuple[Any, Any]:
    """An arm with a payload and friction of 0.3 N m, and its band, from a log with 1 % of torque noise.

    The arm that is known beforehand is that of the data sheet, without payload and with other rotors and friction.
    """
    true = {"panda": cases.panda, "ur5e": cases.ur5e}[name]()
    true = eqx.tree_at(lambda arm: arm.coulomb, true, jnp.full(true.joints, 0.3))
    known = getattr(arms, name)()
    motion = excite(known, seed=0, duration=seconds, rate=RATES[name], payload=true.payload, links=True).motion
    times = np.arange(len(motion.q)) / RATES[name]
    result = identify(recorded(true, noise=0.01, seed=0, times_and_motion=(times, motion)), known, links=True)
    return result.robot, result.band


def law_of(name: str, horizon: float, density: float, resolution: float, seconds: float) -> CertifiedLaw:
    """The certified law of an identified arm, with the torque limits of its data sheet."""
    arm, band = identified_arm(name, seconds)
    law = certified_law(load(ROOT / "examples" / "motions" / "panda.yaml"))
    gate = dataclasses.replace(
        law.gate,
        q_max=np.full(arm.joints, 7.0),
        speed=2.0 * np.asarray(arm.limits.velocity),
        acceleration=np.full(arm.joints, float(np.max(np.asarray(law.gate.acceleration)))),
        spread=np.full(arm.joints, float(np.max(np.asarray(law.gate.spread)))),
    )
    return dataclasses.replace(
        law,
        arm=arm,
        bodies=BodyPoints.of(arm),
        loop=JointLoop.with_density(1.0 / RATES[name], horizon, density, resolution),
        uncertainty=ArmUncertainty.identified(arm, band, resolution=resolution),
        gate=gate,
        torque=np.asarray(arm.limits.torque),
        torque_rate=law.torque_rate if name == "panda" else np.full(arm.joints, np.inf),
    )


def measure_motions() -> None:
    """Count random motions, half point to point and half like a planner's, that are certified."""
    parser = argparse.ArgumentParser(description=measure_motions.__doc__)
    parser.add_argument("--arm", choices=sorted(RATES), default="panda")
    parser.add_argument("--horizon", type=float, default=0.007, help="H of the law [s]")
    parser.add_argument("--density", type=float, default=3.0, help="of the Kalman filter [(rad/s³)² s]")
    parser.add_argument("--resolution", type=float, default=1e-5, help="of the encoders [rad]")
    parser.add_argument("--slowest", type=float, default=0.2, help="least share of the largest speeds")
    parser.add_argument("--fastest", type=float, default=0.5, help="largest share of the largest speeds")
    parser.add_argument("--allowed", type=float, default=3e-3, help="largest error [rad]")
    parser.add_argument("--seconds", type=float, default=20.0, help="of the log that identifies the arm")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--slow-down", action="store_true", help="also search how much slower a motion must be")
    options = parser.parse_args()
    law = law_of(options.arm, options.horizon, options.density, options.resolution, options.seconds)
    print(f"{options.arm}: p = {100 * law.uncertainty.region(law.bodies).p:.2f} %", flush=True)
    rng, answers, seconds = np.random.default_rng(options.seed), [], []
    for index in range(options.count):
        motion = (cases.quintic, cases.knotted)[index % 2](law.arm, rng, rng.uniform(options.slowest, options.fastest))
        begun = time.process_time()
        first = admit(law, motion, str(index), allowed=options.allowed, assume_steps=True, slow_down=False)
        seconds.append(time.process_time() - begun)
        proved = all("rate acts" not in line.text or line.status == "proved" for line in first.verdict.assumptions)
        step = first.admitted and proved
        slower = step
        if options.slow_down and not step:
            answer = admit(law, motion, str(index), allowed=options.allowed)
            slower = answer.slow_down is not None and answer.slow_down <= SLOWEST
        bound = np.inf if first.bound is None else float(np.max(first.bound))
        answers.append((bound, first.admitted, step, slower))
        if not first.admitted:
            print(f"  motion {index}: {first.limit}", flush=True)
    bounds, admitted, steps, slower = (np.array(column) for column in zip(*answers, strict=True))
    finite = bounds[np.isfinite(bounds)]
    print(
        f"of {options.count} motions: error within {1e3 * options.allowed:g} mrad {np.sum(bounds <= options.allowed)}, "
        f"and torque limits proved {np.sum(admitted)}, and torque steps proved {np.sum(steps)}"
        + (f", with a slow-down of at most {SLOWEST:g} {np.sum(slower)}" if options.slow_down else "")
    )
    print(f"error: median {1e3 * np.median(bounds):.2f} mrad, largest that is finite {1e3 * np.max(finite):.2f} mrad")
    print(f"time of a motion: median {np.median(seconds):.2f} s, largest {np.max(seconds):.2f} s of processor time")


def random_stream(kind: int, centre: np.ndarray, rng: np.random.Generator, times: np.ndarray) -> np.ndarray:
    """Positions from a host within 0.5 rad of a posture: jumps to new goals, ways to them, or a trembling hand."""
    rate, n = 1.0 / times[1], len(centre)
    if kind == 2:
        waves = rng.uniform(0.02, 0.15, (3, n, 1)) * np.sin(
            2.0 * np.pi * rng.uniform(0.1, 1.5, (3, n, 1)) * times + rng.uniform(0.0, 2.0 * np.pi, (3, n, 1))
        )
        hand: np.ndarray = centre + waves.sum(0).T + rng.normal(scale=5e-4, size=(len(times), n))
        return hand
    new = np.concatenate([[False], rng.random(len(times) - 1) < 1.0 / rate])
    goals = np.where(new[:, None], rng.uniform(-0.5, 0.5, (len(times), n)), 0.0)
    goals = centre + goals[np.maximum.accumulate(np.where(new, np.arange(len(times)), 0))]
    if kind == 1:
        for k in range(1, len(goals)):
            goals[k] = goals[k - 1] + np.clip(goals[k] - goals[k - 1], -1.0 / rate, 1.0 / rate)
    return goals


def measure_streams() -> None:
    """Bound the error along random streams of positions: jumps, ways and a trembling hand."""
    parser = argparse.ArgumentParser(description=measure_streams.__doc__)
    parser.add_argument("--arm", choices=sorted(RATES), default="panda")
    parser.add_argument("--horizon", type=float, default=0.012, help="H of the law [s]")
    parser.add_argument("--density", type=float, default=0.3, help="of the Kalman filter [(rad/s³)² s]")
    parser.add_argument("--resolution", type=float, default=1e-6, help="of the encoders [rad]")
    parser.add_argument("--bandwidth", type=float, default=20.0, help="of the filter [rad/s]")
    parser.add_argument("--acceleration", type=float, default=3.0, help="limit of the filter [rad/s²]")
    parser.add_argument("--speed", type=float, default=1.0, help="limit of the filter [rad/s]")
    parser.add_argument("--rate", type=float, default=50.0, help="the host's positions per second")
    parser.add_argument("--allowed", type=float, default=3e-3, help="largest error [rad]")
    parser.add_argument("--count", type=int, default=60)
    options = parser.parse_args()
    law = law_of(options.arm, options.horizon, options.density, options.resolution, 20.0)
    stream = StreamFilter.fitting(
        bandwidth=options.bandwidth,
        velocity=options.speed,
        acceleration=options.acceleration,
        period=1.0 / RATES[options.arm],
        rate=options.rate,
    )
    rng, times = np.random.default_rng(7), np.arange(0.0, 4.0, 1.0 / options.rate)
    low, high = (np.clip(np.asarray(end), -3.0, 3.0) for end in (law.arm.limits.lower, law.arm.limits.upper))
    bounds, behind, admitted = [], [], []
    for index in range(options.count):
        centre = low + 0.6 + rng.random(law.arm.joints) * np.maximum(high - low - 1.2, 0.0)
        motion = Streamed.through(times, random_stream(index % 3, centre, rng, times), stream)
        answer = admit(law, motion, str(index), allowed=options.allowed, assume_steps=True, slow_down=False)
        admitted.append(answer.admitted)
        bounds.append(np.inf if answer.bound is None else float(np.max(answer.bound)))
        behind.append(float(np.max(motion.behind)))
        if not answer.admitted:
            print(f"  stream {index}: {answer.limit}, bound {1e3 * bounds[-1]:.3g} mrad", flush=True)
    lag = 1e3 * float(stream.lag(0.0))
    print(f"| {options.arm} | {lag:.0f} | {np.median(behind):.2f}, {np.max(behind):.2f} | {options.count} | ", end="")
    print(f"{sum(admitted)} | {1e3 * np.median(bounds):.2f}, {1e3 * np.max(bounds):.2f} |")
