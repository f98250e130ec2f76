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
