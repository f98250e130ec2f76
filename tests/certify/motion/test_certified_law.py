"""The law of a scenario is the law that the bounds along a motion assume."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from slidax.arms import AbstractRobot, Joint, assemble
from slidax.certify.motion.admission import tracking_bound
from slidax.certify.motion.joint_loop import OUTPUTS, JointLoop
from slidax.core.errors import DefinitionError
from slidax.core.types import Reference, State
from slidax.law import ComputedTorque, Kalman, SampledData, sampled_data
from slidax.law.envelopes import FixedTime
from slidax.law.error_transformations import PrescribedPerformance
from slidax.law.reaching_laws import FixedTimeReaching
from slidax.law.sliding_mode_controllers import SlidingMode
from slidax.law.surfaces import SmoothFixedTime
from slidax.law.torque_bounds import FixedBound
from slidax.scenarios import alter, load
from tests.simulation.simple import FreeMass

from .cases import desired, knotted, panda
from .plant import Chain, PaperPlan, simulate

PERIOD, RESOLUTION = 1e-3, 1e-5


def two_joints() -> Any:
    """A vertical arm with two links, an offset between its axes, rotors and viscous friction."""
    turned = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    inertia = np.diag([0.02, 0.03, 0.01])
    links: list[dict[str, Any]] = [
        {"rotation": turned, "translation": np.array([0.0, 0.0, 0.3]), "mass": 4.0, "armature": 0.1, "viscous": 0.4},
        {"translation": np.array([0.4, 0.0, 0.1]), "mass": 2.0, "armature": 0.05, "viscous": 0.3},
    ]
    return assemble(
        [
            Joint(
                name=f"joint {i}",
                kind="revolute",
                parent=f"joint {i - 1}" if i else None,
                link=f"link {i}",
                center=np.array([0.2, 0.02, 0.05]),
                inertia=inertia,
                lower=-2.0,
                upper=2.0,
                velocity=2.0,
                **link,
            )
            for i, link in enumerate(links)
        ],
        tip="link 1",
        name="two joints",
    )


ARMS = {"two joints": two_joints, "panda": panda}


def certified(arm: AbstractRobot, delay: int, **changes: Any) -> SampledData:
    law = ComputedTorque(arm, horizon=0.02)
    kalman = Kalman.steady(density=0.1, variance=RESOLUTION**2 / 12, period=PERIOD)
    options = {"estimator": kalman, "midpoint": True, "viscous_feedforward": True, **changes}
    return sampled_data(law, period=PERIOD, delay=float(delay), **options)


def sliding(arm: AbstractRobot, plan: PaperPlan, delay: int, density: float = 0.1) -> SampledData:
    """The paper's law with the plan of the independent simulation."""
    law = SlidingMode(
        arm,
        PrescribedPerformance(
            FixedTime(plan.initial, plan.final, deadline=plan.deadline, exponent=plan.exponent), plan.overshoot
        ),
        SmoothFixedTime(k1=plan.k1, k2=plan.k2, p=plan.p, q=plan.q, delta=plan.delta),
        FixedTimeReaching(gain=0.1, exponent=1.2),
        FixedBound(200.0),
    )
    kalman = Kalman.steady(density=density, variance=RESOLUTION**2 / 12, period=PERIOD)
    options = {"estimator": kalman, "midpoint": True, "viscous_feedforward": True, "horizon": plan.horizon}
    return sampled_data(law, period=PERIOD, delay=float(delay), **options)


@eqx.filter_jit
def torques(law: SampledData, q: Any, first: Reference, references: Any) -> Any:
    """Torques and rejections of a law at samples, from measured positions [N n] and the references [N + 1 2 n]."""
    start = State(first.q, first.dq)

    def step(memory: Any, sample: Any) -> Any:
        t, q, now, following = sample
        at, after = (Reference(part[0], part[1]) for part in (now, following))
        command = law(t, State(q, jnp.zeros_like(q)), at, after, memory)
        return command.memory, (command.tau, command.signals["rejected"])

    # The time of a sample is the time at which its torque acts.
    samples = jnp.asarray(PERIOD * (law.delay + np.arange(len(q)))), q, references[:-1], references[1:]
    return jax.lax.scan(step, law.init(jnp.asarray(PERIOD * law.delay), start, first), samples)[1]


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("delay", [0, 1, 2])
def test_scenario_law_computes_the_torques_of_the_certified_law(name: str, delay: int) -> None:
    arm, rng, slots = ARMS[name](), np.random.default_rng(4), 400
    law = certified(arm, delay)
    motion = knotted(arm, rng, 0.6)
    reference = desired(motion, PERIOD, slots, 1, delay)
    nominal = Chain.of(arm)
    truth = nominal.member(rng, 0.05)
    push = rng.normal(size=(slots, arm.joints)) * 0.2
    run = simulate(truth, nominal, JointLoop.of(law), reference, slots, 1, push=push, resolution=RESOLUTION, trace=True)
    assert run.trace is not None
    measured = RESOLUTION * (np.floor(run.trace[:, 0, 0] / RESOLUTION) + 0.5)
    tau, rejected = torques(law, measured, Reference(*reference[0]), reference[delay : delay + slots + 1])
    assert not np.any(rejected)
    applied = run.torque[delay:]
    np.testing.assert_allclose(tau[: len(applied)], applied, atol=1e-9 * np.max(np.abs(applied)), rtol=0)
    # A law with the model at the start of a period computes other torques.
    other, _ = torques(
        certified(arm, delay, midpoint=False),
        measured,
        Reference(*reference[0]),
        reference[delay : delay + slots + 1],
    )
    assert np.max(np.abs(other[: len(applied)] - applied)) > 1e-6 * np.max(np.abs(applied))


@pytest.mark.parametrize("delay", [0, 1])
def test_sliding_mode_law_computes_the_torques_of_its_certified_loop(delay: int) -> None:
    arm, rng, slots = two_joints(), np.random.default_rng(5), 400
    plan = PaperPlan(horizon=0.02, initial=0.05, final=0.01, deadline=0.2)
    law = sliding(arm, plan, delay)
    motion = knotted(arm, rng, 0.6)
    reference = desired(motion, PERIOD, slots, 1, delay)
    nominal = Chain.of(arm)
    push = rng.normal(size=(slots, arm.joints)) * 0.2
    run = simulate(
        nominal.member(rng, 0.05), nominal, JointLoop.of(law), reference, slots, 1, push=push, resolution=RESOLUTION,
        trace=True, plan=plan,
    )  # fmt: skip
    assert run.trace is not None
    measured = RESOLUTION * (np.floor(run.trace[:, 0, 0] / RESOLUTION) + 0.5)
    tau, rejected = torques(law, measured, Reference(*reference[0]), reference[delay : delay + slots + 1])
    assert not np.any(rejected)
    applied = run.torque[delay:]
    np.testing.assert_allclose(tau[: len(applied)], applied, atol=1e-7 * np.max(np.abs(applied)), rtol=0)


@pytest.mark.parametrize("ratio", [1.0, 0.8])
@pytest.mark.parametrize("delay", [0, 1, 2])
def test_certified_linear_loop_agrees_with_the_law_on_a_unit_mass(delay: int, ratio: float) -> None:
    law = certified(FreeMass(), delay, viscous_feedforward=False)
    loop, rng, count = JointLoop.of(law), np.random.default_rng(delay), 80
    noise, pulse, speed = rng.normal(size=(3, count)) * np.array([[1e-5], [1e-5], [1e-2]])
    rest = Reference(jnp.zeros(1))

    @jax.jit
    def moved(noise: Any, pulse: Any, speed: Any) -> Any:
        def period(carry: Any, inputs: Any) -> Any:
            e, v, held, memory = carry
            t, n, position, velocity = inputs
            command = law(t, State(e + n, jnp.zeros(1)), rest, rest, memory)
            waiting = jnp.concatenate([held, command.tau[None]])
            s, h = waiting[0], law.period
            after = e + h * v + 0.5 * h * h * ratio * s + position, v + h * ratio * s + velocity
            return (*after, waiting[1:], command.memory), (e[0], v[0], s[0])

        nothing = jnp.zeros(1)
        memory = law.init(jnp.zeros(()), State(nothing), rest)
        start = nothing, nothing, jnp.zeros((delay, 1)), memory
        return jax.lax.scan(period, start, (jnp.asarray(PERIOD * np.arange(count)), noise, pulse, speed))[1]

    maps = loop.maps_for(ratio)
    x, rows = np.zeros(len(maps.step)), []
    for inputs in zip(noise, pulse, speed * PERIOD, strict=True):
        outputs = maps.outputs @ x + maps.direct * inputs[0]
        rows.append([outputs[OUTPUTS[name]] / PERIOD ** OUTPUTS[name] for name in ("error", "velocity", "command")])
        x = maps.step @ x + maps.enters @ np.array(inputs)
    for own, linear in zip(moved(noise, pulse, speed), np.array(rows).T, strict=True):
        np.testing.assert_allclose(own, linear, atol=1e-10 * np.max(np.abs(linear)))


COVERED: dict[str, Any] = {
    "robot.nominal.viscous": 0.2,
    "scheme": {
        "name": "computed_torque",
        "horizon": 0.02,
        "sampled_data": {
            "estimator": {"kind": "kalman", "acceleration_density": 0.1},
            "adaptation": None,
            "midpoint": True,
            "viscous_feedforward": True,
        },
    },
}

SAMPLED = "scheme.sampled_data"
UNCOVERED: dict[str, tuple[dict[str, Any], str]] = {
    "adaptation": ({f"{SAMPLED}.adaptation": {}}, "adaptation: null"),
    "model at the start": ({f"{SAMPLED}.midpoint": False}, "midpoint: true"),
    "friction": ({f"{SAMPLED}.viscous_feedforward": False}, "viscous_feedforward: true"),
    "velocity sensor": ({f"{SAMPLED}.estimator": {"kind": "measured"}}, "acceleration_density"),
    "torque density": ({f"{SAMPLED}.estimator": {"kind": "kalman"}}, "acceleration_density"),
    "resolution per joint": ({"sensor.resolution": [1e-5] * 6 + [1e-4]}, "one `variance`"),
    "fractional delay": ({"sensor.delay": 1.5}, "`sensor.delay` to a whole number"),
    "dead time": ({"sensor.delay": 0.0, "actuator.dead_time": 1.0}, "actuator.dead_time: 0"),
    "gains per joint": ({"scheme.horizon": None, "scheme.kp": [100.0] * 6 + [90.0]}, "`scheme.kp` to one number"),
    "another scheme": ({"scheme.name": "gravity_pd"}, "scheme.name: computed_torque"),
}


def test_the_certified_loop_has_period_delay_and_gains_of_the_scenario() -> None:
    law = load("panda-payload", COVERED).controller
    assert isinstance(law, SampledData)
    loop, expected = JointLoop.of(law), JointLoop.with_density(1e-3, 0.02, 0.1, 1e-5, 1)
    assert (loop.period, loop.delay) == (expected.period, expected.delay)
    np.testing.assert_allclose((loop.kp, loop.kd, *loop.gains), (expected.kp, expected.kd, *expected.gains), rtol=1e-12)


@pytest.mark.parametrize("name", UNCOVERED)
def test_law_that_the_certificate_does_not_cover_is_refused_with_a_remedy(name: str) -> None:
    changes, remedy = UNCOVERED[name]
    law = alter(load("panda-payload", COVERED), changes).controller
    assert isinstance(law, SampledData)
    with pytest.raises(DefinitionError, match=remedy):
        JointLoop.of(law)


@pytest.mark.parametrize(("true", "assumed"), [(1, 0), (1, 2), (0, 1)])
def test_a_law_that_assumes_another_measurement_delay_than_the_true_one_has_no_bound(true: int, assumed: int) -> None:
    changes: dict[str, Any] = {"scheme": COVERED["scheme"], "start.q": [0.2, 2.0]}
    changes |= {f"{SAMPLED}.viscous_feedforward": False, f"{SAMPLED}.delay": assumed, "sensor.delay": true}
    verdict = tracking_bound(load("example-4.1-1khz", changes))
    # The loop is bounded with the delay that the law assumes.
    assert verdict.holds is None and verdict.bound == {}
    assert f"the measurement delay is {true} periods, but the law assumes {assumed}" in verdict.statement
    assert "leave out `scheme.sampled_data.delay`" in verdict.statement
