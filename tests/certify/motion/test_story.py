"""From a URDF to guaranteed motions: slidax identifies the arm from a MuJoCo log."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from slidax.certify.motion.admission import admit, certified_law, slowed
from slidax.motions.tabulated import Tabulated
from tests.cli.commands import answer_of

from .campaign import LIMITED, REJECTED, chain_urdf, compiled, desired, scenario_of
from .mujoco_arm import RESOLUTION, ExportedLaw, MujocoArm

START = 0.3
"""Start position of all joints, rad."""

SCENARIO = """
title: an arm that MuJoCo moves
robot: {kind: identified, file: arm.yaml}
uncertainty: {file: arm.yaml}
trajectory: {kind: minimum_jerk, times: [0, 1], waypoints: [START, START]}
start: {q: START}
sensor: {resolution: 1.0e-5, velocity: differenced}
actuator: {torque: robot}
scheme:
  name: computed_torque
  horizon: 0.02
  sampled_data:
    midpoint: true
    viscous_feedforward: true
    adaptation: null
    estimator: {kind: kalman, acceleration_density: 0.3}
simulation: {mode: held, period: 1.0e-3, t1: 1.0}
"""


def identified_scenario(arm: MujocoArm, urdf: Path, folder: Path) -> Any:
    """Excite, log, identify with the links, and load a scenario of the result."""
    answer_of("excite", str(urdf), "--seed", "1", "--links", "--out", str(folder / "motion.csv"))
    motion = Tabulated.from_csv(folder / "motion.csv")
    n = len(arm.q)
    log = arm.log(motion, (200.0, 20.0), np.random.default_rng(3))
    head = ",".join(["time", *(f"q_{k}" for k in range(n)), *(f"tau_{k}" for k in range(n))])
    np.savetxt(folder / "log.csv", log, delimiter=",", header=head, comments="")
    answer_of("identify", str(folder / "log.csv"), "--robot", str(urdf), "--links", "--out", str(folder / "arm.yaml"))
    return scenario_of(SCENARIO.replace("START", str([START] * n)), folder)


def random_motion(law: Any, rng: np.random.Generator) -> Any:
    """A motion from the start through a random posture to another."""
    arm = law.arm
    lower, upper = (np.clip(np.asarray(limit), -2.5, 2.5) for limit in (arm.limits.lower, arm.limits.upper))
    points = np.concatenate(
        [[START * np.ones(arm.joints)], rng.uniform(lower + 0.2, upper - 0.2, size=(2, arm.joints))]
    )
    fastest = float(np.max(np.abs(np.diff(points, axis=0)) / np.asarray(arm.limits.velocity)))
    times = np.array([0.0, 1.0, 2.0]) * 2.0 * fastest
    return Tabulated.through(times, points, np.zeros_like(points), np.zeros_like(points))


def run_along(arm: MujocoArm, law: ExportedLaw, reference: np.ndarray) -> tuple[np.ndarray, int]:
    """Errors at the samples [N n], and all bits of the status."""
    arm.reset(reference[0, 0])
    law.reset()
    errors, bits = [], 0
    for k in range(len(reference) - 1):
        q = arm.q
        errors.append(q - reference[k, 0])
        measured = np.round(q / RESOLUTION) * RESOLUTION
        tau, status = law.step(k * arm.period, measured, reference[k], reference[k + 1])
        bits |= status
        arm.move(tau)
    return np.array(errors), bits


def assert_motions_stay_within_their_bounds(
    arm: MujocoArm, urdf: Path, folder: Path, count: int, refused_at_most: int = 0
) -> None:
    """Assert that most of `count` motions are admitted, if need be slowed down, and stay within their bounds."""
    scenario = identified_scenario(arm, urdf, folder)
    law, rng = certified_law(scenario), np.random.default_rng(5)
    exported = ExportedLaw(compiled(scenario, folder), law.arm.joints)
    shares: list[float] = []
    refused = 0
    while len(shares) + refused < count:
        motion = random_motion(law, rng)
        answer = admit(law, motion, allowed=0.01)
        if not answer.admitted and answer.slow_down is None:
            refused += 1
            continue
        if not answer.admitted:
            motion = slowed(motion, answer.slow_down)
            answer = admit(law, motion, allowed=0.01, slow_down=False)
        assert answer.admitted
        times, along = answer.verdict.bound["times"], answer.verdict.bound["error_over_time"]
        slots = int(float(motion.times[-1]) / arm.period) + 300
        errors, bits = run_along(arm, exported, desired(motion, arm.period, slots, 1, 0))
        cell = np.searchsorted(times, np.arange(len(errors)) * arm.period + 1e-9, side="right") - 1
        shares.append(float(np.max(np.abs(errors) / along[cell])))
        assert not bits & (REJECTED | LIMITED)
    print(
        f"{count} motions, p = {law.uncertainty.band.p:.3f}, {refused} refused at any speed: "
        f"largest error over its bound {np.round(sorted(shares), 2)}"
    )
    assert refused <= refused_at_most
    assert max(shares) <= 1.0
    assert max(shares) > 0.05


TRUTH = {"payload": 0.7, "coulomb": 0.25, "viscous": 0.4, "rotor": 0.06}


def test_motions_of_an_arm_identified_from_a_log_stay_within_bounds_in_mujoco(tmp_path: Path) -> None:
    urdf = Path("examples/robots/small_arm.urdf").resolve()
    assert_motions_stay_within_their_bounds(MujocoArm(urdf, "hand", **TRUTH), urdf, tmp_path, 3)


@pytest.mark.full
@pytest.mark.parametrize(("joints", "count", "refused_at_most"), [(4, 100, 0), (6, 20, 4)])
def test_random_motions_stay_within_their_bounds_in_mujoco(
    joints: int, count: int, refused_at_most: int, tmp_path: Path
) -> None:
    urdf = Path("examples/robots/small_arm.urdf").resolve()
    if joints == 6:
        urdf = tmp_path / "chain.urdf"
        urdf.write_text(chain_urdf(6, np.random.default_rng(6)))
    last = {4: "hand", 6: "l5"}[joints]
    assert_motions_stay_within_their_bounds(MujocoArm(urdf, last, **TRUTH), urdf, tmp_path, count, refused_at_most)
