"""The linear loop is the loop that is simulated, near a point: by differences, by theory, by what gains it bears."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from slidax import scenarios
from slidax.analysis import LinearisedLoop, linearise
from slidax.analysis.linearise import operating_point
from slidax.analysis.period_map import INPUTS, period_map
from slidax.core.errors import DefinitionError
from slidax.law.joint_loop import LinearLoop
from slidax.simulation.loop import ClosedLoop

HEAVY = 50.0
"""kg m² of each rotor, beside which links hardly count."""

HORIZON, VARIANCE, PERIOD = 10.0, 1e-12, 1e-3
STILL = {"trajectory": {"kind": "constant", "value": [0.3, 0.4]}, "start.q": [0.3, 0.4], "disturbance.scale": 0.0}
SHORT = {**STILL, "scheme.sampled_data.adaptation": None, "actuator": {}, "simulation.t1": 0.5}


@pytest.fixture(scope="module")
def found() -> LinearisedLoop:
    return linearise(scenarios.load("example-4.1-1khz", SHORT))


def test_derivative_error_is_reported(found):
    assert found.apart < 0.05
    assert found.stable and found.held
    assert found.system.inputs[:2] == ("disturbance[joint 1]", "disturbance[joint 2]")
    assert found.system.input_units[:2] == ("N m", "N m")
    assert len(found.system.inputs) == 2 * len(INPUTS)


def test_a_perturbed_run_is_that_of_the_linear_system(found):
    """A push of the first joint that is small enough: a tenth of a second of the simulation itself."""
    push = 1e-6
    disturbance = {"scale": 1.0, "terms": [{"kind": "step", "value": [push, 0.0], "start": 0.5}]}
    changes = {name: value for name, value in SHORT.items() if name != "disturbance.scale"}
    changes |= {"disturbance": disturbance, "simulation.t1": 0.6}
    scenario = scenarios.load("example-4.1-1khz", changes)
    run, still = (scenarios.alter(scenario, {"disturbance.scale": on}).simulate(log_every=1) for on in (1.0, 0.0))
    times, steps = found.system.part("disturbance[joint 1]", "error").step_response(0.1)
    moved = (np.asarray(run.log.e) - np.asarray(still.log.e))[500:601]
    np.testing.assert_allclose(moved / push, steps[:, :, 0], atol=0.02 * np.abs(steps).max())
    assert times[-1] == pytest.approx(0.1)


@pytest.mark.parametrize("where", ["torque", "measurement"])
def test_at_its_gain_margin_the_loop_is_at_the_edge(found, where):
    """With another gain at the place where it was broken, the loop's own eigenvalues say when it is unstable."""
    closed = found.closed(where)
    for joint, one in enumerate(found.margins(where)):
        b, c = closed.b[:, [joint]], closed.c[[joint]]
        for gain in (one.gain_up, one.gain_down):
            if gain is None:
                continue
            radius = np.abs(np.linalg.eigvals(closed.a + (gain - 1) * b @ c)).max()
            assert radius == pytest.approx(1.0, abs=1e-6)
        within = 0.5 * (1 + one.gain_up)
        assert np.abs(np.linalg.eigvals(closed.a + (within - 1) * b @ c)).max() < 1.0
        # What the disk promises is within what each margin by itself bears.
        low, high = one.disk_gains
        assert high <= one.gain_up * (1 + 1e-6) and (one.gain_down is None or low >= one.gain_down * (1 - 1e-6))
        assert one.disk_phase <= one.phase * (1 + 1e-6)
        assert one.disk <= 1 / (one.sensitivity - 0.5) * (1 + 1e-6)


def test_a_delay_as_long_as_the_margin_makes_the_loop_unstable(found):
    """Whole periods, one after another, before the drives."""
    closed = found.closed("torque")
    one = found.margins("torque")[0]
    b, c = closed.b[:, [0]], closed.c[[0]]

    def radius(periods: int) -> float:
        # The torque without its own share, and that share late, in a register.
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

    periods = one.delay / closed.period
    assert radius(int(np.floor(periods))) < 1.0 <= radius(int(np.ceil(periods)))


def test_the_open_loop_closed_again_is_the_loop(found):
    opened = found.loop("torque", 1)
    again = opened.a + opened.b @ -opened.c
    closed = np.sort_complex(found.system.eigenvalues)
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(again).astype(complex)), closed, atol=1e-5)


def heavy(kappa: float, delay: int) -> LinearisedLoop:
    """A joint that is all rotor, in an arm whose law believes κ of it, as docs/learning.md has it."""
    believed = kappa * HEAVY
    density = (1.4 / HORIZON) ** 6 * VARIANCE / PERIOD**5 * believed**2
    robot = {"kind": "urdf", "file": "examples/robots/two_link.urdf", "tip": "tip"}
    robot |= {"nominal": {"armature": [HEAVY, believed]}, "plant": {"armature": HEAVY}}
    changes = {
        **SHORT,
        "robot": robot,
        "sensor": {"velocity": "differenced", "delay": delay},
        "scheme.transformation.performance.final": 0.5,
        "scheme.surface.k1": 50.0,
        "scheme.sampled_data": {
            "horizon": HORIZON * PERIOD,
            "estimator": {"kind": "kalman", "torque_density": density, "variance": VARIANCE},
            "adaptation": None,
        },
    }
    return linearise(scenarios.load("example-4.1-1khz", changes), at=0.01)


@pytest.mark.full
@pytest.mark.parametrize("delay", [0, 1])
def test_the_inertia_that_it_bears_is_that_of_the_one_joint_theory(delay, monkeypatch, request):
    monkeypatch.chdir(request.config.rootpath)
    law = operating_point_law(delay)
    theory = LinearLoop.of(law, 1)
    low, high = theory.stable_range()
    for kappa, stable in ((0.85 * low, False), (1.15 * low, True), (0.8 * high, True), (1.25 * high, False)):
        assert heavy(kappa, delay).stable == stable, kappa


def operating_point_law(delay: int):
    believed = HEAVY
    density = (1.4 / HORIZON) ** 6 * VARIANCE / PERIOD**5 * believed**2
    robot = {"kind": "urdf", "file": "examples/robots/two_link.urdf", "tip": "tip", "nominal": {"armature": HEAVY}}
    sampled = {
        "horizon": HORIZON * PERIOD,
        "estimator": {"kind": "kalman", "torque_density": density, "variance": VARIANCE},
        "adaptation": None,
    }
    sensor = {"velocity": "differenced", "delay": delay}
    changes = {**SHORT, "robot": robot, "sensor": sensor, "scheme.sampled_data": sampled}
    return scenarios.load("example-4.1-1khz", changes).controller


RIVALS = ("slotine_li", "super_twisting", "pid", "nftsmc", "anftsmc", "sfsmc", "gravity_pd")


@pytest.mark.parametrize(
    "scheme", [pytest.param(one, marks=[] if one == "pid" else [pytest.mark.full]) for one in RIVALS]
)
def test_competing_schemes_are_linearised_in_the_same_form(scheme):
    changes = {**SHORT, "scheme.name": scheme}
    one = linearise(scenarios.load("example-4.1-1khz", changes), at=0.05)
    assert one.system.a.shape[0] >= 4
    assert np.isfinite(one.system.eigenvalues).all()
    if one.stable:
        assert all(margins.sensitivity >= 1.0 for margins in one.margins("torque"))


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
    one = linearise(scenarios.load("example-4.1-1khz", changes), at=0.005)
    expected = np.sort(np.roots([1.0, 25.0, 100.0]))
    rates = np.sort([(np.log(z) / 1e-4).real for z, _, _ in one.modes])
    np.testing.assert_allclose(rates, np.repeat(expected, 2), rtol=2e-3)
    # At rest a disturbance moves it by d/(M kp).
    response = one.system.part("disturbance", "error").response(np.array([1e-6]))[0]
    mass = scenarios.load("example-4.1-1khz", changes).plant.robot.mass(jnp.asarray([0.3, 0.4]))
    np.testing.assert_allclose(response.real, np.linalg.inv(mass) / 100.0, rtol=1e-6)


def test_continuous_mode_has_eigenvalues_and_no_open_loop():
    one = linearise(scenarios.load("example-4.1", {"simulation.t1": 0.01}))
    assert not one.held and np.isfinite(one.system.radius)
    with pytest.raises(DefinitionError, match="no sampled loop can be broken open"):
        one.closed("torque")
    assert one.as_json()["margins"] is None


def test_notes_list_the_parts_left_out():
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
    one = linearise(scenarios.load("example-4.1-1khz", changes))
    said = " ".join(one.notes)
    for words in ("rounding", "lost samples", "jitter", "learning"):
        assert words in said


@pytest.mark.full
def test_learning_that_stands_still_is_no_state(found):
    """With what was learnt as known from the start the loop is the same."""
    learning = linearise(
        scenarios.load("example-4.1-1khz", {**SHORT, "scheme.sampled_data.adaptation": {"kind": "joint_learning"}})
    )
    assert "learning" in " ".join(learning.notes)
    assert learning.system.a.shape[0] <= found.system.a.shape[0] + 2 * 2


@pytest.mark.parametrize(
    ("changes", "at", "said"),
    [
        ({}, 99.0, "`at` must be from"),
        ({"simulation.t1": 10.0, "scheme.sampled_data": None}, 9.0, "the run .* at t = .*, before the time"),
    ],
)
def test_loop_without_a_derivative_is_refused(changes, at, said):
    with pytest.raises(DefinitionError, match=said):
        linearise(scenarios.load("example-4.1-1khz", changes), at)


def test_the_parts_have_names(found):
    one = found.system.part("torque[joint 2]", ["error", "torque[joint 1]"])
    assert one.outputs == ("error[joint 1]", "error[joint 2]", "torque[joint 1]")
    with pytest.raises(DefinitionError, match="did you mean `torque`"):
        found.system.part("torq", "error")
    with pytest.raises(DefinitionError, match='broken at the "torque"'):
        found.closed("joint")


def test_margins_agree_with_python_control(found):
    control = pytest.importorskip("control", reason="pip install 'slidax[linear]'")
    loop = found.loop("torque", 0)
    theirs = loop.for_control()
    assert theirs.dt == pytest.approx(1e-3)
    omega = np.array([1.0, 50.0, 400.0, 2000.0])
    np.testing.assert_allclose(theirs(np.exp(1j * omega * 1e-3)), loop.response(omega)[:, 0, 0], rtol=1e-6)
    # By the response at many frequencies: its polynomials of 18 states have lost their digits.
    omega = np.linspace(1.0, np.pi * 1e3, 20000)
    response = loop.response(omega)[:, 0, 0]
    gain, phase, *_ = control.stability_margins((np.abs(response), np.degrees(np.angle(response)), omega))
    ours = found.margins("torque")[0]
    assert gain == pytest.approx(ours.gain_up, rel=1e-3)
    assert abs(phase) == pytest.approx(ours.phase, rel=1e-3)
    times, steps = found.system.part("disturbance", "error").step_response(0.05)
    expected = control.step_response(found.system.part("disturbance", "error").for_control(), T=times)
    np.testing.assert_allclose(steps[:, 0, 1], expected.outputs[0, 1], atol=1e-12)


def test_the_loop_itself_is_not_changed():
    loop, carry, _ = operating_point(scenarios.load("example-4.1-1khz", SHORT), 0.1)
    assert isinstance(loop, ClosedLoop) and int(carry.k) == 100
    assert dataclasses.is_dataclass(period_map(loop, carry))
