"""Certified error against the speed of motions in a workspace."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.certify import Verdict
from slidax.design import read_problem
from slidax.design import refusal as refusals
from slidax.design.candidates import DesignPoint
from slidax.design.design import _begin
from slidax.design.refusal import proof_refusal
from slidax.design.speed_table import random_motions, speed_table
from tests.design.test_requirements import EXAMPLES

FILE = EXAMPLES / "two-link-workspace.yaml"
LAW = DesignPoint(0.02, 1.0, 1.0, np.full(2, 0.0125), 1.0)


@pytest.fixture(scope="module")
def problem() -> Any:
    return read_problem(FILE)


@pytest.fixture(scope="module")
def motions(problem: Any) -> Any:
    return random_motions(problem.workspace, problem.robot.build(), count=3)


def test_random_motions_start_and_end_at_rest_inside_the_workspace_and_reach_a_limit(problem, motions):
    space = problem.workspace
    for motion in motions:
        times = np.linspace(motion.times[0], motion.times[-1], 301)
        reference = jax.vmap(motion.reference)(jnp.asarray(times))
        q, dq, ddq = (np.asarray(each) for each in (reference.q, reference.dq, reference.ddq))
        assert np.all(q >= np.asarray(space.q.low) - 1e-9) and np.all(q <= np.asarray(space.q.high) + 1e-9)
        assert np.allclose(dq[[0, -1]], 0.0, atol=1e-9)
        share = max(np.abs(dq).max() / space.speed, np.abs(ddq).max() / space.acceleration)
        assert share == pytest.approx(1.0, abs=2e-3)
    assert not np.allclose(motions[0].reference(jnp.zeros(())).q, motions[1].reference(jnp.zeros(())).q)


@pytest.mark.full
def test_slower_motions_have_smaller_error_bounds_and_too_fast_motions_name_the_limit(problem, motions):
    described = _begin(problem)[0].described(LAW)
    fast, full, slow = speed_table(described, motions, LAW.final, speeds=(6.0, 1.0, 0.25))
    assert fast.certified == 0 and fast.median is None and "torque of `joint" in fast.reason
    assert full.certified == slow.certified == full.motions == 3
    assert 0 < slow.largest < full.largest < 1e-4 and slow.reason
    assert fast.as_json()["largest"] is None


def test_a_row_of_the_speed_table_counts_motions_within_the_allowed_error(problem, motions):
    described = _begin(problem)[0].described(LAW)
    (row,) = speed_table(described, motions[:1], LAW.final, speeds=(1.0,))
    assert row.certified == row.motions == 1 and 0 < row.median == row.largest < 1e-4
    (row,) = speed_table(described, motions[:1], np.full(2, 1e-6), speeds=(1.0,))
    assert row.certified == 0 and row.reason.startswith("error of `joint")


def test_a_refusal_proposes_a_slower_motion_that_the_arm_starts_on(problem, monkeypatch):
    on_motion = []

    def verdict_of(described: Any) -> Verdict:
        scenario = described.build("slower")
        on_motion.append(np.allclose(scenario.state0.dq, scenario.trajectory.reference(jnp.zeros(())).dq, rtol=1e-3))
        slow = np.max(described.trajectory.frequency) < 1.2
        return Verdict("tracking_bound", "", bool(slow), None, {}, (), "")

    monkeypatch.setattr(refusals, "tracking_verdict", verdict_of)
    fails = Verdict("tracking_bound", "", False, None, {}, (), "Torque.")
    answer = proof_refusal(problem, _begin(problem)[0], LAW, fails)
    (slower,) = (item.changes for item in answer.would_do if "workspace.speed" in item.changes)
    assert slower["workspace.speed"] < problem.workspace.speed and all(on_motion)
