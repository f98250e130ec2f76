"""How much larger certified errors are than the worst that attacks reach along the same motions."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from slidax.certify.motion.joint_loop import JointLoop
from slidax.certify.motion.parameter_region import BodyBand
from slidax.certify.motion.tracking_bound import ArmUncertainty, CertifiedPath, certified_path
from tests.certify.motion.cases import Members, desired, knotted, quintic
from tests.certify.motion.plant import Chain, simulate
from tests.certify.motion.test_tracking_bound import of_the_ellipsoid

LAWS = {"panda": (1e-3, 0.012, 0.3, 1e-6), "ur5e": (2e-3, 0.02, 10.0, 1e-5)}
"""Period [s], horizon [s], density of the filter and resolution of the encoders [rad]."""

SUBSTEPS, RESPONSE = 2, 300
"""Steps of the arm in a period, and length of a response that an attack uses, in periods."""


def attacked(
    arm: Any, motion: Any, certified: CertifiedPath, draw: Callable[..., Chain], rng: np.random.Generator, runs: int
) -> np.ndarray:
    """The largest error of each joint, [n], in runs of arms of the set with friction or torques of the worst signs."""
    loop, cells = certified.loop, certified.path.cells
    slots, n = len(cells.q) * cells.per_cell, arm.joints
    reference, nominal = desired(motion, loop.period, slots, SUBSTEPS, loop.delay), Chain.of(arm)
    torque = np.asarray(certified.inputs.coulomb)
    signs = signs_of(loop)
    worst = np.zeros(n)
    for run in range(runs):
        push, coulomb = None, torque
        if run % 3:
            # The signs that move one joint most at one instant: where its bound is largest, or anywhere.
            joint = run % n
            last = int(np.argmax(certified.bounds.error[:, joint])) * cells.per_cell
            last = min(last + cells.per_cell, slots - 1) if run % 3 == 1 else int(rng.integers(slots // 3, slots))
            q = reference[last * SUBSTEPS, 0]
            towards = np.sign(np.linalg.inv(np.asarray(arm.mass(q)))[joint])
            ages = np.clip(last - 1 - np.arange(slots), 0, RESPONSE - 1)
            push, coulomb = np.repeat(signs[ages][:, None] * towards, SUBSTEPS, axis=0) * torque, None
        ran = simulate(
            draw(nominal, rng),
            nominal,
            loop,
            reference,
            slots,
            SUBSTEPS,
            push=push,
            coulomb=coulomb,
            resolution=float(np.max(certified.inputs.resolution)),
            phase=rng.random(n),
        )
        worst = np.maximum(worst, ran.error.max(axis=0))
    return worst


def signs_of(loop: JointLoop) -> np.ndarray:
    """Signs of the error's response to a torque of one period, by its age in periods."""
    maps = loop.maps_for(1.0)
    state, responses = 0.5 * maps.enters[:, 1] + maps.enters[:, 2], []
    for _ in range(RESPONSE):
        responses.append((maps.outputs @ state)[0])
        state = maps.step @ state
    return np.where(np.array(responses) >= 0.0, 1.0, -1.0)


def measure_sharpness() -> None:
    """Certify random motions of an identified arm, attack each, compare joint by joint: all at once, then by term."""
    parser = argparse.ArgumentParser(description=measure_sharpness.__doc__)
    parser.add_argument("--arm", choices=sorted(LAWS), default="panda")
    parser.add_argument("--count", type=int, default=20, help="motions")
    parser.add_argument("--runs", type=int, default=120, help="runs along each motion")
    options = parser.parse_args()
    members, (period, horizon, density, resolution) = Members(options.arm), LAWS[options.arm]
    arm, loop = members.arm, JointLoop.with_density(period, horizon, density, resolution)
    band = replace(ArmUncertainty.identified(arm, members.band, resolution=resolution), coulomb=0.3, viscous_error=0.02)
    known = replace(band, band=BodyBand(0.0, 0.0))
    still: dict[str, Any] = {"coulomb": 0.0, "viscous_error": 0.0}
    terms = {
        "all": band,
        "friction": replace(known, resolution=0.0),
        "inertial band": replace(band, **still, resolution=0.0),
        "encoders": replace(known, **still),
    }
    rng = np.random.default_rng(2)
    motions = [(quintic, knotted)[k % 2](arm, rng, rng.uniform(0.2, 0.5)) for k in range(options.count)]
    for name, uncertain in terms.items():
        ratios = []
        for motion in motions:
            certified = certified_path(arm, motion, loop, uncertain)
            if not certified.bounds.verified:
                continue
            draw = of_the_ellipsoid(members, certified) if uncertain.band is band.band else lambda nominal, rng: nominal
            worst = attacked(arm, motion, certified, draw, rng, options.runs)
            ratios.append(certified.bounds.error.max(axis=0) / worst)
        shown = np.concatenate(ratios)
        print(
            f"{options.arm}, {name}: bound over the largest error seen, {len(ratios)} motions, joint by joint: median "
            f"{np.median(shown):.2f}, 90 % within {np.quantile(shown, 0.9):.2f}, least {shown.min():.2f}",
            flush=True,
        )
