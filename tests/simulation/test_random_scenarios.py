"""Random scenarios compile, and both engines agree on them: whatever the scheme, arm, instruments and step."""

import jax
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from slidax import scenarios
from slidax.scenarios.schemes import PRESETS

ARMS = {"example-4.1": 2, "example-4.2": 3}
SCHEMES = [name for name, preset in PRESETS.items() if preset.complete]
DELAYS = st.sampled_from([0.0, 0.4, 1.0, 1.7])


@st.composite
def random_scenarios(draw):
    """A built-in scenario and its changes."""
    arm = draw(st.sampled_from(sorted(ARMS)))
    changes = {
        "scheme.name": draw(st.sampled_from(SCHEMES)),
        "simulation.mode": draw(st.sampled_from(["held", "continuous"])),
        "simulation.integrator": draw(st.sampled_from(["rk4", "semi_implicit_euler"])),
        "simulation.period": draw(st.sampled_from([1e-4, 5e-4, 1e-3])),
        "simulation.t1": 0.03,
        "disturbance.scale": draw(st.floats(0.0, 2.0)),
    }
    if changes["simulation.mode"] == "held":
        changes["simulation.substeps"] = draw(st.integers(1, 4))
        changes |= draw(
            st.fixed_dictionaries(
                {},
                optional={
                    "sensor.resolution": st.floats(1e-6, 1e-4),
                    "sensor.position_noise": st.floats(1e-7, 1e-5),
                    "sensor.velocity": st.sampled_from(["measured", "differenced"]),
                    "sensor.delay": DELAYS,
                    "sensor.loss.probability": st.floats(0.0, 0.3),
                    "sensor.seed": st.integers(0, 2**32 - 1),
                    "actuator.torque": st.floats(20.0, 200.0),
                    "actuator.rate": st.floats(1e3, 1e5),
                    "actuator.time_constant": st.floats(0.0, 5e-3),
                    "actuator.dead_time": DELAYS,
                },
            )
        )
    return arm, changes


def assert_both_agree(arm, changes):
    """Check that the outcomes are equal and the states close: rounding differences grow in a loop that chatters."""
    runs = [
        scenarios.load(arm, {**changes, "simulation.engine": engine}).simulate(log_every=1)
        for engine in ("native", "xla")
    ]
    native, xla = runs
    assert native.outcome.kind == xla.outcome.kind
    for run in runs:
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((run.log, run.state)))
    length = min(len(native.log.t), len(xla.log.t))
    assert abs(len(native.log.t) - len(xla.log.t)) <= 1
    rounded, held = changes.get("sensor.resolution"), changes["simulation.mode"] == "held"
    scale = 1e-3 if rounded else 1e-5 if held else 1e-7
    np.testing.assert_allclose(native.log.state.q[:length], xla.log.state.q[:length], atol=scale)
    # In the first third, differences have had no time to grow.
    early = length // 3
    np.testing.assert_allclose(native.log.state.q[:early], xla.log.state.q[:early], atol=1e-3 if rounded else 1e-7)
    first = 2e-12 * np.max(np.abs(xla.log.tau[0]))
    np.testing.assert_allclose(native.log.tau[0], xla.log.tau[0], rtol=0, atol=first)


HOW = {"deadline": None, "derandomize": True, "suppress_health_check": list(HealthCheck)}


@settings(max_examples=3, **HOW)
@given(random_scenarios())
def test_both_engines_agree_on_random_scenarios(scenario):
    assert_both_agree(*scenario)


@pytest.mark.full
@settings(max_examples=80, **HOW)
@given(random_scenarios())
def test_both_engines_agree_on_many_random_scenarios(scenario):
    assert_both_agree(*scenario)
