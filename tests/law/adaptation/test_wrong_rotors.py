"""Arms whose rotors the law does not know: inside the envelope, and no less accurate than if it did.

The whole table is docs/learning.md's.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import slidax as sx
from slidax import analysis, scenarios
from slidax.motions import Tabulated
from slidax.simulation import Run

PANDA, UR5E = "panda-payload", "ur5e-payload"
NOMINAL, TRUE = (0.0, 0.03, 0.1, 0.2), (0.02, 0.05, 0.1, 0.3)
CORNERS = ((0.1, 0.1), (0.0, 0.1), (0.1, 0.03), (0.03, 0.3))
DAILY = [(PANDA, 0.0, 0.1), (PANDA, 0.03, 0.3), (UR5E, 0.1, 0.02)]
# Of the exactly known arm at each true inertia; at .02, where that one fails, what was asked for.
KNOWN = {
    PANDA: {0.02: 8e-4, 0.05: 3.5e-4, 0.1: 2.6e-4, 0.3: 1.6e-4},
    UR5E: {0.02: 1.5e-3, 0.05: 1.3e-3, 0.1: 8.2e-4, 0.3: 4.3e-4},
}
STEP = {PANDA: 0.5, UR5E: 0.7}
HARDER: list[tuple[str, dict[str, Any]]] = [
    *((name, {"sensor.delay": delay}) for name in (PANDA, UR5E) for delay in (2, 3)),
    *((name, {"sensor.resolution": step}) for name in (PANDA, UR5E) for step in (1e-4, 2.5e-4)),
    *((name, {"robot.plant.load.mass": mass}) for name in (PANDA, UR5E) for mass in (1.0, 4.0)),
    *((name, {}) for name in ("panda-table", "panda-pick", "panda-drop")),
]


def cells() -> list[Any]:
    every = [(name, nominal, true) for name in (PANDA, UR5E) for true in TRUE for nominal in NOMINAL]
    return [pytest.param(*cell, marks=[] if cell in DAILY else [pytest.mark.full]) for cell in every]


def simulated(name: str, nominal: float, true: float, **changes: Any) -> Run:
    rotors = {"robot.nominal.armature": nominal, "robot.plant.armature": true}
    return scenarios.load(name, {**rotors, **changes}).simulate(log_every=None, progress=False)


@pytest.mark.parametrize(("name", "nominal", "true"), cells())
def test_with_any_rotors_the_envelope_is_kept_as_accurately_as_by_the_known_arm(name, nominal, true):
    run = simulated(name, nominal, true)
    assert analysis.envelope_violations(run) == 0
    assert np.max(analysis.steady_error(run)) <= 1.2 * KNOWN[name][true]
    assert np.max(analysis.steady_torque_step(run)) < STEP[name]


@pytest.mark.full
@pytest.mark.parametrize(("name", "changes"), HARDER)
@pytest.mark.parametrize(("nominal", "true"), CORNERS)
def test_with_delay_coarse_encoders_other_payloads_and_contact_it_is_kept_as_well(name, changes, nominal, true):
    # docs/learning.md has this one as the one that is left, at a reversal.
    left = 5 if (name, changes, nominal, true) == (UR5E, {"sensor.delay": 3}, 0.1, 0.03) else 0
    assert analysis.envelope_violations(simulated(name, nominal, true, **changes)) <= left


@pytest.mark.full
@pytest.mark.parametrize("name", [PANDA, UR5E])
@pytest.mark.parametrize("true", [0.005, 0.5, 1.0])
@pytest.mark.parametrize("nominal", NOMINAL)
def test_with_rotors_far_from_usual_it_is_kept_as_well(name, true, nominal):
    assert analysis.envelope_violations(simulated(name, nominal, true)) == 0


def test_without_learning_a_plain_urdfs_arm_leaves_its_envelope():
    run = simulated(PANDA, 0.0, 0.1, **{"scheme.sampled_data.adaptation": None})
    assert analysis.envelope_violations(run) > 1000


def test_what_was_learnt_can_be_kept_and_used_without_learning():
    changes = {"robot.nominal.armature": 0.0, "robot.plant.armature": 0.1}
    learns = scenarios.load(PANDA, changes).simulate(log_every=1, progress=False)
    last = {name: [float(x) for x in learns.log.signals[name][-1]] for name in ("rotor", "coulomb")}
    frozen = {**changes, "scheme.sampled_data.adaptation": {"kind": "known_joints", **last}}
    run = scenarios.load(PANDA, frozen).simulate(log_every=1, progress=False)
    assert analysis.envelope_violations(run) == 0
    assert np.max(analysis.steady_error(run)) <= 1.5 * np.max(analysis.steady_error(learns))
    np.testing.assert_array_equal(run.log.signals["rotor"][0], run.log.signals["rotor"][-1])


HOME, AWAY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], [0.4, -0.4, 0.3, -2.0, 0.4, 1.9, 1.2]
HOURS = {
    "hold": ([0.0, 2.0, 4.0], [HOME, AWAY, HOME]),
    "creep": ([0.0, 2.0, 4.0, 3600.0], [HOME, AWAY, HOME, AWAY]),
    "starts": (
        [20.0 * k + later for k in range(180) for later in (0.0, 2.0)],
        [there for k in range(180) for there in ((HOME, AWAY) if k % 2 == 0 else (AWAY, HOME))],
    ),
}
"""Times and places, at rest at each: standing still after a motion, 1e-4 rad/s after it, a motion every 20 s."""


@pytest.mark.full
@pytest.mark.parametrize("hour", HOURS)
def test_nothing_drifts_in_an_hour_of_hold_of_creep_and_of_repeated_starts(hour):
    times, places = HOURS[hour]
    rest = np.zeros_like(places)
    scenario = scenarios.load(
        PANDA, {"robot.nominal.armature": 0.0, "robot.plant.armature": 0.1, "simulation.log_every": 1000}
    )
    motion = Tabulated.through(times, places, velocities=rest, accelerations=rest)
    run = scenario.replace(trajectory=motion, state0=sx.State(HOME), t1=3600.0).simulate(progress=False)
    assert analysis.envelope_violations(run) == 0
    learnt = np.asarray(run.log.signals["rotor"])
    # A motion from time to time goes on teaching a little; nothing else changes what was learnt.
    since, share = (60, 0.1) if hour == "starts" else (10, 1e-3)
    np.testing.assert_allclose(learnt[-1], learnt[since], rtol=share)
