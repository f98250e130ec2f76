"""An arm of constant inertia, a law on it, and disturbances that change each period."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from slidax.arms import AbstractRobot
from slidax.certify.arm.demand import Demand
from slidax.core.types import Matrix, Scalar, State, Vector
from slidax.law import FixedTime, Kalman, Measured, UncertaintyBound, cftsmppc, sampled_data
from slidax.motions import ConstantPosture
from slidax.plant import AbstractDisturbance
from slidax.scenarios import Scenario, load
from slidax.simulation import Plant


class LinearArm(AbstractRobot):
    """`M q̈ = τ + τ_d`."""

    inertia: Matrix
    joint_units: tuple[str, ...] = eqx.field(static=True)
    joint_names: tuple[str, ...] = eqx.field(static=True)

    def __init__(self, inertia: Matrix) -> None:
        self.inertia = jnp.asarray(inertia)
        joints = self.inertia.shape[-1]
        self.joint_units = ("rad",) * joints
        self.joint_names = tuple(f"joint {k + 1}" for k in range(joints))

    def mass(self, q: Vector) -> Matrix:
        return self.inertia

    def bias(self, q: Vector, dq: Vector) -> Vector:
        return 0.0 * dq

    def friction(self, dq: Vector) -> Vector:
        return 0.0 * dq

    def potential(self, q: Vector) -> Scalar:
        return 0.0 * q[0]

    def tip(self, q: Vector) -> Float[Array, "3"]:
        return jnp.zeros(3)


class Changing(AbstractDisturbance):
    """One torque for each period."""

    torques: Float[Array, "k n"] = eqx.field(converter=jnp.asarray)
    period: Scalar = eqx.field(converter=jnp.asarray)

    def __call__(self, t: Scalar, state: State) -> Vector:
        k = jnp.clip(jnp.floor(t / self.period + 1e-6).astype(int), 0, self.torques.shape[0] - 1)
        return self.torques[k]


def scenario(
    rng: np.random.Generator,
    *,
    delay: int,
    kalman: bool,
    resolution: float,
    samples: int,
    joints: int = 2,
    period: float | None = None,
) -> Scenario:
    """A random law on a random arm whose nominal model is exact."""
    h = float(10 ** rng.uniform(-3.3, -2.4)) if period is None else period
    horizon = h * rng.uniform(2.0, 8.0)
    inertia = np.diag(10 ** rng.uniform(-1.0, 1.0, joints))
    error = rng.choice([-1.0, 1.0], joints) * 10 ** rng.uniform(-6.0, -0.3, joints)
    initial = np.abs(error) * rng.uniform(1.3, 3.0, joints) + 200.0 * resolution
    final = np.minimum(10 ** rng.uniform(-3.0, -1.5, joints), 0.5 * initial)
    law = cftsmppc(
        LinearArm(inertia),
        performance=FixedTime(initial, final, 0.6 * samples * h, 2.01),
        overshoot=float(rng.uniform(0.2, 0.8)),
        bound=UncertaintyBound(1.0, 1.0, 0.0, 0.0, 0.0, 1e9),
        gain=0.1, exponent=1.2, layer=0.0,
        k1=float(rng.uniform(0.2, 1.0)), k2=float(rng.uniform(0.3, 1.5)), p=0.5, q=1.2, delta=0.01,
    )  # fmt: skip
    measured = Measured.critical(min(0.5, 2.0 * h / horizon), delay + 1.0)
    density = (0.3 / horizon) ** 6 * 1e-10 * h
    estimator = Kalman.steady(density=density, variance=1e-10, period=h) if kalman else measured
    controller = sampled_data(law, period=h, horizon=horizon, estimator=estimator, delay=float(delay))
    changes = {"sensor.delay": delay, "actuator": {}, "sensor.resolution": resolution, "simulation.period": h}
    base = load("example-4.1-1khz", changes)
    arm = Plant(LinearArm(inertia), Changing(np.zeros((1, joints)), h), base.plant.sensor)
    start = State(q=error, dq=np.zeros(joints))
    return base.replace(
        plant=arm,
        controller=controller,
        trajectory=ConstantPosture(np.zeros(joints)),
        state0=start,
        t1=samples * h,
        limits="ignore",
    )


def demand(case: Scenario) -> Demand:
    """The demand of an arm whose nominal model is exact."""
    times = np.arange(round(case.t1 / case.period) + 1) * case.period
    n = case.controller.joints
    return Demand(
        times=times,
        disturbance=np.zeros((1, times.size, n)),
        kappa=np.ones((2, n)),
        coupling=np.zeros((n, n)),
        assumptions=(),
    )
