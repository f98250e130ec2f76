"""The linearised loop against finite differences of the simulation, theory and gain margins."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.analysis import linearise
from slidax.analysis.linearise import operating_point
from slidax.analysis.period_map import INPUTS, period_map
from slidax.analysis.sampled_system import connected_states
from slidax.core.errors import DefinitionError
from slidax.law.joint_loop import LinearLoop
from slidax.scenarios import Scenario


def off_by(changes: dict[str, Any], at: float) -> float:
    """Distance of derivatives from differences of the simulated sample, as a share of the largest in their column.

    Differences are extrapolated to a step of zero. Each column has the step at which they agree most: rounding wants
    a long step where a state has little effect, and powers near zero want a short step.
    """
    loop, carry, _ = operating_point(scenarios.load("example-4.1-1khz", changes), at)
    sample = period_map(loop, carry)
    derivative = sample.derivative()
    m = sample.x.size
    kept = connected_states(derivative[:m, :m], derivative[:m, m:], derivative[m:, :m])
    assert len(kept) > 8
    place = np.ix_(*(np.concatenate([kept, np.arange(m, size)]) for size in derivative.shape))
    size = np.abs(derivative[place]).max(axis=0)
    # A state without effect, such as an unmeasured velocity, has a column of zeros in both.
    size = np.where(size > 0.0, size, 1.0)
    best = np.full(size.shape, np.inf)
    for power in np.arange(1.0, 8.6, 0.5):
        step = np.full(derivative.shape[1], 10.0**-power)
        extrapolated = (4 * sample.differences(0.5 * step) - sample.differences(step)) / 3
        off = (np.abs(derivative - extrapolated)[place] / size).max(axis=0)
        best = np.fmin(best, off)
    return float(best.max())


@pytest.mark.parametrize(
    ("changes", "at", "close"),
    [
        pytest.param({}, 1.0, 1e-9, marks=pytest.mark.full),
        # Near s = 0 the power of s bends within a single difference step.
        pytest.param({}, 5.0, 1e-8, marks=pytest.mark.full),
        ({"scheme.name": "computed_torque"}, 1.0, 1e-9),
        pytest.param({"scheme.name": "computed_torque"}, 5.0, 1e-9, marks=pytest.mark.full),
    ],
)
def test_linearised_step_agrees_with_finite_differences_of_the_simulation(changes, at, close):
    assert off_by(changes, at) < close


HEAVY = 50.0
"""Inertia of each rotor, kg m²; that of the links is negligible."""

HORIZON, VARIANCE, PERIOD = 10.0, 1e-12, 1e-3
STILL = {"trajectory": {"kind": "constant", "value": [0.3, 0.4]}, "start.q": [0.3, 0.4], "disturbance.scale": 0.0}
SHORT = {**STILL, "scheme.sampled_data.adaptation": None, "actuator": {}, "simulation.t1": 0.5}


@pytest.fixture(scope="module")
def linearised():
    return linearise(scenarios.load("example-4.1-1khz", SHORT))


def test_linearisation_reports_its_derivative_error_and_its_inputs_with_units(linearised):
    assert linearised.derivative_error < 0.05 and linearised.stable and linearised.held
    assert linearised.system.inputs[:2] == ("disturbance[joint 1]", "disturbance[joint 2]")
    assert linearised.system.input_units[:2] == ("N m", "N m") and len(linearised.system.inputs) == 2 * len(INPUTS)


def test_a_perturbed_run_agrees_with_the_linear_system(linearised):
    """Response of the simulation to a small disturbance torque on the first joint for 0.1 s."""
    push = 1e-6
    disturbance = {"scale": 1.0, "terms": [{"kind": "step", "value": [push, 0.0], "start": 0.5}]}
    changes = {name: value for name, value in SHORT.items() if name != "disturbance.scale"}
    changes |= {"disturbance": disturbance, "simulation.t1": 0.6}
    scenario = scenarios.load("example-4.1-1khz", changes)
    run, still = (scenarios.alter(scenario, {"disturbance.scale": on}).simulate(log_every=1) for on in (1.0, 0.0))
    times, steps = linearised.system.select("disturbance[joint 1]", "error").step_response(0.1)
    moved = (np.asarray(run.log.e) - np.asarray(still.log.e))[500:601]
    np.testing.assert_allclose(moved / push, steps[:, :, 0], atol=0.02 * np.abs(steps).max())
    assert times[-1] == pytest.approx(0.1)


@pytest.mark.parametrize("where", ["torque", "measurement"])
def test_at_its_gain_margin_the_loop_is_marginally_stable(linearised, where):
    """Eigenvalues of the closed loop with its gain scaled at the point where the loop was opened."""
    closed = linearised.closed_loop(where)
    for joint, margin in enumerate(linearised.margins(where)):
        b, c = closed.b[:, [joint]], closed.c[[joint]]
        for gain in (margin.gain_up, margin.gain_down):
            if gain is None:
                continue
            radius = np.abs(np.linalg.eigvals(closed.a + (gain - 1) * b @ c)).max()
            assert radius == pytest.approx(1.0, abs=1e-6)
        within = 0.5 * (1 + margin.gain_up)
        assert np.abs(np.linalg.eigvals(closed.a + (within - 1) * b @ c)).max() < 1.0
        # The disk margin is within each margin by itself.
        low, high = margin.disk_gains
        assert high <= margin.gain_up * (1 + 1e-6)
        assert margin.gain_down is None or low >= margin.gain_down * (1 - 1e-6)
        assert margin.disk_phase <= margin.phase * (1 + 1e-6)
        assert margin.disk <= 1 / (margin.sensitivity - 0.5) * (1 + 1e-6)


def test_a_delay_as_long_as_the_margin_makes_the_loop_unstable(linearised):
    """The delay is a number of whole periods before the drives."""
    closed = linearised.closed_loop("torque")
    margin = linearised.margins("torque")[0]
    b, c = closed.b[:, [0]], closed.c[[0]]

    def radius(periods: int) -> float:
        # Remove the undelayed torque feedback and feed it back through a shift register.
        a = closed.a - b @ c
        size, late = len(a), periods
        whole = np.zeros((size + late, size + late))
        whole[:size, :size] = a
        if not late:
            return float(np.abs(np.linalg.eigvals(a + b @ c)).max())
        whole[:size, [size + late - 1]] = b
        whole[size, :size] = c
        whole[size + 1 :, size:-1] = np.eye(late - 1)
        return float(np.abs(np.linalg.eigvals(whole)).max())

    periods = margin.delay / closed.period
    assert radius(int(np.floor(periods))) < 1.0 <= radius(int(np.ceil(periods)))


def test_closing_the_open_loop_gives_the_closed_loop(linearised):
    opened = linearised.loop_gain("torque", 1)
    again = opened.a + opened.b @ -opened.c
    closed = np.sort_complex(linearised.system.eigenvalues)
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(again).astype(complex)), closed, atol=1e-5)


def of_heavy_rotors(kappa: float, delay: int) -> Scenario:
    """An arm with a heavy rotor whose law assumes κ times its inertia, as in docs/learning.md."""
    believed = kappa * HEAVY
    density = (1.4 / HORIZON) ** 6 * VARIANCE / PERIOD**5 * believed**2
    robot = {"kind": "urdf", "file": "examples/robots/two_link.urdf", "tip": "tip"}
    robot |= {"nominal": {"armature": [HEAVY, believed]}, "plant": {"armature": HEAVY}}
    estimator = {"kind": "kalman", "torque_density": density, "variance": VARIANCE}
    changes = {
        **SHORT,
        "robot": robot,
        "sensor": {"velocity": "differenced", "delay": delay},
        "scheme.transformation.performance.final": 0.5,
        "scheme.surface.k1": 50.0,
        "scheme.sampled_data": {"horizon": HORIZON * PERIOD, "estimator": estimator, "adaptation": None},
    }
    return scenarios.load("example-4.1-1khz", changes)


@pytest.mark.full
@pytest.mark.parametrize("delay", [0, 1])
def test_the_tolerated_inertia_ratio_agrees_with_the_theory_of_one_joint(delay, monkeypatch, request):
    monkeypatch.chdir(request.config.rootpath)
    low, high = LinearLoop.of(of_heavy_rotors(1.0, delay).controller, 1).stable_range()
    for kappa, stable in ((0.85 * low, False), (1.15 * low, True), (0.8 * high, True), (1.25 * high, False)):
        assert linearise(of_heavy_rotors(kappa, delay), at=0.01).stable == stable, kappa


RIVALS = ("slotine_li", "super_twisting", "pid", "nftsmc", "anftsmc", "sfsmc", "gravity_pd")


@pytest.mark.parametrize(
    "scheme", [pytest.param(loop, marks=[] if loop == "pid" else [pytest.mark.full]) for loop in RIVALS]
)
def test_linearisation_of_every_competing_scheme_has_finite_eigenvalues_and_margins(scheme):
    changes = {**SHORT, "scheme.name": scheme}
    loop = linearise(scenarios.load("example-4.1-1khz", changes), at=0.05)
    assert loop.system.a.shape[0] >= 4 and np.isfinite(loop.system.eigenvalues).all()
    if scheme == "anftsmc":
        # Its adapted gains neither grow nor decay near the reference.
        assert loop.system.radius == pytest.approx(1.0, abs=1e-9)
    else:
        assert min(margins.sensitivity for margins in loop.margins("torque")) >= 1.0


def test_computed_torque_has_the_eigenvalues_of_its_gains():
    """With the exact model, no delay and no limits `ë + kd ė + kp e = 0`, held over short periods."""
    changes = {
        **STILL,
        "robot.nominal": {},
        "scheme": {"name": "computed_torque", "kp": 100.0, "kd": 25.0},
        "simulation": {"mode": "held", "period": 1e-4, "substeps": 1, "t1": 0.01},
        "sensor": {},
        "actuator": {},
    }
    loop = linearise(scenarios.load("example-4.1-1khz", changes), at=0.005)
    expected = np.sort(np.roots([1.0, 25.0, 100.0]))
    rates = np.sort([(np.log(z) / 1e-4).real for z, _, _ in loop.modes])
    np.testing.assert_allclose(rates, np.repeat(expected, 2), rtol=2e-3)
    # At rest a disturbance d causes the error d/(M kp).
    response = loop.system.select("disturbance", "error").response(np.array([1e-6]))[0]
    mass = scenarios.load("example-4.1-1khz", changes).plant.robot.mass(jnp.asarray([0.3, 0.4]))
    np.testing.assert_allclose(response.real, np.linalg.inv(mass) / 100.0, rtol=1e-6)


def test_loop_in_continuous_mode_has_eigenvalues_but_no_margins():
    loop = linearise(scenarios.load("example-4.1", {"simulation.t1": 0.01}))
    assert not loop.held and np.isfinite(loop.system.radius)
    with pytest.raises(DefinitionError, match="no sampled loop can be opened"):
        loop.closed_loop("torque")
    assert loop.as_json()["margins"] is None


def test_linearisation_notes_list_the_neglected_effects():
    changes = {
        **STILL,
        "sensor": {
            "resolution": 1e-4,
            "velocity": "differenced",
            "delay": 1.5,
            "jitter": 0.2,
            "loss": {"probability": 0.1},
        },
        "simulation.t1": 0.05,
    }
    loop = linearise(scenarios.load("example-4.1-1khz", changes))
    notes = " ".join(loop.notes)
    for words in ("rounding", "lost samples", "jitter", "learning"):
        assert words in notes


@pytest.mark.full
def test_joint_learning_is_noted_and_adds_at_most_two_states_per_joint(linearised):
    """The law's learnt values count as known from the start."""
    learning = linearise(
        scenarios.load("example-4.1-1khz", {**SHORT, "scheme.sampled_data.adaptation": {"kind": "joint_learning"}})
    )
    assert "learning" in " ".join(learning.notes)
    assert learning.system.a.shape[0] <= linearised.system.a.shape[0] + 2 * 2


@pytest.mark.parametrize(
    ("changes", "at", "message"),
    [
        ({}, 99.0, "`at` must be from"),
        ({"simulation.t1": 10.0, "scheme.sampled_data": None}, 9.0, "the run .* at t = .*, before the requested time"),
    ],
)
def test_operating_time_outside_the_run_is_refused(changes, at, message):
    with pytest.raises(DefinitionError, match=message):
        linearise(scenarios.load("example-4.1-1khz", changes), at)


def test_signals_of_the_linear_system_are_selected_by_name_and_joint(linearised):
    part = linearised.system.select("torque[joint 2]", ["error", "torque[joint 1]"])
    assert part.outputs == ("error[joint 1]", "error[joint 2]", "torque[joint 1]")
    with pytest.raises(DefinitionError, match="did you mean `torque`"):
        linearised.system.select("torq", "error")
    with pytest.raises(DefinitionError, match='opened at `where="torque"'):
        linearised.closed_loop("joint")


def test_margins_agree_with_python_control(linearised):
    control = pytest.importorskip("control", reason="pip install 'slidax[linear]'")
    loop = linearised.loop_gain("torque", 0)
    theirs = loop.to_control()
    assert theirs.dt == pytest.approx(1e-3)
    omega = np.array([1.0, 50.0, 400.0, 2000.0])
    np.testing.assert_allclose(theirs(np.exp(1j * omega * 1e-3)), loop.response(omega)[:, 0, 0], rtol=1e-6)
    # From the frequency response: polynomials of 18 states lose too many digits.
    omega = np.linspace(1.0, np.pi * 1e3, 20000)
    response = loop.response(omega)[:, 0, 0]
    gain, phase, *_ = control.stability_margins((np.abs(response), np.degrees(np.angle(response)), omega))
    ours = linearised.margins("torque")[0]
    assert gain == pytest.approx(ours.gain_up, rel=1e-3) and abs(phase) == pytest.approx(ours.phase, rel=1e-3)
    times, steps = linearised.system.select("disturbance", "error").step_response(0.05)
    expected = control.step_response(linearised.system.select("disturbance", "error").to_control(), T=times)
    np.testing.assert_allclose(steps[:, 0, 1], expected.outputs[0, 1], atol=1e-12)


def test_operating_point_is_the_sample_at_the_requested_time():
    _, carry, _ = operating_point(scenarios.load("example-4.1-1khz", SHORT), 0.1)
    assert int(carry.k) == 100
