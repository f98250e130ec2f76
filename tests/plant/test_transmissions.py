"""LuGre friction and elastic joints against known facts, and against SciPy's stiff solver with tight tolerances."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from slidax.analysis import require_explainable
from slidax.analysis.linearise import operating_point
from slidax.certify.motion.admission import tracking_bound
from slidax.core import semi_implicit_euler
from slidax.core.errors import DefinitionError
from slidax.core.types import Command, State
from slidax.law import AbstractController
from slidax.motions import AbstractMotion
from slidax.plant import Constant, Elasticity, Encoders, Harmonic, LuGre, Transmission
from slidax.scenarios import load
from slidax.scenarios.family import Family
from slidax.simulation import Plant, simulate, simulate_batch
from slidax.studies.cases import Cases
from tests.paper_examples import TWO_LINK
from tests.simulation.simple import FreeMass, Pendulum

FRICTION = LuGre(0.3, 0.45, 0.05, 1e4, 50.0, 0.1)
MASS = 0.5


class Still(AbstractMotion):
    """A motion that stays at zero."""

    joints: int = eqx.field(static=True, default=1)

    def position(self, t):
        return jnp.zeros(self.joints)


class Prescribed(AbstractController):
    """A controller whose torque is a function of time and the measured state, `tau_at`."""

    torque: jax.Array = eqx.field(converter=jnp.asarray)

    @property
    def joints(self):
        return self.torque.size

    def init(self, t, state, reference):
        return ()

    def __call__(self, t, state, reference_now, reference_next, memory):
        return Command(tau=self.tau_at(t, state), memory=(), signals={"measured": state.q})

    def envelope(self, t, memory):
        return None


class Held(Prescribed):
    """`τ = τ_0 - k q`, from the measured position."""

    stiffness: jax.Array = eqx.field(converter=jnp.asarray, default=0.0)
    damping: jax.Array = eqx.field(converter=jnp.asarray, default=0.0)

    def tau_at(self, t, state):
        return self.torque - self.stiffness * state.q - self.damping * state.dq


class Pulse(Prescribed):
    """A constant torque until the time `until`."""

    until: float

    def tau_at(self, t, state):
        return jnp.where(t < self.until, self.torque, 0.0)


def run(
    transmission, *, h=1e-4, t1=1.0, force=(0.0,), start=(0.0, 0.0), robot=None, law=None, disturbance=None, **more
):
    """Simulate a mass, or another robot with one joint, under a constant force."""
    plant = Plant(robot or FreeMass(MASS), disturbance or Constant([0.0]), transmission=transmission)
    state = State([start[0]], [start[1]])
    options = {"period": h, "integrator": semi_implicit_euler, "engine": "xla"} | more
    return simulate(plant, law or Held(list(force)), Still(), state, t1=t1, **options)


def test_a_sticking_joint_deflects_by_about_the_force_over_the_bristle_stiffness():
    force, overdamped = 0.05 * 0.45, LuGre(0.3, 0.45, 0.05, 1e4, 400.0)
    log = run(Transmission(overdamped), t1=2.0, force=[force]).log
    q, dq = np.asarray(log.state.q[-1]), np.asarray(log.state.dq[-1])
    # z = F/σ₀, and dq = dz/(1 - σ₀ z/F_s) while the joint creeps.
    assert q[0] == pytest.approx(-0.45 / 1e4 * np.log(1.0 - 0.05), rel=1e-3)
    assert abs(dq[0]) < 1e-9


@pytest.mark.parametrize("speed", [0.01, -0.05, 0.2, 3.0])
def test_steady_sliding_has_the_friction_of_the_stribeck_curve(speed):
    # A mass this heavy nearly keeps its speed; its loss of momentum is the friction.
    run_of = run(Transmission(FRICTION), robot=FreeMass(1e6), start=(0.0, speed), t1=2.0, h=1e-3)
    dq = np.asarray(run_of.log.state.dq)[:, 0]
    lost = -1e6 * (dq[-1] - dq[-201]) / 0.2
    level = 0.3 + 0.15 * np.exp(-((speed / 0.05) ** 2))
    assert lost == pytest.approx(np.sign(speed) * level + 0.1 * speed, rel=1e-4)


def lugre_rate(bristle, v):
    level = 0.3 + 0.15 * np.exp(-((v / 0.05) ** 2))
    rate = v - 1e4 * np.abs(v) / level * bristle
    return rate, 1e4 * bristle + 50.0 * rate + 0.1 * v


def test_lugre_friction_converges_to_the_stiff_solver_with_order_one():
    def rate(t, y):
        dz, friction = lugre_rate(y[2], y[1])
        return [y[1], (0.6 * np.sin(2.0 * np.pi * t) - friction) / MASS, dz]

    times = [0.5, 1.0, 1.5]
    exact = solve_ivp(rate, (0.0, 1.6), [0.0, 0.0, 0.0], method="LSODA", rtol=1e-10, atol=1e-13, t_eval=times).y
    errors = []
    for h in (1e-3, 2.5e-4):
        push = Harmonic([0.6], 2.0 * np.pi)
        log = run(Transmission(FRICTION), h=h, t1=1.6, disturbance=push).log
        rows = [round(t / h) for t in times]
        errors.append([np.abs(x[rows, 0] - y).max() for x, y in zip((log.state.q, log.state.dq), exact, strict=False)])
    fine, coarse = np.array(errors[1]), np.array(errors[0])
    assert np.all(fine < [5e-4, 2.5e-3])
    np.testing.assert_allclose(coarse / fine, 4.0, rtol=0.1)


def test_stiff_bristles_are_stable_at_a_step_of_a_millisecond():
    stiff = LuGre(0.3, 0.45, 0.05, 1e8, 0.0)
    log = run(Transmission(stiff), h=1e-3, t1=3.0, start=(0.0, 1.0)).log
    dq = np.asarray(log.state.dq)[:, 0]
    assert np.all(np.abs(dq) <= 1.0)
    assert np.all(np.abs(dq[-100:]) < 1e-9)
    # It stops within the distance for Coulomb friction of 0.3 to 0.45 N.
    assert 0.5 * MASS / 0.45 < float(log.state.q[-1, 0]) < 0.5 * MASS / 0.3


@pytest.mark.parametrize("inertia", [0.1, 0.02])
def test_an_elastic_joint_oscillates_at_the_resonance_of_motor_and_link(inertia):
    k, h = 800.0, 1e-4
    spring = Transmission(elasticity=Elasticity(k, inertia, encoder="motor"))
    log = run(spring, h=h, t1=0.5, law=Pulse([5.0], 0.5 * h)).log
    twist = np.asarray(log.signals["measured"] - log.state.q)[:, 0]
    omega = np.sqrt(k * (1.0 / MASS + 1.0 / inertia))
    # The pulse leaves the twist h Δv sin(ω t)/ω; the step's own frequency is (2/h) asin(ω h/2), higher by (ω h)²/24.
    own = 2.0 / h * np.arcsin(0.5 * omega * h)
    assert own == pytest.approx(omega, rel=1e-3)
    expected = h * (5.0 / inertia) * h * np.sin(own * np.asarray(log.t)) / np.sin(own * h)
    np.testing.assert_allclose(twist, expected, rtol=0, atol=1e-8 * np.abs(expected).max())
    crossings = np.asarray(log.t)[1:][np.diff(np.sign(twist)) != 0]
    assert np.pi / np.mean(np.diff(crossings[1:])) == pytest.approx(omega, rel=5e-3)


def test_an_arm_with_friction_and_springs_converges_to_the_stiff_solver_with_order_one():
    friction, k, d, inertia = LuGre(0.3, 0.45, 0.05, 1e4, 50.0, 0.1), np.array([3000.0, 1500.0]), 2.0, [0.2, 0.1]
    mass_of, bias_of = (jax.jit(lambda *at, f=f: f(*at)) for f in (TWO_LINK.mass, TWO_LINK.bias))
    start = np.array([0.3, -0.4])
    held = np.asarray(bias_of(start, np.zeros(2)))

    def rate(t, y):
        q, v, motor, w, z = y.reshape(5, 2)
        dz, loss = lugre_rate(z, w)
        spring = k * (motor - q) + d * (w - v)
        tau = np.array([20.0, -8.0]) * (t < 0.1)
        a = np.linalg.solve(np.asarray(mass_of(q)), spring - np.asarray(bias_of(q, v)))
        return np.concatenate([v, a, w, (tau - spring - loss) / inertia, dz])

    y = np.concatenate([start, np.zeros(2), start + held / k, np.zeros(4)])
    for t0, t1 in ((0.0, 0.1), (0.1, 0.3)):
        y = solve_ivp(rate, (t0, t1), y, method="LSODA", rtol=1e-9, atol=1e-12).y[:, -1]
    transmission = Transmission(friction, Elasticity(k, inertia, d))
    errors = []
    for h in (2e-4, 5e-5):
        plant = Plant(TWO_LINK, Constant([0.0, 0.0]), transmission=transmission)
        log = simulate(
            plant,
            Pulse([20.0, -8.0], 0.1 - 1e-9),
            Still(2),
            State(start),
            t1=0.3,
            period=h,
            integrator=semi_implicit_euler,
        ).log
        numbers = np.concatenate([log.state.q[-1], log.state.dq[-1], log.signals["measured"][-1]])
        errors.append(np.abs(numbers - y[[0, 1, 2, 3, 4, 5]]))
    assert np.all(errors[1] < [2e-4, 2e-4, 5e-3, 5e-3, 2e-4, 2e-4])
    np.testing.assert_allclose(errors[0].max() / errors[1].max(), 4.0, rtol=0.15)


@pytest.mark.parametrize("encoder", ["motor", "link"])
def test_the_encoder_measures_the_motor_or_the_link_as_declared(encoder):
    """A pendulum of 3 N m, held by a stiff law, deflects its spring by its weight over the stiffness."""
    elastic = Transmission(elasticity=Elasticity(600.0, 0.3, 3.0, encoder=encoder))
    law = Held([0.0], 40.0, 8.0)
    start = State([1.0], [0.0])
    plant = Plant(Pendulum(), Constant([2.0]), Encoders(0.0), transmission=elastic)
    log = simulate(plant, law, Still(), start, t1=12.0, period=1e-3, integrator=semi_implicit_euler).log
    q, measured, tau = (float(x[-1, 0]) for x in (log.state.q, log.signals["measured"], log.tau))
    needed = 3.0 * np.sin(q) - 2.0
    assert tau == pytest.approx(needed, abs=1e-6)
    assert tau == pytest.approx(-40.0 * measured, abs=1e-6)
    assert measured - q == pytest.approx(needed / 600.0 if encoder == "motor" else 0.0, abs=1e-8)


ARM = "example-4.1-1khz"
BOTH = {
    "transmission.friction.coulomb": 3.0,
    "transmission.friction.static": 4.0,
    "transmission.elasticity.stiffness": 8000.0,
    "transmission.elasticity.damping": 5.0,
    "transmission.elasticity.inertia": 0.3,
    "simulation.integrator": "semi_implicit_euler",
    "simulation.t1": 0.3,
}


def test_engines_and_batches_agree_on_an_arm_with_friction_and_springs():
    # Later the law makes these springs oscillate, which amplifies rounding.
    scenario = load(ARM, BOTH | {"simulation.t1": 0.15})
    native, xla = (scenario.replace(engine=engine).simulate(log_every=1).log for engine in ("native", "xla"))
    np.testing.assert_allclose(native.e, xla.e, atol=1e-9)

    def define(stiffness):
        plant = eqx.tree_at(lambda p: p.transmission.elasticity.stiffness, scenario.plant, stiffness)
        return plant, *scenario.parts[1:]

    runs = simulate_batch(define, jnp.array([8000.0, 3000.0]), t1=0.15, stepping=scenario.stepping, log_every=1)
    np.testing.assert_allclose(runs[0].log.e, native.e, atol=1e-9)
    assert np.abs(np.asarray(runs[1].log.e) - np.asarray(native.e)).max() > 1e-6


def test_friction_of_an_elastic_joint_acts_on_the_motor():
    """An arm with stuck motors moves only by its springs."""
    stuck = Transmission(LuGre(50.0, 50.0, stiffness=1e6), Elasticity(500.0, 0.3, 30.0))
    plant = Plant(Pendulum(), Constant([10.0]), transmission=stuck)
    start = State([0.5], [0.0])
    log = simulate(plant, Held([0.0]), Still(), start, t1=3.0, period=1e-4, integrator=semi_implicit_euler).log
    # Link: 500 (θ - q) = 3 sin q - 10, and the motor bends its bristles by the same torque.
    q, motor = float(log.state.q[-1, 0]), float(log.signals["measured"][-1, 0])
    assert 500.0 * (motor - q) == pytest.approx(3.0 * np.sin(q) - 10.0, abs=1e-3)
    assert abs(motor - (0.5 + 3.0 * np.sin(0.5) / 500.0)) < 5e-5


def test_a_study_varies_friction_and_stiffness():
    sets = {
        "uncertainty": {
            "transmission.friction.static": {"between": [3.0, 6.0]},
            "transmission.elasticity.stiffness": {"between": [5e3, 2e4], "each": "joint"},
        }
    }
    cases = Cases(Family.of(load(ARM, BOTH | sets | {"simulation.t1": 0.05}).description))
    static, stiffness = np.array([3.0, 5.0, 3.0]), np.array([[8e3, 8e3], [8e3, 8e3], [8e3, 5e3]])
    columns = cases.run({"transmission.friction.static": static, "transmission.elasticity.stiffness": stiffness})
    assert len(np.unique(columns["steady_error"])) == 3


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        (ARM, {"simulation.integrator": "rk4"}, "integrator: semi_implicit_euler"),
        (
            ARM,
            {"transmission.friction": None, "transmission.elasticity": None},
            "must have `friction`, `elasticity` or both",
        ),
        (ARM, {"transmission.friction.static": 0.1}, "transmission.friction: `LuGre.static` must be >= `coulomb`"),
        (ARM, {"transmission.friction.coulomb": [1, 2, 3]}, "must be one number or one for each of the 2 joints"),
        (ARM, {"transmission.elasticity.inertia": None}, "set `transmission.elasticity.inertia`"),
        ("panda-payload", {"simulation.plant": "mujoco"}, "set `simulation.plant` to `own`"),
    ],
)
def test_invalid_transmissions_are_refused_with_a_remedy(name, changes, message):
    with pytest.raises(DefinitionError) as error:
        load(name, BOTH | changes).simulate()
    assert message in str(error.value)


def test_the_suggested_substeps_for_fast_springs_suffice_and_fewer_are_refused():
    stiff = BOTH | {"transmission.elasticity.stiffness": 3e7, "simulation.t1": 0.01}
    with pytest.raises(DefinitionError) as error:
        load(ARM, stiff).simulate()
    substeps = int(str(error.value).rpartition("at least ")[2])
    assert load(ARM, stiff | {"simulation.substeps": substeps}).simulate().outcome.ok
    with pytest.raises(DefinitionError, match="too fast"):
        load(ARM, stiff | {"simulation.substeps": substeps - 1}).simulate()


def test_a_transmission_in_continuous_mode_is_refused():
    with pytest.raises(DefinitionError, match="held"):
        run(Transmission(FRICTION), mode="continuous")


def test_no_certificate_covers_a_transmission():
    verdict = tracking_bound(load(ARM, BOTH))
    assert verdict.holds is None
    assert "LuGre" in verdict.statement


def test_explanation_of_a_law_with_motor_encoders_is_refused():
    with pytest.raises(DefinitionError, match="encoder: link"):
        require_explainable(load(ARM, BOTH))
    assert require_explainable(load(ARM, BOTH | {"transmission.elasticity.encoder": "link"})) is not None


def test_linearisation_with_a_transmission_is_refused():
    with pytest.raises(DefinitionError, match="leave `transmission` out"):
        operating_point(load(ARM, BOTH), 0.1)
